// Comparison of the policies of a scenario with the reference on the same seeds.

import { interval, scrolling } from "./ranking.js";
import { badge } from "./svg.js";
import { element } from "./words.js";

export function comparison(report, scenario) {
  const box = element("details", "more-of against");
  const reference = report.policies[scenario.reference];
  box.append(element("summary", "", `Seed by seed against ${reference.shown}`));
  box.append(scrolling(`Policies on ${scenario.name} against ${reference.shown}`, pairsOf(report, scenario)));
  box.append(
    element(
      "p",
      "note",
      "Better: share of seeds on which the policy beats the reference; ties count half; the dashed line is one half. " +
        "Difference: interquartile mean of the policy minus that of the reference. Intervals: 95 % bootstrap over seeds.",
    ),
  );
  return box;
}

function pairsOf(report, scenario) {
  const table = element("table", "pairs"),
    head = element("thead"),
    body = element("tbody"),
    top = element("tr");
  top.append(element("th", "", "policy"));
  for (const { title } of scenario.against.columns)
    top.append(element("th", "wide", `${title}: better`), element("th", "", "difference"));
  for (const cell of top.cells) cell.scope = "col";
  head.append(top);
  for (const { policy, pairs: of } of scenario.against.policies) {
    const row = element("tr"),
      name = element("th"),
      look = report.policies[policy];
    row.dataset.policy = policy;
    name.scope = "row";
    name.append(badge(look));
    row.append(name);
    of.forEach((pair, k) => {
      const { title } = scenario.against.columns[k],
        share = element("td", "wide"),
        off = element("td");
      share.dataset.title = `${title}: better`;
      off.dataset.title = "difference";
      if (pair.n) share.append(reading(pair.share, pair.shares), interval(look, pair.better, 0, 1, 0.5));
      off.append(reading(pair.difference, pair.differences));
      row.append(share, off);
    });
    body.append(row);
  }
  table.append(head, body);
  return table;
}

function reading(words, between) {
  const line = element("span", "reading");
  line.append(element("b", "", words));
  if (between) line.append(element("small", "", between));
  return line;
}
