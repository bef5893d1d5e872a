// The charts over time; those of two episodes are side by side with a common scale, and the playhead moves with the player.

import { Plot } from "./plot.js";
import { linear } from "./scales.js";
import { chartsOf } from "./series.js";
import { button, element, number } from "./words.js";

const HEIGHT = 150;

export function placeCharts(box, template, episodes, named, onSeek) {
  const all = episodes.flatMap((episode) => chartsOf(episode).map((chart) => ({ episode, chart })));
  const ids = [...new Set(all.map(({ chart }) => chart.id))];
  return ids.flatMap((id) => {
    const alike = [];
    for (const { episode, chart } of all.filter((each) => each.chart.id === id)) {
      const figure = template.content.firstElementChild.cloneNode(true);
      box.append(figure);
      const title = episodes.length > 1 ? `${chart.title} · ${named(episode)}` : chart.title;
      alike.push(new Chart(figure, episode, chart, title, onSeek, alike));
    }
    for (const chart of alike) chart.build();
    return alike;
  });
}

class Chart {
  // `alike`: the charts of all episodes with the same id.
  constructor(figure, episode, chart, title, onSeek, alike) {
    Object.assign(this, { figure, episode, chart, title, onSeek, alike, kind: chart.kinds[0] || "", time: 0 });
    this.computed = new Map();
    this.reading = figure.querySelector(".reading");
    figure.dataset.chart = chart.id;
    figure.querySelector(".title").textContent = title;
    figure.querySelector(".of").textContent = chart.unit ? `[${chart.unit}]` : "";
    this.head = element("div", "playhead");
    this.over = element("div", "over", this.head);
    figure.querySelector(".plot-box").append(element("div"), this.over);
    this.addChoices();
    this.bindSeek();
  }

  addChoices() {
    const box = this.figure.querySelector(".choices");
    for (const kind of this.chart.kinds) {
      const choice = button("", kind, () => {
        this.kind = kind;
        for (const other of box.children) other.setAttribute("aria-pressed", String(other === choice));
        this.build();
        this.move(this.time);
      });
      choice.setAttribute("aria-pressed", String(kind === this.kind));
      box.append(choice);
    }
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

  // The lines; slow computations are cached.
  get lines() {
    if (!this.computed.has(this.kind)) this.computed.set(this.kind, this.chart.lines(this.kind));
    return this.computed.get(this.kind);
  }

  // Return the range of the values.
  range() {
    const { lines } = this;
    let low = lines.least ?? Infinity,
      high = lines.most ?? -Infinity;
    for (const { values } of lines.series.filter((series) => !series.counted)) {
      for (const value of values) {
        if (value === null || !Number.isFinite(value)) continue;
        if (value < low) low = value;
        if (value > high) high = value;
      }
    }
    // A bound far from the values would compress them.
    for (const [value] of lines.bounds || []) if (value < 2.2 * high) high = Math.max(high, value);
    return low <= high ? [low, high] : [0, 1];
  }

  build() {
    const { series, least } = this.lines;
    const ranges = this.alike.filter((other) => other.kind === this.kind).map((other) => other.range());
    const low = Math.min(...ranges.map((range) => range[0])),
      high = Math.max(...ranges.map((range) => range[1])),
      pad = 0.06 * (high - low || 1);
    const counted = series.filter((each) => each.counted).flatMap((each) => [...each.values]);
    this.axes = {
      x: { scale: linear(0, Math.max(this.episode.duration, 1e-9)) },
      y: { scale: linear(least === 0 && low >= 0 ? 0 : low - pad, high + pad) },
      right: counted.length ? { scale: linear(0, 1.06 * Math.max(...counted.slice(-1), 4)) } : null,
    };
    const box = element("div");
    this.over.previousElementSibling.replaceWith(box);
    this.plot = new Plot(box, this.title, this.axes, () => this.fill(), HEIGHT);
    this.over.style.inset = this.plot.inset;
    this.shownMoment = -1;
  }

  fill() {
    const { plot, axes } = this,
      { series, step, bounds = [] } = this.lines;
    for (const [value, , colour] of bounds.filter(([value]) => axes.y.scale.holds(value))) {
      const [x1, x2, y] = [plot.x(0), plot.x(axes.x.scale.far), plot.y(value)];
      plot.add("line", { x1, x2, y1: y, y2: y, stroke: colour, "stroke-dasharray": "5 4" });
    }
    this.paths = series.map(({ values, colour, dashed, filled, stepped, counted }) => {
      const attributes = { class: "curve series", stroke: colour, "stroke-dasharray": dashed ? "4 3" : null };
      const scale = counted ? axes.right.scale : axes.y.scale;
      return plot.path(this.episode.x, values, attributes, { stepped: step || stepped, filled, scale });
    });
    this.select(this.robot ?? -1);
  }

  select(robot) {
    this.robot = robot;
    const { series } = this.lines;
    this.figure.classList.toggle("lit", robot >= 0 && series.some((each) => each.robot !== undefined));
    this.paths?.forEach((path, k) => path.classList.toggle("on", series[k].robot === robot));
  }

  move(time) {
    this.time = time;
    const share = this.episode.duration > 0 ? Math.min(time / this.episode.duration, 1) : 0;
    this.head.style.left = `${100 * share}%`;
    const { moment } = this.episode.at(time);
    if (moment === this.shownMoment) return;
    this.shownMoment = moment;
    this.read(moment);
  }

  // Show the current values: the largest of lines per robot, otherwise each with its name; and the bounds in the chart.
  read(moment) {
    const { series, summary, bounds = [] } = this.lines;
    let lines = [];
    if (series.length > 3 && summary !== undefined) {
      const all = series.map(({ values }) => Math.abs(values[moment] ?? 0));
      if (summary) lines = [element("span", "", `${summary} ${number(Math.max(...all))}`)];
    } else {
      lines = series.map(({ label, values, colour, whole }) => {
        const value = values[moment];
        return entryOf(colour, `${label} ${value === null ? "–" : whole ? value : number(value)}`);
      });
    }
    const within = bounds.filter(([value]) => this.axes.y.scale.holds(value));
    const named = within.map(([value, words, colour]) => entryOf(colour, `${words} ${number(value)}`, "dashed"));
    this.reading.replaceChildren(...lines, ...named);
  }
}

function entryOf(colour, words, kind = "") {
  const sign = element("i", kind);
  sign.style.color = colour;
  return element("span", "pair", sign, words);
}
