// Quantities derived from an episode for the charts. A row is an array over the moments.

import { turned } from "./episode.js";

const MOST_PAIRS = 20000;

// Deviation of each phase from the equilibrium, rotated to zero mean [rad]; null for robots that were removed.
export function deviations(episode) {
  const { count, moments } = episode,
    rows = Array.from({ length: count }, () => new Array(moments).fill(null));
  const angle = (i, f) => episode.robots.phase[i * moments + f] - episode.about.equilibrium[i];
  for (let f = 0; f < moments; f++) {
    const robots = [...rows.keys()].filter((i) => episode.isThere(i, f));
    const sum = (of) => robots.reduce((total, i) => total + of(angle(i, f)), 0);
    const mean = Math.atan2(sum(Math.sin), sum(Math.cos));
    for (const i of robots) rows[i][f] = turned(angle(i, f) - mean);
  }
  return rows;
}

function distance(episode, i, j, f) {
  const { x, y, z } = episode.robots,
    a = i * episode.moments + f,
    b = j * episode.moments + f;
  return Math.hypot(x[a] - x[b], y[a] - y[b], z[a] - z[b]);
}

// Distances of the neighbours on the ring, null if one was removed.
export function ringDistances(episode) {
  const between = (i, j, f) => (episode.isThere(i, f) && episode.isThere(j, f) ? distance(episode, i, j, f) : null);
  return episode.about.links.map(([i, j]) => Array.from(episode.x, (_, f) => between(i, j, f)));
}

// Smallest distance of any two robots that do not share a place of the formation; null for crowds, which would take too long.
export function separations(episode) {
  const { count } = episode,
    { places } = episode.about;
  if (count < 2 || (count * (count - 1)) / 2 > MOST_PAIRS) return null;
  return Array.from(episode.x, (_, f) => {
    let least = Infinity;
    for (let i = 1; i < count; i++) {
      if (!episode.isThere(i, f)) continue;
      for (let j = 0; j < i; j++) {
        if (episode.isThere(j, f) && places[i] !== places[j]) least = Math.min(least, distance(episode, i, j, f));
      }
    }
    return least === Infinity ? null : least;
  });
}

// Targets that have appeared and been detected up to each moment.
export function detections(episode) {
  const { appears, found } = episode.targets;
  const appeared = new Float64Array(episode.moments),
    detected = new Float64Array(episode.moments);
  const enter = (into, step) => {
    const f = Math.ceil(step / episode.raw.every - 1e-9);
    if (f < episode.moments) into[Math.max(f, 0)] += 1;
  };
  appears.forEach((step) => enter(appeared, step));
  found.forEach((step) => {
    if (step >= 0) enter(detected, step);
  });
  for (let f = 1; f < episode.moments; f++) {
    appeared[f] += appeared[f - 1];
    detected[f] += detected[f - 1];
  }
  return { appeared, detected };
}

// Targets that are in the rectangle, and those of them in sight, at each moment.
export function inSight(episode) {
  const { moments, raw, about, targets } = episode,
    [seen, there] = [new Float64Array(moments), new Float64Array(moments)];
  for (let t = 0; t < targets.count; t++) {
    for (let f = 0; f < moments; f++) {
      const step = f * raw.every,
        left = about.leave && targets.found[t] >= 0 && targets.found[t] <= step;
      if (targets.appears[t] > step || left) continue;
      there[f] += 1;
      seen[f] += targets.seen[t * moments + f];
    }
  }
  return { seen, there };
}

// Cumulative sums of the terms of the reward that are not always zero, and of all: {used: [{name, values}], all}.
export function returns(episode) {
  const { names, terms } = episode.raw.reward;
  const used = terms
    .map((values, k) => ({ name: names[k], values: summed(values) }))
    .filter((_, k) => terms[k].some((value) => value !== 0));
  const all = Float64Array.from(episode.x, (_, f) => used.reduce((sum, row) => sum + row.values[f], 0));
  return { used, all };
}

function summed(values) {
  let sum = 0;
  return Float64Array.from(values, (value) => (sum += value));
}
