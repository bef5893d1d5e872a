// Quantities derived from an episode for the charts. A row is an array over the moments.

import { REMOVED, turned } from "./episode.js";

const MOST_PAIRS = 20000;

// Deviation of each phase from the equilibrium, rotated to zero mean [rad].
export function deviations(episode) {
  const { count, moments } = episode,
    phase = episode.robots.phase;
  const rows = Array.from({ length: count }, () => new Float32Array(moments));
  for (let f = 0; f < moments; f++) {
    let x = 0,
      y = 0;
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

function distance(episode, i, j, f) {
  const { x, y, z } = episode.robots,
    a = i * episode.moments + f,
    b = j * episode.moments + f;
  return Math.hypot(x[a] - x[b], y[a] - y[b], z[a] - z[b]);
}

export function ringDistances(episode) {
  return episode.about.links.map(([i, j]) => Float32Array.from(episode.x, (_, f) => distance(episode, i, j, f)));
}

// Smallest distance of any two robots; null for crowds, which would take too long.
export function separations(episode) {
  const { count, moments } = episode,
    status = episode.robots.status;
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
