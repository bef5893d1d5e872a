// Charts over time with one playhead: drawn once by uPlot, the playhead and the reading move with the player.

import { faded, robotColour } from "./colours.js";
import { detections, deviations, edges, returns, ringDistances, separations, wrapped } from "./episode.js";

const MOST_LINES = 40;
const HEIGHT = 150;

// The charts of an episode: [{id, title, unit, kinds?, make(kind, colours)}]; make returns {series, bounds, step, least}.
export function chartsOf(episode) {
  const about = episode.about, found = [];
  const many = episode.count > MOST_LINES;
  if (about.ring.length > 1) {
    found.push({ id: "phases", title: "Phases", unit: "rad", kinds: ["relative", "wrapped"], make: memo((kind) => (kind === "wrapped" ? wrapped(episode) : deviations(episode)), (rows, colours, kind) => robotLines(rows, colours, many, kind === "wrapped" ? "" : "largest", kind)) });
    found.push({ id: "distances", title: "Ring distances", unit: "m", make: memo(() => ringDistances(episode), (rows, colours) => ({ ...edgeLines(rows, edges(episode), colours, many), bounds: [[2 * about.sensing, "2 r_s: discs part", colours.stuck], [2 * about.radius, "2 r: touch", colours.touch]], least: 0 })) });
  }
  if (episode.raw.targets.count > 0) {
    found.push({ id: "detections", title: "Detections", unit: "rogues", make: memo(() => detections(episode), (rows, colours) => ({ series: [{ label: "entered", values: rows.appeared, decimals: 0, colour: colours.muted, dash: [4, 3] }, { label: "seen", values: rows.detected, decimals: 0, colour: colours.found, fill: true }], step: true, least: 0 })) });
  }
  if (episode.ground.ageWorst) {
    found.push({ id: "age", title: "A rogue can be unseen for", unit: "s", make: (kind, colours) => ({ series: [{ label: "worst", values: episode.ground.ageWorst, colour: colours.unseen, fill: true }, { label: "mean", values: episode.ground.ageMean, colour: colours.muted, dash: [4, 3] }], bounds: [[about.bound, "T_max", colours.stuck]], least: 0 }) });
  } else if (episode.ground.idleWorst) {
    found.push({ id: "age", title: "Idleness", unit: "s", make: (kind, colours) => ({ series: [{ label: "worst", values: episode.ground.idleWorst, colour: colours.idle, fill: true }, { label: "mean", values: episode.ground.idleMean, colour: colours.muted, dash: [4, 3] }], bounds: [[about.bound, "T_max", colours.stuck]], least: 0 }) });
  }
  found.push({ id: "collisions", title: "Collisions", unit: "", make: memo(() => separations(episode), (rows, colours) => ({ series: [{ label: "collisions", values: episode.collisions, colour: colours.touch, scale: "count", step: true, decimals: 0 }, ...(rows ? [{ label: "nearest two [m]", values: rows, colour: colours.sensing, fill: false }] : [])], bounds: rows ? [[2 * about.radius, "2 r: touch", colours.touch]] : [], least: 0 })) });
  found.push({ id: "reward", title: "Return by its terms", unit: "mean over robots", kinds: ["summed", "per step"], make: memo((kind) => (kind === "summed" ? returns(episode) : perStep(episode)), (rows, colours) => ({ series: [{ label: "all", values: rows.all, colour: colours.ink, width: 2 }, ...rows.used.map((row, k) => ({ label: row.name, values: row.values, colour: colours.robots[k % 8], dash: k >= 8 ? [4, 3] : [] }))] })) });
  return found;
}

function memo(compute, dress) {
  const kept = new Map();
  return (kind, colours) => {
    if (!kept.has(kind)) kept.set(kind, compute(kind));
    return dress(kept.get(kind), colours, kind);
  };
}

function perStep(episode) {
  const rows = episode.terms.map((values, k) => ({ name: episode.raw.reward.names[k], values }));
  const used = rows.filter((row) => row.values.some((value) => Math.abs(value) > 1e-9));
  return { used, all: Float64Array.from(episode.x, (_, f) => used.reduce((sum, row) => sum + row.values[f], 0)) };
}

function robotLines(rows, colours, many, summary, kind) {
  const shown = many ? spread(rows) : rows.map((values, i) => ({ label: `robot ${i}`, values, colour: robotColour(colours, i), robot: i }));
  return { series: shown, summary, ...(kind === "wrapped" ? { least: 0, most: 2 * Math.PI } : { least: -0.1, most: 0.1 }) };
}

function edgeLines(rows, pairs, colours, many) {
  if (many) return { series: spread(rows) };
  return { series: rows.map((values, k) => ({ label: pairs[k].join("–"), values, colour: robotColour(colours, pairs[k][0]), robot: pairs[k][0] })), summary: "largest" };
}

// Of a crowd: smallest, mean, largest.
function spread(rows) {
  const of = (pick) => Array.from(rows[0], (_, f) => pick(rows.map((row) => row[f]).filter((value) => value !== null)));
  return [
    { label: "largest", values: of((all) => Math.max(...all)), colour: "#c2569a" },
    { label: "mean", values: of((all) => all.reduce((sum, value) => sum + value, 0) / all.length), colour: "#7a8794" },
    { label: "smallest", values: of((all) => Math.min(...all)), colour: "#3d82c4" },
  ];
}

