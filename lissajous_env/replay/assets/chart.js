// The charts over time; those of two episodes are side by side with a common scale, and the playhead moves with the player.

import { Plot } from "./plot.js";
import { linear } from "./scales.js";
import { chartsOf } from "./series.js";
import { element, number } from "./words.js";

const HEIGHT = 150;

export function placeCharts(box, template, episodes, named, onSeek) {
  const all = episodes.flatMap((episode) => chartsOf(episode).map((chart) => ({ episode, chart })));
  const ids = [...new Set(all.map(({ chart }) => chart.id))];
  return ids.flatMap((id) => {
    const alike = all.filter(({ chart }) => chart.id === id);
    const ranges = alike.map(({ chart }) => rangeOf(chart));
    const range = [Math.min(...ranges.map(([low]) => low)), Math.max(...ranges.map(([, high]) => high))];
    return alike.map(({ episode, chart }) => {
      const figure = template.content.firstElementChild.cloneNode(true);
      box.append(figure);
      const title = episodes.length > 1 ? `${chart.title} · ${named(episode)}` : chart.title;
      return new Chart(figure, episode, chart, title, range, onSeek);
    });
  });
}

// Return the range of the values of a chart.
function rangeOf({ series, bounds = [], least = Infinity, most = -Infinity }) {
  let [low, high] = [least, most];
  for (const { values } of series.filter((line) => !line.counted)) {
    for (const value of values) {
      if (value === null || !Number.isFinite(value)) continue;
      if (value < low) low = value;
      if (value > high) high = value;
    }
  }
  // A bound far from the values would compress them.
  for (const [value] of bounds) if (value < 2.2 * high) high = Math.max(high, value);
  return low <= high ? [low, high] : [0, 1];
}

class Chart {
  constructor(figure, episode, chart, title, [low, high], onSeek) {
    Object.assign(this, { figure, episode, chart, onSeek, robot: -1, moment: -1 });
    this.reading = figure.querySelector(".reading");
    figure.dataset.chart = chart.id;
    figure.querySelector(".title").textContent = title;
    figure.querySelector(".of").textContent = chart.unit ? `[${chart.unit}]` : "";
    const pad = 0.06 * (high - low || 1),
      counted = chart.series.filter((line) => line.counted).flatMap((line) => [...line.values]);
    this.axes = {
      x: { scale: linear(0, Math.max(episode.duration, 1e-9)) },
      y: { scale: linear(chart.least === 0 && low >= 0 ? 0 : low - pad, high + pad) },
      right: counted.length ? { scale: linear(0, 1.06 * Math.max(...counted.slice(-1), 4)) } : null,
    };
    const box = element("div");
    this.head = element("div", "playhead");
    this.over = element("div", "over", this.head);
    figure.querySelector(".plot-box").append(box, this.over);
    this.plot = new Plot(box, title, this.axes, () => this.fill(), HEIGHT);
    this.over.style.inset = this.plot.inset;
    this.bindSeek();
  }

  bindSeek() {
    const seek = (event) => {
      const box = this.over.getBoundingClientRect();
      this.onSeek(((event.clientX - box.left) / box.width) * this.episode.duration);
    };
    this.over.addEventListener("pointerdown", (event) => {
      this.over.setPointerCapture(event.pointerId);
      seek(event);
    });
    this.over.addEventListener("pointermove", (event) => this.over.hasPointerCapture(event.pointerId) && seek(event));
  }

  // The bounds that are on the scale.
  get bounds() {
    return (this.chart.bounds || []).filter(([value]) => this.axes.y.scale.holds(value));
  }

  fill() {
    const { plot, axes, chart } = this;
    for (const [value, , colour] of this.bounds) {
      const [x1, x2, y] = [plot.x(0), plot.x(axes.x.scale.far), plot.y(value)];
      plot.add("line", { x1, x2, y1: y, y2: y, stroke: colour, "stroke-dasharray": "5 4" });
    }
    this.paths = chart.series.map(({ values, colour, dashed, filled, stepped, counted }) => {
      const attributes = { class: "curve series", stroke: colour, "stroke-dasharray": dashed ? "4 3" : null };
      const scale = counted ? axes.right.scale : axes.y.scale;
      return plot.path(this.episode.x, values, attributes, { stepped: chart.stepped || stepped, filled, scale });
    });
    this.select(this.robot);
  }

  select(robot) {
    this.robot = robot;
    const { series } = this.chart;
    this.figure.classList.toggle("lit", robot >= 0 && series.some((line) => line.robot !== undefined));
    this.paths?.forEach((path, k) => path.classList.toggle("on", series[k].robot === robot));
  }

  move(time) {
    const share = this.episode.duration > 0 ? Math.min(time / this.episode.duration, 1) : 0;
    this.head.style.left = `${100 * share}%`;
    const { moment } = this.episode.at(time);
    if (moment !== this.moment) this.read(moment);
  }

  // Show the current values: the largest of lines per robot, otherwise each with its name; and the bounds in the chart.
  read(moment) {
    this.moment = moment;
    const { series, summary } = this.chart;
    let lines = [];
    if (series.length > 3 && summary) {
      const all = series.map(({ values }) => Math.abs(values[moment] ?? 0));
      lines = [element("span", "", `${summary} ${number(Math.max(...all))}`)];
    } else {
      lines = series.map(({ label, values, colour, whole }) => {
        const value = values[moment];
        return entryOf(colour, `${label} ${value === null ? "–" : whole ? value : number(value)}`);
      });
    }
    const named = this.bounds.map(([value, words, colour]) => entryOf(colour, `${words} ${number(value)}`, "dashed"));
    this.reading.replaceChildren(...lines, ...named);
  }
}

function entryOf(colour, words, kind = "") {
  const sign = element("i", kind);
  sign.style.color = colour;
  return element("span", "pair", sign, words);
}
