// A scenario: its policies with their distributions, the best score first, and the score against collisions.

import { chip } from "./episodes.js";
import { Plot } from "./plot.js";
import { scaleOf } from "./scales.js";
import { episodesStrip, stripAxis } from "./strips.js";
import { coloured, markOf, svg } from "./svg.js";
import { cell, facts, fill, heading, reading, rowName, sortable } from "./tables.js";
import { byId, element, number } from "./words.js";

export function scenarioSection(report, scenario, s, onPick) {
  const box = byId("scenario").content.firstElementChild.cloneNode(true);
  box.id = `scenario-${s}`;
  box.querySelector("h2").textContent = scenario.name;
  box.querySelector(".about").textContent = scenario.description;
  box.querySelector(".scroll").setAttribute("aria-label", `Policies on ${scenario.name}`);
  box.querySelector(".facts-row").append(...facts(scenario.facts));
  fillPolicies(report, scenario, s, box.querySelector("table"));
  box.querySelector(".scroll").after(...scenario.notes.map((words) => element("p", "muted note", words)));
  const shown = scenario.tradeoff.map((column) => scenario.measures.find((measure) => measure.column === column));
  if (shown.every((measure) => measure)) box.querySelector(".plots").append(tradeoff(report, scenario, ...shown));
  box.addEventListener("click", (event) => {
    const dot = event.target.closest("[data-episode]");
    if (dot) onPick(Number(dot.dataset.episode));
  });
  light(box);
  return box;
}

// Highlight the hovered policy in the whole section.
function light(box) {
  const turn = (policy) => {
    box.classList.toggle("lit", policy !== undefined);
    for (const part of box.querySelectorAll("[data-policy]")) part.classList.toggle("on", part.dataset.policy === policy);
  };
  box.addEventListener("pointerover", (event) => turn(event.target.closest("[data-policy]")?.dataset.policy));
  box.addEventListener("pointerleave", () => turn(undefined));
}

function dotsOf(report, s, p, column) {
  const { episodes } = report,
    dots = [];
  episodes.scenario.forEach((scenario, k) => {
    if (scenario === s && episodes.policy[k] === p && episodes[column][k] !== null) dots.push([episodes[column][k], k]);
  });
  return dots;
}

function fillPolicies(report, scenario, s, table) {
  const columns = scenario.measures.map((measure) => {
    const values = scenario.policies.flatMap((policy) => policy.cells[measure.column].quartiles || []);
    return { measure, scale: scaleOf(values, measure.lines, measure.whole ? 1 : 0) };
  });
  const top = columns.map(({ measure, scale }) => {
    const head = heading(measure.title, measure.strip ? "wide" : "", measure.about);
    const named = measure.lines
      .filter(([value]) => scale.holds(value))
      .map(([value, words]) => `${words} ${number(value)}`);
    head.append(...(measure.strip ? [stripAxis(scale)] : []), element("small", "", named.join(" · ")));
    return head;
  });
  const body = scenario.policies.map((policy, place) => {
    const name = rowName(report.policies[policy.policy], failuresOf(report, policy)),
      row = element("tr", "", name, ...columns.map((column) => measured(report, s, policy, column)));
    row.dataset.policy = policy.policy;
    row.dataset.place = place;
    name.dataset.value = place;
    return row;
  });
  fill(table, [heading("policy"), ...top], body);
  sortable(table);
}

function failuresOf(report, policy) {
  const chips = report.kinds.map((kind, k) =>
    policy.failed[k] ? chip(kind, `${kind.words} ${policy.failed[k]}/${policy.episodes}`) : "",
  );
  return element("span", "row chips", ...chips);
}

function measured(report, s, policy, { measure, scale }) {
  const of = policy.cells[measure.column],
    look = report.policies[policy.policy];
  const words = reading(of, policy.episodes);
  const value = of.value !== null && of.words.startsWith(">") ? Number.MAX_VALUE : of.value;
  const part = cell(measure.strip ? "wide" : "", value, words);
  if (measure.strip) {
    const dots = dotsOf(report, s, policy.policy, measure.column);
    part.append(episodesStrip(look, of, measure, scale, dots));
  }
  return part;
}

// A plot of two columns, one against the other.
function tradeoff(report, scenario, across, up) {
  const of = (policy, measure) => policy.cells[measure.column],
    shown = scenario.policies.filter((policy) => of(policy, across).value !== null);
  const ends = (measure) => shown.flatMap((policy) => [of(policy, measure).value, ...of(policy, measure).interval]);
  const { lines, title } = across,
    axes = { x: { scale: scaleOf(ends(across), lines), title, lines }, y: { scale: scaleOf(ends(up), [], 1) } };
  const box = element("div"),
    name = "Score against collisions",
    about = ` ${up.title} per episode; bars: 95 % intervals`;
  new Plot(box, name, axes, (plot) => {
    for (const policy of shown) {
      const [x, y] = [of(policy, across), of(policy, up)],
        look = report.policies[policy.policy];
      const group = svg("g", { "data-policy": policy.policy, class: "series" }, svg("title", {}, look.name));
      const whisker = (x1, x2, y1, y2) => group.append(svg("line", { x1, x2, y1, y2, class: "whisker", ...coloured(look) }));
      const [left, top] = [plot.x(x.value), plot.y(y.value)];
      if (x.interval[0] !== null) whisker(plot.x(x.interval[0]), plot.x(x.interval[1]), top, top);
      if (y.interval[0] !== null) whisker(left, left, plot.y(y.interval[0]), plot.y(y.interval[1]));
      group.append(svg("g", { transform: `translate(${left.toFixed(1)} ${top.toFixed(1)})` }, markOf(look)));
      plot.picture.append(group);
    }
  });
  return element("figure", "figure", element("figcaption", "muted", element("b", "", name), about), box);
}

