// Events over time: a lane for each kind and each episode; a click goes to an event.

import { faded } from "./colours.js";

const LANES = [
  ["detection", "detected"],
  ["missed", "missed"],
  ["rogue", "rogue"],
  ["touch", "collisions"],
  ["fault", "faults"],
];
const LANE = 12;
const NEAR = 7;

export class Timeline {
  constructor(canvas, episodes, duration) {
    Object.assign(this, { canvas, episodes, duration });
    // Events so close are simultaneous [s].
    this.near = 0.01 * episodes[0].raw.step;
    this.lanes = LANES.filter(([kind]) =>
      episodes.some((episode) => episode.events.some((event) => event.kind === kind)),
    );
    this.rows = this.lanes.flatMap(([kind, words]) => episodes.map((_, k) => ({ kind, words: k ? "" : words, k })));
    // Distinct times of events, for stepping.
    this.all = episodes
      .flatMap((episode, k) => episode.events.map((event) => ({ ...event, episode: k })))
      .sort((one, other) => one.time - other.time);
  }

  get height() {
    return Math.max(this.rows.length, 1) * LANE + 8;
  }

  // Return the names of the lanes; two episodes have separate lanes.
  names() {
    return this.rows.map((row) => (this.episodes.length > 1 ? `${row.words} ${numeral(row.k)}` : row.words));
  }

  resize(width, ratio) {
    this.width = width;
    this.ratio = ratio;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(this.height * ratio);
    this.canvas.style.height = `${this.height}px`;
  }

  colour(kind, colours) {
    const { found, target, unseen, touch, stuck } = colours;
    return { detection: found, missed: target, rogue: unseen, touch, fault: stuck }[kind];
  }

  draw(colours) {
    const context = this.canvas.getContext("2d");
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    context.clearRect(0, 0, this.width, this.height);
    context.font = "10px system-ui, sans-serif";
    context.textBaseline = "middle";
    this.rows.forEach((row, k) => {
      const y = 4 + k * LANE,
        colour = this.colour(row.kind, colours);
      context.fillStyle = colours.grid;
      context.fillRect(0, y + LANE / 2 - 0.5, this.width, 1);
      for (const event of this.episodes[row.k].events) {
        if (event.kind !== row.kind) continue;
        const x = this.x(event.time),
          wide = Math.max(this.x(event.until) - x, 2);
        context.fillStyle = ["missed", "rogue", "fault"].includes(row.kind) ? faded(colour, 0.45) : colour;
        if (row.kind === "detection") context.fillRect(x - 1, y + 1, 2, LANE - 3);
        else {
          context.fillRect(x, y + 2, wide, LANE - 5);
          context.fillStyle = colour;
          context.fillRect(x - 1, y + 1, 2.5, LANE - 3);
        }
      }
    });
  }

  x(time) {
    return this.duration > 0 ? (time / this.duration) * this.width : 0;
  }

  // Return the event within a few pixels of a place [px], or null.
  nearest(x, y) {
    const row = this.rows[Math.floor((y - 4) / LANE)];
    let best = null,
      least = NEAR;
    for (const event of row ? this.episodes[row.k].events : []) {
      const away = Math.max(this.x(event.time) - x, x - this.x(event.until), 0);
      if (event.kind === row.kind && away < least) [best, least] = [event, away];
    }
    return best;
  }

  // Return true if an event begins at a place [px].
  begins(event, x) {
    return Math.abs(this.x(event.time) - x) < NEAR;
  }

  before(time) {
    return this.all.findLast((event) => event.time < time - this.near) || null;
  }
  after(time) {
    return this.all.find((event) => event.time > time + this.near) || null;
  }

  // Return the latest event before a time, for twice the duration of a shown detection.
  latest(time) {
    const { flash } = this.episodes[0].about;
    return this.all.findLast((event) => event.time <= time + this.near && time - event.time < 2 * flash) || null;
  }
}

// Numeral of an episode, which distinguishes two.
export function numeral(k) {
  return ["①", "②"][k];
}
