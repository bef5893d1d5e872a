// One episode: its decoded data, and values derived for the charts and the timeline.
// Arrays of robots are series: robot i at moment f has index [i * moments + f].

import { reals, wholes } from "./unpacking.js";
import { number } from "./words.js";

export const WORKING = 0;
export const STUCK = 1;
export const REMOVED = 2;
export const FLEEING = 3;

const TURN = 2 * Math.PI;

export async function unpackedEpisode(raw) {
  const robots = {},
    targets = {},
    ground = {};
  const fill = async (into, name, made) => {
    into[name] = (await made).values;
  };
  const work = [];
  for (const name of ["x", "y", "z", "heading", "speed", "phase", "reward"]) {
    work.push(fill(robots, name, reals(raw.robots[name])));
  }
  for (const name of ["status", "silent"]) work.push(fill(robots, name, wholes(raw.robots[name])));
  for (const name of ["x", "y"]) work.push(fill(targets, name, reals(raw.targets[name])));
  const each = async (list) => Promise.all(list.map(async (packed) => (await reals(packed)).values));
  const series = async (list, into, names) => {
    (await each(list)).forEach((values, k) => {
      into[names[k]] = values;
    });
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
  work.push(
    each(raw.robots.observation).then((list) => {
      robots.observation = list;
    }),
  );
  work.push(
    each(raw.robots.action).then((list) => {
      robots.action = list;
    }),
  );
  work.push(
    each(raw.reward.terms).then((list) => {
      found.terms = list;
    }),
  );
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

  // Return the moment before a time [s] and the fraction to the next one.
  at(time) {
    const exact = Math.min(Math.max(time / this.step, 0), this.moments - 1);
    const moment = Math.min(Math.floor(exact + 1e-6), this.moments - 1);
    return { moment, share: Math.max(Math.min(exact - moment, 1), 0), now: exact };
  }

  // Interpolate a value between two moments.
  between(values, row, { moment, share }) {
    const first = row * this.moments + moment;
    const value = values[first];
    return share > 0 && moment + 1 < this.moments ? value + share * (values[first + 1] - value) : value;
  }

  // Interpolate smoothly through the values at all moments (Catmull-Rom).
  glide(values, row, { moment, share }) {
    const first = row * this.moments,
      last = this.moments - 1;
    if (share <= 0 || moment >= last) return values[first + moment];
    const [a, b, c, d] = [-1, 0, 1, 2].map((k) => values[first + Math.min(Math.max(moment + k, 0), last)]);
    return b + 0.5 * share * (c - a + share * (2 * a - 5 * b + 4 * c - d + share * (3 * (b - c) + d - a)));
  }

  angleBetween(values, row, { moment, share }) {
    const first = row * this.moments + moment;
    const value = values[first];
    return share > 0 && moment + 1 < this.moments ? value + share * turned(values[first + 1] - value) : value;
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
      const words = status === STUCK ? `robot ${i} has failed` : `robot ${i} has been removed`;
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
  return events.sort((one, other) => one.time - other.time);
}
