// The charts of an episode and their lines.

import { robotColour } from "./colours.js";
import { detections, deviations, edges, returns, ringDistances, separations, stepRewards, wrapped } from "./derived.js";

const MOST_LINES = 40;
const RELATIVE = "relative",
  WRAPPED = "wrapped",
  SUMMED = "summed",
  PER_STEP = "per step";

// The charts of an episode: [{id, title, unit, kinds, compute(kind), dress(rows, colours, kind)}]. `dress` returns
// {series: [{label, values, colour, ...}], bounds: [[value, words, colour]], least, most, step, summary}.
export function chartsOf(episode) {
  const found = [];
  if (episode.about.ring.length > 1) found.push(phases(episode), distances(episode));
  if (episode.raw.targets.count > 0) found.push(seen(episode));
  if (episode.ground.ageWorst) found.push(ages(episode, "Undetected time", "ageWorst", "ageMean", "unseen"));
  else if (episode.ground.idleWorst) found.push(ages(episode, "Idleness", "idleWorst", "idleMean", "idle"));
  return [...found, collisions(episode), rewards(episode)];
}

function phases(episode) {
  return {
    id: "phases",
    title: "Phases",
    unit: "rad",
    kinds: [RELATIVE, WRAPPED],
    compute: (kind) => (kind === WRAPPED ? wrapped(episode) : deviations(episode)),
    dress: (rows, colours, kind) => ({
      series: ofEach(
        rows,
        colours,
        rows.map((_, i) => i),
        rows.map((_, i) => `robot ${i}`),
      ),
      summary: kind === WRAPPED ? "" : "largest",
      ...(kind === WRAPPED ? { least: 0, most: 2 * Math.PI } : { least: -0.1, most: 0.1 }),
    }),
  };
}

function distances(episode) {
  const { sensing, radius } = episode.about,
    pairs = edges(episode);
  return {
    id: "distances",
    title: "Ring distances",
    unit: "m",
    kinds: [],
    compute: () => ringDistances(episode),
    dress: (rows, colours) => ({
      series: ofEach(
        rows,
        colours,
        pairs.map(([first]) => first),
        pairs.map((pair) => pair.join("–")),
      ),
      bounds: [
        [2 * sensing, "2 r_s (discs part)", colours.stuck],
        [2 * radius, "2 r (collision)", colours.touch],
      ],
      summary: "largest",
      least: 0,
    }),
  };
}

function seen(episode) {
  return {
    id: "detections",
    title: "Detections",
    unit: "targets",
    kinds: [],
    compute: () => detections(episode),
    dress: (rows, colours) => ({
      series: [
        { label: "entered", values: rows.appeared, colour: colours.muted, dash: [4, 3], decimals: 0 },
        { label: "detected", values: rows.detected, colour: colours.found, fill: true, decimals: 0 },
      ],
      step: true,
      least: 0,
    }),
  };
}

function ages(episode, title, worst, mean, colour) {
  return {
    id: "age",
    title,
    unit: "s",
    kinds: [],
    compute: () => episode.ground,
    dress: (rows, colours) => ({
      series: [
        { label: "worst case", values: rows[worst], colour: colours[colour], fill: true },
        { label: "mean", values: rows[mean], colour: colours.muted, dash: [4, 3] },
      ],
      bounds: [[episode.about.bound, episode.about.bound_name, colours.stuck]],
      least: 0,
    }),
  };
}

function collisions(episode) {
  return {
    id: "collisions",
    title: "Collisions",
    unit: "",
    kinds: [],
    compute: () => separations(episode),
    dress: (nearest, colours) => {
      const count = {
        label: "collisions",
        values: episode.collisions,
        colour: colours.touch,
        scale: "count",
        step: true,
        decimals: 0,
      };
      if (!nearest) return { series: [count], least: 0 };
      return {
        series: [count, { label: "smallest distance [m]", values: nearest, colour: colours.sensing }],
        bounds: [[2 * episode.about.radius, "2 r (collision)", colours.touch]],
        least: 0,
      };
    },
  };
}

function rewards(episode) {
  return {
    id: "reward",
    title: "Reward by its terms",
    unit: "per robot",
    kinds: [SUMMED, PER_STEP],
    compute: (kind) => (kind === SUMMED ? returns(episode) : stepRewards(episode)),
    dress: (rows, colours) => ({
      series: [
        { label: "all", values: rows.all, colour: colours.ink, width: 2 },
        ...rows.used.map(({ name, values }, k) => ({
          label: name,
          values,
          colour: robotColour(colours, k),
          dash: k >= colours.robots.length ? [4, 3] : [],
        })),
      ],
    }),
  };
}

// Return a line per robot in its colour, or for a crowd the smallest, the mean and the largest.
function ofEach(rows, colours, robots, labels) {
  if (rows.length <= MOST_LINES) {
    return rows.map((values, k) => ({
      label: labels[k],
      values,
      colour: robotColour(colours, robots[k]),
      robot: robots[k],
    }));
  }
  const of = (pick) =>
    Array.from(rows[0], (_, f) => {
      const all = rows.map((row) => row[f]).filter((value) => value !== null);
      return all.length ? pick(all) : null;
    });
  return [
    { label: "largest", values: of((all) => Math.max(...all)), colour: robotColour(colours, 3) },
    {
      label: "mean",
      values: of((all) => all.reduce((sum, value) => sum + value, 0) / all.length),
      colour: colours.muted,
    },
    { label: "smallest", values: of((all) => Math.min(...all)), colour: robotColour(colours, 0) },
  ];
}
