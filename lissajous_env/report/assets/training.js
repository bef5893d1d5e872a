// The report of a training: learning curve with other policies, evaluations, and a replay of the latest checkpoint.

import { figure, pictures } from "./figures.js";
import { scaleOf } from "./scales.js";
import { start } from "./start.js";
import { badge, coloured, svg } from "./svg.js";
import { cell, facts, fill, heading, heads, sortable } from "./tables.js";
import { Viewer } from "./viewer.js";
import { byId, element, number } from "./words.js";

const LEARNED = { colour: 0, mark: "o", hollow: false, name: "policy" };

function begin(training) {
  const viewer = new Viewer(training.replays, (id, others) => others[0]);
  const [latest] = Object.keys(training.replays);
  byId("play").hidden = latest === undefined;
  if (latest !== undefined) byId("play").title = training.replays[latest].title;
  byId("play").addEventListener("click", () => viewer.open(latest));
  byId("curve").append(pictures(...training.scores.map((score) => curve(training, score))));
  showLosses(training);
  showLearning(training);
  fillEvaluations(training);
  fillScenarios(training);
  byId("changed").append(element("dl", "", ...facts(training.settings.changed)));
  byId("defaults").append(element("dl", "", ...facts(training.settings.others)));
  byId("defaults-title").textContent = `${training.settings.others.length} settings that have their defaults`;
  globalThis.training = { training, viewer };
}

function curve(training, score) {
  const steps = training.curve.map((point) => point.steps / 1e6),
    values = training.curve.map((point) => point[score.name]);
  const rivals = training.rivals.filter((rival) => rival[score.name] !== null);
  const axes = {
    x: {
      scale: scaleOf(steps),
      title: "steps of a robot [million]",
      lines: [],
    },
    y: { scale: scaleOf([...values, ...rivals.map((rival) => rival[score.name])]), title: "" },
  };
  return figure(score.title, score.about, axes, (plot) => {
    const right = plot.x(axes.x.scale.far);
    const lines = rivals.map((rival) => ({ rival, name: rival.name, y: plot.y(rival[score.name]) }));
    for (const { rival, y } of lines) {
      const look = { class: "curve rival", ...coloured({ colour: colourOf(training, rival) }) };
      plot.add("line", { x1: plot.x(0), x2: right, y1: y, y2: y, ...look });
    }
    plot.path(steps, values, { class: "curve", ...coloured(LEARNED) });
    values.forEach((value, k) => {
      if (value === null) return;
      const dot = plot.add("circle", { cx: plot.x(steps[k]), cy: plot.y(value), r: 3, class: "mark", ...coloured(LEARNED) });
      dot.append(svg("title", {}, `${number(value)} after ${number(steps[k])} million steps`));
    });
    for (const close of closeTogether(lines)) {
      const names = close.map((line) => line.name).join(" · ");
      plot.write(right, close[0].y - 5, names, "end", "limit-name rival-name");
    }
  });
}

const colourOf = (training, rival) => (training.rivals.indexOf(rival) % 6) + 1;

// Lines sorted from the top, in groups within which names at each would overprint one another.
function closeTogether(lines) {
  const groups = [];
  for (const line of [...lines].sort((a, b) => a.y - b.y)) {
    const last = groups.at(-1);
    if (last && line.y - last[0].y < 12) last.push(line);
    else groups.push([line]);
  }
  return groups;
}

function showLosses(training) {
  const lost = Object.entries(training.lost).map(([rival, worse]) => `${rival}: ${worse.join("; ")}`);
  byId("lost").hidden = lost.length === 0;
  byId("lost").append(element("b", "", "The best policy loses to "), lost.join(" · "));
}

function showLearning(training) {
  const told = training.learned.filter((each) => training.learning.some((point) => each.name in point));
  byId("learning-part").hidden = told.length === 0;
  const steps = training.learning.map((point) => point.steps / 1e6);
  const plots = told.map(({ name, title, about, times }) => {
    // The error of an untrained critic is arbitrary.
    const values = training.learning.map((point) => (name in point ? times * Math.max(point[name], lowest(name)) : null));
    const axes = { x: { scale: scaleOf(steps), title: "steps of a robot [million]" }, y: { scale: scaleOf(values), title: "" } };
    return figure(title, about, axes, (plot) => plot.path(steps, values, { class: "curve", ...coloured(LEARNED) }), 200);
  });
  byId("learning").append(pictures(...plots));
}

function lowest(name) {
  return name === "explained_variance" ? -0.5 : -Infinity;
}

function fillEvaluations(training) {
  const titles = ["steps", "time [min]", ...training.scores.map((score) => score.title)];
  const points = [
    ...training.curve.map((point) => [LEARNED, point]).reverse(),
    ...training.rivals.map((rival) => [{ ...LEARNED, colour: colourOf(training, rival), name: rival.name }, rival]),
  ];
  const rows = points.map(([look, point]) => {
    const { steps, seconds } = point,
      isBest = steps !== undefined && steps === training.best;
    return element(
      "tr",
      "",
      element("td", "name", badge(look), isBest ? element("span", "kind best-one", "best") : ""),
      cell("number", steps, steps === undefined ? "" : steps.toLocaleString("en")),
      cell("number", seconds, seconds === undefined ? "" : number(seconds / 60)),
      ...training.scores.map(({ name }) =>
        cell("number", point[name], point[name] === null ? "–" : number(point[name])),
      ),
    );
  });
  fill(byId("evaluations"), [...heads("of"), ...titles.map((title) => heading(title, "number"))], rows);
  sortable(byId("evaluations"));
}

function fillScenarios(training) {
  byId("scenarios-part").hidden = training.scenarios.length === 0;
  if (training.scenarios.length === 0) return;
  const names = [...new Set(training.scenarios.flatMap((scenario) => Object.keys(scenario.policies)))];
  const columns = [
    ...names.map((name) => [name, (of) => of[name]?.detection_time]),
    ["relative", relativeTime],
    ...names.map((name) => [`collisions, ${name}`, (of) => of[name]?.collisions]),
  ];
  const rows = training.scenarios.map(({ name, policies }) =>
    element(
      "tr",
      "",
      element("td", "name", name),
      ...columns.map(([, value]) => cell("number", value(policies), number(value(policies) ?? null))),
    ),
  );
  fill(byId("scenarios"), [...heads("scenario"), ...columns.map(([title]) => heading(title, "number"))], rows);
  sortable(byId("scenarios"));
}

function relativeTime({ policy, ...others }) {
  const times = Object.values(others)
    .map((each) => each.detection_time)
    .filter((time) => time !== null);
  return policy?.detection_time == null || times.length === 0 ? null : policy.detection_time / Math.min(...times);
}

start("lissajous training 1", begin);
