// A chart over time, drawn once by uPlot; the playhead and the reading move with the player.

import { faded } from "./colours.js";
import { button, element, mark, number } from "./words.js";

const HEIGHT = 150;
const COUNTS = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 10000, 100000];

export class Chart {
  constructor(figure, episode, chart, onSeek) {
    Object.assign(this, { figure, episode, chart, onSeek, kind: chart.kinds[0] || "", plot: null });
    this.computed = new Map();
    this.box = figure.querySelector(".plot");
    this.reading = figure.querySelector(".reading");
    figure.dataset.chart = chart.id;
    figure.querySelector(".title").textContent = chart.title;
    figure.querySelector(".of").textContent = chart.unit ? `[${chart.unit}]` : "";
    this.head = element("div", "playhead");
    this.addChoices();
  }

  addChoices() {
    const box = this.figure.querySelector(".choices");
    for (const kind of this.chart.kinds) {
      const choice = button("", kind, () => {
        this.kind = kind;
        for (const other of box.children) other.setAttribute("aria-pressed", String(other === choice));
        this.build(this.colours);
        this.move(this.time);
      });
      choice.setAttribute("aria-pressed", String(kind === this.kind));
      box.append(choice);
    }
  }

  // Return the lines; slow computations are cached.
  lines(colours) {
    const { chart, kind } = this;
    if (!this.computed.has(kind)) this.computed.set(kind, chart.compute(kind));
    return chart.dress(this.computed.get(kind), colours, kind);
  }

  // Return the range of the vertical axis, which charts side by side share.
  range(colours) {
    const made = this.lines(colours);
    let low = made.least ?? Infinity,
      high = made.most ?? -Infinity;
    for (const series of made.series) {
      if (series.scale) continue;
      for (const value of series.values) {
        if (value === null || !Number.isFinite(value)) continue;
        if (value < low) low = value;
        if (value > high) high = value;
      }
    }
    // A bound far from the values would compress them.
    for (const [value] of made.bounds || []) if (value < 2.2 * high) high = Math.max(high, value);
    return low <= high ? [low, high] : [0, 1];
  }

  build(colours, shared = this.shared) {
    this.colours = colours;
    this.shared = shared;
    const made = (this.made = this.lines(colours));
    if (this.plot) this.plot.destroy();
    const values = made.series.map((series) => Array.from(series.values));
    this.plot = new globalThis.uPlot(this.options(made, colours), [this.episode.x, ...values], this.box);
    this.plot.over.append(this.head);
    this.plot.over.addEventListener("pointerdown", (event) => this.drag(event));
    this.shownMoment = -1;
  }

  options(made, colours) {
    const [low, high] = (this.shared && this.shared(this)) || this.range(colours);
    const pad = 0.06 * (high - low || 1);
    this.span = [made.least === 0 && low >= 0 ? 0 : low - pad, high + pad];
    const counted = made.series.some((series) => series.scale);
    const axis = {
      stroke: colours.muted,
      font: "11px system-ui, sans-serif",
      ticks: { show: false },
      grid: { stroke: colours.grid, width: 1 },
    };
    const plain = { ...axis, grid: { show: false } };
    // Omit the 0, which would overlap with the last time.
    const values = (_, marks) => marks.map((value) => (value === 0 ? "" : mark(value)));
    const right = { ...plain, scale: "count", side: 1, size: 26, gap: 4, space: 30, incrs: COUNTS, values };
    return {
      width: Math.max(this.box.clientWidth, 120),
      height: HEIGHT,
      padding: [8, 8, 0, 0],
      legend: { show: false },
      cursor: { show: false },
      scales: {
        x: { time: false, range: [0, Math.max(this.episode.duration, 1e-9)] },
        y: { range: this.span },
        ...(counted ? { count: { range: (_, __, most) => [0, Math.max(most, 4) * 1.06] } } : {}),
      },
      axes: [
        { ...plain, size: 22, gap: 2, values: (_, marks) => marks.map(mark) },
        { ...axis, size: 40, gap: 4, space: 26, values: (_, marks) => marks.map(mark) },
        ...(counted ? [right] : []),
      ],
      series: [{}, ...made.series.map((series) => this.line(series, made.step))],
      hooks: { draw: [(plot) => drawBounds(plot, made.bounds || [])] },
    };
  }

