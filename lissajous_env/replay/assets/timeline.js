// Events over time: a lane for each kind and each episode; a click goes to an event.

import { COLOURS, faded } from "./colours.js";

// Kind of events, words, and colour.
const LANES = [
  ["detection", "detected", COLOURS.found],
  ["missed", "missed", COLOURS.target],
  ["rogue", "rogue", COLOURS.unseen],
  ["touch", "collisions", COLOURS.touch],
  ["fault", "faults", COLOURS.failed],
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
    this.rows = this.lanes.flatMap(([kind, words, colour]) =>
      episodes.map((_, k) => ({ kind, words: k ? "" : words, colour, k })),
    );
    // All events, for stepping.
    this.all = episodes.flatMap((episode) => episode.events).sort((one, other) => one.time - other.time);
  }

  // Return the names of the lanes; two episodes have separate lanes.
  names() {
    return this.rows.map((row) => (this.episodes.length > 1 ? `${row.words} ${numeral(row.k)}` : row.words));
  }

  draw(width, ratio) {
    const height = Math.max(this.rows.length, 1) * LANE + 8;
    this.width = width;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    this.canvas.style.height = `${height}px`;
    const context = this.canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.rows.forEach(({ kind, colour, k }, row) => {
      const y = 4 + row * LANE;
      context.fillStyle = COLOURS.grid;
      context.fillRect(0, y + LANE / 2 - 0.5, width, 1);
      for (const event of this.episodes[k].events.filter((event) => event.kind === kind)) {
        const x = this.x(event.time);
        context.fillStyle = faded(colour, 0.45);
        context.fillRect(x, y + 2, this.x(event.until) - x, LANE - 5);
        context.fillStyle = colour;
        context.fillRect(x - 1, y + 1, 2, LANE - 3);
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
