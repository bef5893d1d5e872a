// One episode: what the page holds of it, unpacked; what is derived from it for the charts and the timeline.
// Arrays of robots are series: robot i at moment f stands at [i * moments + f].

import { reals, wholes } from "./unpacking.js";

export const WORKING = 0;
export const STUCK = 1;
export const REMOVED = 2;
export const FLEEING = 3;

const TURN = 2 * Math.PI;
const MOST_PAIRS = 20000;

export async function unpackedEpisode(raw) {
  const robots = {}, targets = {}, ground = {};
  const fill = async (into, name, made) => { into[name] = (await made).values; };
  const work = [];
  for (const name of ["x", "y", "z", "heading", "speed", "phase", "reward"]) {
    work.push(fill(robots, name, reals(raw.robots[name])));
  }
  for (const name of ["status", "silent"]) work.push(fill(robots, name, wholes(raw.robots[name])));
  for (const name of ["x", "y"]) work.push(fill(targets, name, reals(raw.targets[name])));
  const each = async (list) => Promise.all(list.map(async (packed) => (await reals(packed)).values));
  const series = async (list, into, names) => {
    (await each(list)).forEach((values, k) => { into[names[k]] = values; });
  };
  const pictures = async (name) => {
    if (!raw.ground[name]) return;
    const cells = await wholes(raw.ground[name].cells);
    ground[name] = { ...cells, stride: raw.ground[name].stride };
  };
  const found = {};
  work.push(pictures("sensed"), pictures("unseen"));
  if (raw.ground.idle) work.push(series(raw.ground.idle, ground, ["idleWorst", "idleMean"]));
  if (raw.ground.age) work.push(series(raw.ground.age, ground, ["ageWorst", "ageMean"]));
  work.push(each(raw.robots.observation).then((list) => { robots.observation = list; }));
  work.push(each(raw.robots.action).then((list) => { robots.action = list; }));
  work.push(each(raw.reward.terms).then((list) => { found.terms = list; }));
  work.push(fill(found, "collisions", wholes(raw.collisions)));
  const curve = await reals(raw.curve);
  await Promise.all(work);
  return new Episode(raw, robots, targets, ground, found, curve.values);
}

export class Episode {
  constructor(raw, robots, targets, ground, found, curve) {
    Object.assign(this, { raw, robots, targets, ground, curve, terms: found.terms, collisions: found.collisions });
    this.about = raw.scenario;
    this.moments = raw.moments;
    this.step = raw.step * raw.every;
    this.duration = (raw.moments - 1) * this.step;
    this.count = raw.robots.count;
    this.x = Float64Array.from({ length: raw.moments }, (_, f) => f * this.step);
    this.events = eventsOf(this);
    this.losesMessages = losesMessages(this);
  }

  // The moment that a time [s] lies in, and how far it is to the next one.
  at(time) {
    const exact = Math.min(Math.max(time / this.step, 0), this.moments - 1);
    const moment = Math.min(Math.floor(exact + 1e-6), this.moments - 1);
    return { moment, share: Math.max(Math.min(exact - moment, 1), 0), now: exact };
  }

  // A number between its values at two moments.
  between(values, row, { moment, share }) {
    const first = row * this.moments + moment;
    const value = values[first];
    return share > 0 && moment + 1 < this.moments ? value + share * (values[first + 1] - value) : value;
  }

  angleBetween(values, row, { moment, share }) {
    const first = row * this.moments + moment;
    const value = values[first];
    return share > 0 && moment + 1 < this.moments ? value + share * turned(values[first + 1] - value) : value;
  }

  // Whether a message of the neighbour on a side (0, 1) came in the step of a moment, or should have.
  isLost(robot, side, moment) {
    const raw = this.about, step = moment * this.raw.every;
    if (raw.neighbours[robot][side] < 0 || step <= raw.delay) return false;
    const silent = this.robots.silent[(2 * robot + side) * this.moments + moment];
    return silent > raw.delay + this.raw.every - 1;
  }
}

// An angle in [-pi, pi).
export function turned(angle) {
  return angle - TURN * Math.floor((angle + Math.PI) / TURN);
}

// Deviation of each phase from the equilibrium, turned so that it is zero on the mean [rad].
export function deviations(episode) {
  const { count, moments } = episode, phase = episode.robots.phase;
  const rows = Array.from({ length: count }, () => new Float32Array(moments));
  for (let f = 0; f < moments; f++) {
    let x = 0, y = 0;
    for (let i = 0; i < count; i++) {
      const angle = phase[i * moments + f] - episode.about.equilibrium[i];
      x += Math.cos(angle);
      y += Math.sin(angle);
    }
    const mean = Math.atan2(y, x);
    for (let i = 0; i < count; i++) rows[i][f] = turned(phase[i * moments + f] - episode.about.equilibrium[i] - mean);
  }
  return rows;
}