  line(series, step) {
    const paths = step || series.step ? globalThis.uPlot.paths.stepped({ align: 1 }) : undefined;
    return {
      scale: series.scale || "y",
      stroke: series.colour,
      width: series.width || 1.4,
      dash: series.dash,
      fill: series.fill ? faded(series.colour, 0.12) : undefined,
      points: { show: false },
      spanGaps: false,
      ...(paths ? { paths } : {}),
    };
  }

  drag(event) {
    const over = this.plot.over;
    over.setPointerCapture(event.pointerId);
    const seek = (moved) => {
      const box = over.getBoundingClientRect();
      this.onSeek(((moved.clientX - box.left) / box.width) * this.episode.duration);
    };
    const stop = () => over.removeEventListener("pointermove", seek);
    seek(event);
    over.addEventListener("pointermove", seek);
    over.addEventListener("pointerup", stop, { once: true });
    over.addEventListener("pointercancel", stop, { once: true });
  }

  resize() {
    const width = Math.max(this.box.clientWidth, 120);
    if (this.plot && Math.abs(this.plot.width - width) > 1) this.plot.setSize({ width, height: HEIGHT });
    this.move(this.time);
  }

  select(robot) {
    if (!this.plot || !this.made.series.some((series) => series.robot !== undefined)) return;
    this.made.series.forEach((series, k) => {
      const picked = robot < 0 || series.robot === robot;
      this.plot.series[k + 1].alpha = picked ? 1 : 0.18;
      this.plot.series[k + 1].width = picked && robot >= 0 ? 2 : 1.4;
    });
    this.plot.redraw(false);
  }

  move(time) {
    this.time = time;
    if (!this.plot || time === undefined) return;
    const share = this.episode.duration > 0 ? Math.min(time / this.episode.duration, 1) : 0;
    this.head.style.transform = `translateX(${(share * this.plot.over.clientWidth).toFixed(1)}px)`;
    const { moment } = this.episode.at(time);
    if (moment === this.shownMoment) return;
    this.shownMoment = moment;
    this.read(moment);
  }

  // Return the current values: the largest of lines per robot, otherwise each with its name.
  read(moment) {
    const made = this.made,
      bounds = this.boundsShown().map(([value, words, colour]) => entryOf(colour, `${words} ${number(value)}`, "dashed"));
    if (made.series.length > 3 && made.summary !== undefined) {
      const all = made.series.map((series) => Math.abs(series.values[moment] ?? 0));
      const largest = made.summary ? [element("span", "", `${made.summary} ${number(Math.max(...all))}`)] : [];
      this.reading.replaceChildren(...largest, ...bounds);
      return;
    }
    const lines = made.series.map((series) => {
      const value = series.values[moment];
      const words = value === null ? "–" : series.decimals === 0 ? value : number(value);
      return entryOf(series.colour, `${series.label} ${words}`);
    });
    this.reading.replaceChildren(...lines, ...bounds);
  }

  // Draw the bounds within the chart, labelled above it, where labels cover no line.
  boundsShown() {
    const [low, high] = this.span;
    return (this.made.bounds || []).filter(([value]) => low <= value && value <= high);
  }
}

function entryOf(colour, words, kind = "") {
  const sign = element("i", kind);
  sign.style.color = colour;
  return element("span", "", sign, words);
}

function drawBounds(plot, bounds) {
  const { ctx, bbox } = plot,
    ratio = globalThis.devicePixelRatio || 1;
  for (const [value, , colour] of bounds) {
    const y = Math.round(plot.valToPos(value, "y", true));
    if (y < bbox.top - 1 || y > bbox.top + bbox.height) continue;
    ctx.save();
    ctx.strokeStyle = colour;
    ctx.lineWidth = ratio;
    ctx.setLineDash([5 * ratio, 4 * ratio]);
    ctx.beginPath();
    ctx.moveTo(bbox.left, y);
    ctx.lineTo(bbox.left + bbox.width, y);
    ctx.stroke();
    ctx.restore();
  }
}
