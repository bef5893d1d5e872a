// The charts of an episode and their lines.

import { ROBOT_COLOURS, robotColour } from "./colours.js";
import { detections, deviations, inSight, returns, ringDistances, separations } from "./derived.js";

const MOST_LINES = 40;

// The charts of an episode: [{id, title, unit, series: [{label, values, colour, ...}], bounds: [[value, words, colour]],
// least, most, stepped, summary}].
export function chartsOf(episode) {
  const charts = [];
  if (episode.raw.curve.length > 0 && episode.about.links.length > 0) charts.push(phases(episode), distances(episode));
  if (episode.hasSightings) charts.push(sightings(episode));
  if (episode.targets.count > 0) charts.push(seen(episode));
  if (episode.ground.age) charts.push(ages(episode, "Undetected time", "age", "unseen"));
  else if (episode.ground.idle) charts.push(ages(episode, "Idleness", "idle", "idle"));
  return [...charts, collisions(episode), rewards(episode)];
}

function phases(episode) {
  const series = ofEach(deviations(episode), (k) => k, (k) => `robot ${k}`);
  return { id: "phases", title: "Phase errors", unit: "rad", series, summary: "largest", least: -0.1, most: 0.1 };
}

function distances(episode) {
  const { sensing, radius, links } = episode.about;
  const series = ofEach(ringDistances(episode), (k) => links[k][0], (k) => links[k].join("–"));
  const bounds = [
    [2 * sensing, "2 r_s (discs part)", "var(--failed)"],
    [2 * radius, "2 r (collision)", "var(--touch)"],
  ];
  return { id: "distances", title: "Ring distances", unit: "m", series, bounds, summary: "largest", least: 0 };
}

function seen(episode) {
  const { appeared, detected } = detections(episode);
  const series = [
    { label: "entered", values: appeared, colour: "var(--muted)", dashed: true, whole: true },
    { label: "detected", values: detected, colour: "var(--found)", filled: true, whole: true },
  ];
  return { id: "detections", title: "Detections", unit: "targets", series, stepped: true, least: 0 };
}

function sightings(episode) {
  const { seen, there } = inSight(episode);
  const series = [
    { label: "in the rectangle", values: there, colour: "var(--muted)", dashed: true, whole: true },
    { label: "in sight", values: seen, colour: "var(--found)", filled: true, whole: true },
  ];
  return { id: "sightings", title: "Targets in sight", unit: "targets", series, stepped: true, least: 0 };
}

function ages(episode, title, name, colour) {
  const [worst, mean] = episode.ground[name];
  const series = [
    { label: "worst case", values: worst, colour: `var(--${colour})`, filled: true },
    { label: "mean", values: mean, colour: "var(--muted)", dashed: true },
  ];
  const bounds = [[episode.about.bound, episode.about.bound_name, "var(--failed)"]];
  return { id: "age", title, unit: "s", series, bounds, least: 0 };
}

function collisions(episode) {
  const values = episode.raw.collisions,
    series = [{ label: "collisions", values, colour: "var(--touch)", counted: true, stepped: true, whole: true }];
  const nearest = separations(episode),
    bounds = nearest ? [[2 * episode.about.radius, "2 r (collision)", "var(--touch)"]] : [];
  if (nearest) series.push({ label: "smallest distance [m]", values: nearest, colour: "var(--sensing)" });
  return { id: "collisions", title: "Collisions", unit: "", series, bounds, least: 0 };
}

function rewards(episode) {
  const { used, all } = returns(episode);
  const terms = used.map(({ name, values }, k) => {
    return { label: name, values, colour: robotColour(k), dashed: k >= ROBOT_COLOURS };
  });
  const series = [{ label: "all", values: all, colour: "var(--ink)" }, ...terms];
  return { id: "reward", title: "Return by its terms", unit: "per robot", series };
}

// Return a line per row in the colour of its robot, or for a crowd the smallest, the mean and the largest.
function ofEach(rows, robotOf, labelOf) {
  if (rows.length <= MOST_LINES) {
    return rows.map((values, k) => {
      const robot = robotOf(k);
      return { label: labelOf(k), values, colour: robotColour(robot), robot };
    });
  }
  const there = (f) => rows.map((row) => row[f]).filter((value) => value !== null);
  const of = (pick) => Array.from(rows[0], (_, f) => (there(f).length ? pick(there(f)) : null));
  const mean = (all) => all.reduce((sum, value) => sum + value, 0) / all.length;
  return [
    { label: "largest", values: of((all) => Math.max(...all)), colour: robotColour(3) },
    { label: "mean", values: of(mean), colour: "var(--muted)" },
    { label: "smallest", values: of((all) => Math.min(...all)), colour: robotColour(0) },
  ];
}
