// One episode: its decoded data, and values derived for the charts and the timeline.
// Arrays of robots are series: robot i at moment f has index [i * moments + f].

import { number } from "./words.js";

const WORKING = 0;
export const FAILED = 1;
export const REMOVED = 2;
export const FLEEING = 3;

const TURN = 2 * Math.PI;
const KINDS = { 8: Uint8Array, 16: Uint16Array, 32: Uint32Array };

export async function unpackedEpisode(raw) {
  const of = async (names, decode, from) =>
    Object.fromEntries(await Promise.all(names.map(async (name) => [name, (await decode(from[name])).values])));
  const columns = (list) => Promise.all(list.map(async (packed) => (await reals(packed)).values));
  const pictures = async (name) => {
    const packed = raw.ground[name];
    return packed ? { [name]: { ...(await wholes(packed.cells)), stride: packed.stride } } : {};
  };
  const worstAndMean = async (name) => {
    if (!raw.ground[name]) return {};
    const [worst, mean] = await columns(raw.ground[name]);
    return { [`${name}Worst`]: worst, [`${name}Mean`]: mean };
  };
  const ground = [pictures("sensed"), pictures("unseen"), worstAndMean("idle"), worstAndMean("age")];
  const robots = [
    of(["x", "y", "z", "heading", "speed", "phase", "reward"], reals, raw.robots),
    of(["status", "silent"], wholes, raw.robots),
  ];
  const arrays = {
    robots: Object.assign(...(await Promise.all(robots))),
    targets: Object.assign(await of(["x", "y"], reals, raw.targets), await of(["seen"], wholes, raw.targets)),
    ground: Object.assign({}, ...(await Promise.all(ground))),
    terms: await columns(raw.reward.terms),
    ...(await of(["collisions"], wholes, raw)),
    ...(await of(["curve"], reals, raw)),
  };
  for (const name of ["observation", "action"]) arrays.robots[name] = await columns(raw.robots[name]);
  return new Episode(raw, arrays);
}

class Episode {
  // `arrays`: the decoded arrays of robots, targets, ground, curve, terms of the reward and collisions.
  constructor(raw, arrays) {
    Object.assign(this, { raw, ...arrays });
    this.about = raw.scenario;
    this.moments = raw.moments;
    this.step = raw.step * raw.every;
    this.duration = (raw.moments - 1) * this.step;
    this.count = raw.robots.count;
    this.x = Float64Array.from({ length: raw.moments }, (_, f) => f * this.step);
    this.events = eventsOf(this);
    this.losesMessages = losesMessages(this);
    this.hasSightings = raw.targets.count > 0 && (!this.about.leave || this.about.sight > this.about.sensing);
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

  // Return whether a message of the neighbour on a side (0, 1) arrived in the step of a moment, or was due.
  isLost(robot, side, moment) {
    const raw = this.about,
      step = moment * this.raw.every;
    if (raw.neighbours[robot][side] < 0 || step <= raw.delay) return false;
    const silent = this.robots.silent[(2 * robot + side) * this.moments + moment];
    return silent > raw.delay + this.raw.every - 1;
  }

  // Return true if a message between two ring neighbours, in either direction, was lost.
  isCut(i, j, moment) {
    const lost = (of, from) =>
      [0, 1].some((side) => this.about.neighbours[of][side] === from && this.isLost(of, side, moment));
    return lost(i, j) || lost(j, i);
  }
}

// An angle in [-pi, pi).
export function turned(angle) {
  return angle - TURN * Math.floor((angle + Math.PI) / TURN);
}

function losesMessages(episode) {
  for (let f = 0; f < episode.moments; f++) {
    for (let i = 0; i < episode.count; i++) if (episode.isLost(i, 0, f) || episode.isLost(i, 1, f)) return true;
  }
  return false;
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
  const { appears, found } = episode.raw.targets;
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
function rogueEvent({ steps, until, detected }, step) {
  const words = `the rogue that this policy misses: undetected for ${number((until - steps[0]) * step)} s`;
  const ends = detected ? `, then detected at ${number(until * step)} s` : ", until the end";
  return { kind: "rogue", time: steps[0] * step, until: until * step, robots: [], words: words + ends };
}

// Decode the arrays of lissajous_env/replay/contents.py to whole numbers: {values, shape, none}; the last axis is time.
async function wholes(packed) {
  const bytes = Uint8Array.from(atob(packed.data), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const planes = new Uint8Array(await new Response(stream).arrayBuffer());
  const size = packed.bits / 8,
    count = planes.length / size;
  const values = new KINDS[packed.bits](count);
  for (let plane = 0; plane < size; plane++) {
    for (let k = 0; k < count; k++) values[k] |= planes[plane * count + k] << (8 * plane);
  }
  const length = packed.shape[packed.shape.length - 1];
  for (let k = 1; k < count; k++) if (k % length !== 0) values[k] += values[k - 1];
  return { values, shape: packed.shape, none: packed.none };
}

// Decode numbers: {values, shape}.
async function reals(packed) {
  const whole = await wholes(packed);
  return { values: Float32Array.from(whole.values, (q) => packed.low + packed.scale * q), shape: whole.shape };
}