export class Chart {
  constructor(figure, episode, chart, onSeek) {
    Object.assign(this, { figure, episode, chart, onSeek, kind: chart.kinds ? chart.kinds[0] : "", plot: null });
    this.box = figure.querySelector(".plot");
    this.reading = figure.querySelector(".reading");
    figure.dataset.chart = chart.id;
    figure.querySelector(".title").textContent = chart.title;
    figure.querySelector(".of").textContent = chart.unit ? `[${chart.unit}]` : "";
    this.head = document.createElement("div");
    this.head.className = "playhead";
    this.addChoices();
  }

  addChoices() {
    const box = this.figure.querySelector(".choices");
    for (const kind of this.chart.kinds || []) {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = kind;
      button.setAttribute("aria-pressed", String(kind === this.kind));
      button.addEventListener("click", () => {
        this.kind = kind;
        for (const other of box.children) other.setAttribute("aria-pressed", String(other === button));
        this.build(this.colours);
        this.move(this.time);
      });
      box.append(button);
    }
  }

  // The ends of the vertical axis, so that charts side by side can share them.
  range(colours) {
    const made = this.chart.make(this.kind, colours);
    let low = made.least ?? Infinity, high = made.most ?? -Infinity;
    for (const series of made.series) {
      if (series.scale) continue;
      for (const value of series.values) {
        if (value === null || !Number.isFinite(value)) continue;
        if (value < low) low = value;
        if (value > high) high = value;
      }
    }
    // A bound that is far from the numbers would press them together.
    for (const [value] of made.bounds || []) if (value < 2.2 * high) high = Math.max(high, value);
    return low <= high ? [low, high] : [0, 1];
  }

  build(colours, shared = this.shared) {
    this.colours = colours;
    this.shared = shared;
    const made = (this.made = this.chart.make(this.kind, colours));
    const [low, high] = (shared && shared(this)) || this.range(colours);
    const pad = 0.06 * (high - low || 1), counted = made.series.find((series) => series.scale);
    const axis = { stroke: colours.muted, font: "11px system-ui, sans-serif", ticks: { show: false }, grid: { stroke: colours.grid, width: 1 } };
    const options = {
      width: Math.max(this.box.clientWidth, 120),
      height: HEIGHT,
      padding: [8, 8, 0, 0],
      legend: { show: false },
      cursor: { show: false },
      scales: {
        x: { time: false, range: [0, Math.max(this.episode.duration, 1e-9)] },
        y: { range: [made.least === 0 && low >= 0 ? 0 : low - pad, high + pad] },
        ...(counted ? { count: { range: (_, __, most) => [0, Math.max(most, 4) * 1.06] } } : {}),
      },
      axes: [
        { ...axis, size: 22, gap: 2, grid: { show: false }, values: (_, marks) => marks.map((mark) => `${mark}`) },
        { ...axis, size: 40, gap: 4, space: 26, values: (_, marks) => marks.map(short) },
        ...(counted ? [{ ...axis, scale: "count", side: 1, size: 26, gap: 4, space: 30, grid: { show: false }, incrs: [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 10000] }] : []),
      ],
      series: [{}, ...made.series.map((series) => this.line(series, made.step))],
      hooks: { draw: [(plot) => drawBounds(plot, made.bounds || [], colours)] },
    };
    if (this.plot) this.plot.destroy();
    const values = made.series.map((series) => (series.values instanceof Array ? series.values : Array.from(series.values)));
    this.plot = new globalThis.uPlot(options, [this.episode.x, ...values], this.box);
    this.plot.over.append(this.head);
    this.plot.over.addEventListener("pointerdown", (event) => this.drag(event));
    this.shownMoment = -1;
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

  // What the lines say now: of one line for each robot the largest, else each by its name.
  read(moment) {
    const made = this.made;
    if (made.series.length > 3 && made.summary !== undefined) {
      const all = made.series.map((series) => Math.abs(series.values[moment] ?? 0));
      this.reading.textContent = made.summary ? `${made.summary} ${number(Math.max(...all))}` : "";
      return;
    }
    this.reading.replaceChildren(
      ...made.series.map((series) => {
        const entry = document.createElement("span");
        const mark = document.createElement("i");
        mark.style.background = series.colour;
        const value = series.values[moment];
        entry.append(mark, `${series.label} ${value === null ? "–" : series.decimals === 0 ? value : number(value)}`);
        return entry;
      }),
    );
  }
}

function drawBounds(plot, bounds, colours) {
  const { ctx, bbox } = plot, ratio = globalThis.devicePixelRatio || 1;
  for (const [value, words, colour] of bounds) {
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
    ctx.font = `${10.5 * ratio}px system-ui, sans-serif`;
    ctx.textAlign = "right";
    const below = y - bbox.top < 14 * ratio, right = bbox.left + bbox.width - 3 * ratio, wide = ctx.measureText(words).width;
    ctx.fillStyle = faded(colours.card, 0.85);
    ctx.fillRect(right - wide - 3 * ratio, y + (below ? 2 : -14) * ratio, wide + 6 * ratio, 12 * ratio);
    ctx.fillStyle = colours.ink;
    ctx.fillText(words, right, y + (below ? 12 : -4) * ratio);
    ctx.restore();
  }
}

export function number(value) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size >= 1e5) return value.toExponential(1);
  return value.toFixed(size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3).replace(/^-(0\.0+)$/, "$1");
}

function short(value) {
  return Math.abs(value) >= 1e4 ? value.toExponential(0) : String(Math.round(value * 1e4) / 1e4);
}