// Phases in [0, 2 pi), with a gap where one begins anew.
export function wrapped(episode) {
  const { count, moments } = episode, phase = episode.robots.phase;
  return Array.from({ length: count }, (_, i) => {
    const row = Array.from(phase.subarray(i * moments, (i + 1) * moments));
    return row.map((value, f) => (f > 0 && Math.abs(value - row[f - 1]) > Math.PI ? null : value));
  });
}

export function distance(episode, i, j, f) {
  const { x, y, z } = episode.robots, a = i * episode.moments + f, b = j * episode.moments + f;
  return Math.hypot(x[a] - x[b], y[a] - y[b], z[a] - z[b]);
}

// Pairs of ring neighbours, each once.
export function edges(episode) {
  const ring = episode.about.ring;
  if (ring.length < 2) return [];
  return ring.length === 2 ? [[ring[0], ring[1]]] : ring.map((robot, k) => [robot, ring[(k + 1) % ring.length]]);
}

export function ringDistances(episode) {
  return edges(episode).map(([i, j]) => Float32Array.from(episode.x, (_, f) => distance(episode, i, j, f)));
}

// Smallest distance of any two robots that are there; null for crowds, of which it would take too long.
export function separations(episode) {
  const { count, moments } = episode, status = episode.robots.status;
  if (count < 2 || (count * (count - 1)) / 2 > MOST_PAIRS) return null;
  return Array.from(episode.x, (_, f) => {
    let least = Infinity;
    for (let i = 1; i < count; i++) {
      if (status[i * moments + f] === REMOVED) continue;
      for (let j = 0; j < i; j++) {
        if (status[j * moments + f] !== REMOVED) least = Math.min(least, distance(episode, i, j, f));
      }
    }
    return least === Infinity ? null : least;
  });
}

// Targets that have appeared and been detected up to each moment.
export function detections(episode) {
  const { appears, found } = episode.raw.targets;
  const appeared = new Float64Array(episode.moments), detected = new Float64Array(episode.moments);
  const enter = (into, step) => {
    const f = Math.ceil(step / episode.raw.every - 1e-9);
    if (f < episode.moments) into[Math.max(f, 0)] += 1;
  };
  appears.forEach((step) => enter(appeared, step));
  found.forEach((step) => { if (step >= 0) enter(detected, step); });
  for (let f = 1; f < episode.moments; f++) {
    appeared[f] += appeared[f - 1];
    detected[f] += detected[f - 1];
  }
  return { appeared, detected };
}

// Terms of the reward that are not always zero, summed up to each moment: [{name, values}].
export function returns(episode) {
  const rows = episode.terms.map((values, k) => {
    let sum = 0;
    return { name: episode.raw.reward.names[k], values: Float64Array.from(values, (value) => (sum += value * episode.raw.every)) };
  });
  const used = rows.filter((_, k) => episode.terms[k].some((value) => Math.abs(value) > 1e-9));
  const all = Float64Array.from(episode.x, (_, f) => used.reduce((sum, row) => sum + row.values[f], 0));
  return { used, all };
}

function losesMessages(episode) {
  for (let f = 0; f < episode.moments; f++) {
    for (let i = 0; i < episode.count; i++) if (episode.isLost(i, 0, f) || episode.isLost(i, 1, f)) return true;
  }
  return false;
}

// What happened: [{kind, time, until, robots, words}], by time.
function eventsOf(episode) {
  const { moments, step, count } = episode, every = episode.raw.every, events = [];
  for (let i = 0; i < count; i++) {
    for (let f = 0; f < moments; f++) {
      const status = episode.robots.status[i * moments + f];
      if (status === WORKING || (f > 0 && status === episode.robots.status[i * moments + f - 1])) continue;
      let last = f;
      while (last + 1 < moments && episode.robots.status[i * moments + last + 1] === status) last += 1;
      const words = status === STUCK ? `robot ${i} is stuck` : `robot ${i} is lost`;
      events.push({ kind: "fault", time: f * step, until: last * step, robots: [i], words });
    }
  }
  for (const [i, j, first, last] of episode.raw.contacts) {
    const words = `robots ${i} and ${j} touch`;
    events.push({ kind: "touch", time: first * step, until: last * step, robots: [i, j], words });
  }
  const { appears, found } = episode.raw.targets;
  appears.forEach((appeared, t) => {
    const seen = found[t] >= 0;
    const time = ((seen ? found[t] : appeared) * step) / every;
    const waited = seen ? ((found[t] - appeared) * step) / every : 0;
    const words = seen ? `rogue ${t} seen after ${Math.max(waited, 0).toFixed(2)} s` : `rogue ${t} enters; it is never seen`;
    events.push({ kind: seen ? "detection" : "missed", time, until: seen ? time : episode.duration, robots: [], words });
  });
  return events.sort((one, other) => one.time - other.time);
}
