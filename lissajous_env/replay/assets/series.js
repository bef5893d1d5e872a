// The charts of an episode and their lines.

import { ROBOT_COLOURS, robotColour } from "./colours.js";
import { detections, deviations, edges, returns, ringDistances, separations, stepRewards, wrapped } from "./derived.js";

const MOST_LINES = 40;
const RELATIVE = "relative",
  WRAPPED = "wrapped",
  SUMMED = "summed",
  PER_STEP = "per step";

// The charts of an episode: [{id, title, unit, kinds, lines(kind)}]. `lines` returns
// {series: [{label, values, colour, ...}], bounds: [[value, words, colour]], least, most, step, summary}.
export function chartsOf(episode) {
  const found = [];
  if (episode.about.ring.length > 1) found.push(phases(episode), distances(episode));
  if (episode.raw.targets.count > 0) found.push(seen(episode));
  if (episode.ground.ageWorst) found.push(ages(episode, "Undetected time", "age", "unseen"));
  else if (episode.ground.idleWorst) found.push(ages(episode, "Idleness", "idle", "idle"));
  return [...found, collisions(episode), rewards(episode)];
}

function phases(episode) {
  const relative = () => ({
    series: ofEach(deviations(episode), (k) => k, (k) => `robot ${k}`),
    summary: "largest",
    least: -0.1,
    most: 0.1,
  });
  const absolute = () => ({
    series: ofEach(wrapped(episode), (k) => k, (k) => `robot ${k}`),
    summary: "",
    least: 0,
    most: 2 * Math.PI,
  });
  const lines = (kind) => (kind === WRAPPED ? absolute() : relative());
  return { id: "phases", title: "Phases", unit: "rad", kinds: [RELATIVE, WRAPPED], lines };
}

function distances(episode) {
  const { sensing, radius } = episode.about,
    pairs = edges(episode);
  const lines = () => ({
    series: ofEach(ringDistances(episode), (k) => pairs[k][0], (k) => pairs[k].join("–")),
    bounds: [
      [2 * sensing, "2 r_s (discs part)", "var(--stuck)"],
      [2 * radius, "2 r (collision)", "var(--touch)"],
    ],
    summary: "largest",
    least: 0,
  });
  return { id: "distances", title: "Ring distances", unit: "m", kinds: [], lines };
}

function seen(episode) {
  const lines = () => {
    const { appeared, detected } = detections(episode);
    return {
      series: [
        { label: "entered", values: appeared, colour: "var(--muted)", dashed: true, whole: true },
        { label: "detected", values: detected, colour: "var(--found)", filled: true, whole: true },
      ],
      step: true,
      least: 0,
    };
  };
  return { id: "detections", title: "Detections", unit: "targets", kinds: [], lines };
}

function ages(episode, title, name, colour) {
  const { [`${name}Worst`]: worst, [`${name}Mean`]: mean } = episode.ground;
  const lines = () => ({
    series: [
      { label: "worst case", values: worst, colour: `var(--${colour})`, filled: true },
      { label: "mean", values: mean, colour: "var(--muted)", dashed: true },
    ],
    bounds: [[episode.about.bound, episode.about.bound_name, "var(--stuck)"]],
    least: 0,
  });
  return { id: "age", title, unit: "s", kinds: [], lines };
}

function collisions(episode) {
  const { collisions: values, about } = episode;
  const lines = () => {
    const count = { label: "collisions", values, colour: "var(--touch)", counted: true, stepped: true, whole: true };
    const nearest = separations(episode);
    if (!nearest) return { series: [count], least: 0 };
    return {
      series: [count, { label: "smallest distance [m]", values: nearest, colour: "var(--sensing)" }],
      bounds: [[2 * about.radius, "2 r (collision)", "var(--touch)"]],
      least: 0,
    };
  };
  return { id: "collisions", title: "Collisions", unit: "", kinds: [], lines };
}

function rewards(episode) {
  const lines = (kind) => {
    const { used, all } = kind === SUMMED ? returns(episode) : stepRewards(episode);
    const terms = used.map(({ name, values }, k) => {
      return { label: name, values, colour: robotColour(k), dashed: k >= ROBOT_COLOURS };
    });
    return { series: [{ label: "all", values: all, colour: "var(--ink)" }, ...terms] };
  };
  return { id: "reward", title: "Reward by its terms", unit: "per robot", kinds: [SUMMED, PER_STEP], lines };
}

// Return a line per row in the colour of its robot, or for a crowd the smallest, the mean and the largest.
function ofEach(rows, robotOf, labelOf) {
  if (rows.length <= MOST_LINES) {
    return rows.map((values, k) => {
      const robot = robotOf(k);
      return { label: labelOf(k), values, colour: robotColour(robot), robot };
    });
  }
  const of = (pick) =>
    Array.from(rows[0], (_, f) => {
      const all = rows.map((row) => row[f]).filter((value) => value !== null);
      return all.length ? pick(all) : null;
    });
  const mean = (all) => all.reduce((sum, value) => sum + value, 0) / all.length;
  return [
    { label: "largest", values: of((all) => Math.max(...all)), colour: robotColour(3) },
    { label: "mean", values: of(mean), colour: "var(--muted)" },
    { label: "smallest", values: of((all) => Math.min(...all)), colour: robotColour(0) },
  ];
}
