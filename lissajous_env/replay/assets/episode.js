// One episode: its decoded data, and values derived for the charts and the timeline.
// Arrays of robots are series: robot i at moment f has index [i * moments + f].

import { number } from "./words.js";

const WORKING = 0;
export const FAILED = 1;
export const REMOVED = 2;
export const FLEEING = 3;

const TURN = 2 * Math.PI;
const KINDS = { 8: Uint8Array, 16: Uint16Array, 32: Uint32Array };

export class Episode {
  constructor(raw) {
    const { scenario: about, robots, targets, ground } = raw;
    Object.assign(this, { raw, about, robots, targets, ground });
    this.moments = raw.moments;
    this.step = raw.step * raw.every;
    this.duration = (raw.moments - 1) * this.step;
    this.count = robots.count;
    this.x = Float64Array.from({ length: raw.moments }, (_, f) => f * this.step);
    this.events = eventsOf(this);
    this.losesMessages = about.links.some(([i, j]) => this.x.some((_, f) => this.isCut(i, j, f)));
    this.hasSightings = targets.count > 0 && (!about.leave || about.sight > about.sensing);
  }

  // Return the moment before a time [s] and the fraction to the next one.
  at(time) {
    const exact = Math.min(Math.max(time / this.step, 0), this.moments - 1);
    const moment = Math.min(Math.floor(exact + 1e-6), this.moments - 1);
    return { moment, share: Math.max(Math.min(exact - moment, 1), 0), now: exact };
  }

  // Interpolate a value between two moments; `way` leads from the first to the next, as `turned` for angles.
  between(values, row, { moment, share }, way = (change) => change) {
    const first = row * this.moments + moment;
    const value = values[first];
    return share > 0 && moment + 1 < this.moments ? value + share * way(values[first + 1] - value) : value;
  }

  // Return true if a robot is not removed.
  isThere(robot, moment) {
    return this.robots.status[robot * this.moments + moment] !== REMOVED;
  }

  // Return true if a message of the neighbour on a side (0, 1) was due since the moment before, but none arrived.
  isLost(robot, side, moment) {
    const { neighbours, delay } = this.about,
      { every } = this.raw;
    if (neighbours[robot][side] < 0 || moment * every <= delay) return false;
    return this.robots.silent[(2 * robot + side) * this.moments + moment] > delay + every - 1;
  }

  // Return true if a message between two ring neighbours, in either direction, was lost; removed robots send none.
  isCut(i, j, moment) {
    if (!this.isThere(i, moment) || !this.isThere(j, moment)) return false;
    const lost = (of, from) =>
      [0, 1].some((side) => this.about.neighbours[of][side] === from && this.isLost(of, side, moment));
    return lost(i, j) || lost(j, i);
  }
}

// An angle in [-pi, pi).
export function turned(angle) {
  return angle - TURN * Math.floor((angle + Math.PI) / TURN);
}

// Events: [{kind, time, until, robots, words}], by time.
function eventsOf(episode) {
  const { moments, step, count } = episode,
    every = episode.raw.every,
    events = [];
  for (let i = 0; i < count; i++) {
    for (let f = 0; f < moments; f++) {
      const status = episode.robots.status[i * moments + f];
      if (status === WORKING || (f > 0 && status === episode.robots.status[i * moments + f - 1])) continue;
      let last = f;
      while (last + 1 < moments && episode.robots.status[i * moments + last + 1] === status) last += 1;
      const words = status === FAILED ? `robot ${i} has failed` : `robot ${i} has been removed`;
      events.push({ kind: "fault", time: f * step, until: last * step, robots: [i], words });
    }
  }
  for (const [i, j, first, last] of episode.raw.contacts) {
    const words = `robots ${i} and ${j} collide`;
    events.push({ kind: "touch", time: first * step, until: last * step, robots: [i, j], words });
  }
  const { appears, found } = episode.targets;
  appears.forEach((appeared, t) => {
    const seen = found[t] >= 0;
    const time = ((seen ? found[t] : appeared) * step) / every;
    const waited = seen ? ((found[t] - appeared) * step) / every : 0;
    const words = seen
      ? `target ${t} detected after ${number(Math.max(waited, 0))} s`
      : `target ${t} enters; it is never detected`;
    events.push({
      kind: seen ? "detection" : "missed",
      time,
      until: seen ? time : episode.duration,
      robots: [],
      words,
    });
  });
  if (episode.raw.rogue) events.push(rogueEvent(episode.raw.rogue, episode.raw.step));
  return events.sort((one, other) => one.time - other.time);
}

// Return the event of a rogue.
function rogueEvent({ begin, until, detected }, step) {
  const words = `the rogue that this policy misses: undetected for ${number((until - begin) * step)} s`;
  const ends = detected ? `, then detected at ${number(until * step)} s` : ", until the end";
  return { kind: "rogue", time: begin * step, until: until * step, robots: [], words: words + ends };
}

// Decode all arrays in the data of lissajous_env/replay/contents.py.
export async function unpacked(part) {
  if (part?.bits && Array.isArray(part.shape)) return decoded(part);
  if (part === null || typeof part !== "object" || typeof part[0] === "number") return part;
  const entries = await Promise.all(Object.entries(part).map(async ([name, inner]) => [name, await unpacked(inner)]));
  return Array.isArray(part) ? entries.map(([, inner]) => inner) : Object.fromEntries(entries);
}

// Decode an array of numbers, or of counts, of which `none` marks missing ones; the last axis of its shape is time.
async function decoded({ data, bits, shape, low, scale, none }) {
  const bytes = Uint8Array.from(atob(data), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const planes = new Uint8Array(await new Response(stream).arrayBuffer());
  const size = bits / 8,
    count = planes.length / size;
  const whole = new KINDS[bits](count);
  for (let plane = 0; plane < size; plane++) {
    for (let k = 0; k < count; k++) whole[k] |= planes[plane * count + k] << (8 * plane);
  }
  const length = shape[shape.length - 1];
  for (let k = 1; k < count; k++) if (k % length !== 0) whole[k] += whole[k - 1];
  const values = none === undefined ? Float32Array.from(whole, (q) => low + scale * q) : whole;
  return Object.assign(values, { shape, none });
}
