// Comparison of the policies of a scenario with the reference on the same seeds.

import { interval } from "./strips.js";
import { heads, reading, rowName, scrolling, table } from "./tables.js";
import { element } from "./words.js";

const NOTE =
  "Better: share of seeds on which the policy beats the reference; ties count half; the dashed line is one half. " +
  "Difference: interquartile mean of the policy minus that of the reference; of guarantees, the largest values. " +
  "Intervals: 95 % bootstrap over seeds.";

export function comparison(report, scenario) {
  const { name } = report.policies[scenario.reference];
  return element(
    "details",
    "more-of against",
    element("summary", "", `Seed by seed against ${name}`),
    scrolling(`Policies on ${scenario.name} against ${name}`, pairsOf(report, scenario)),
    element("p", "muted note", NOTE),
  );
}

function pairsOf(report, scenario) {
  const { columns, policies } = scenario.against;
  const top = columns.flatMap(({ title }) => [
    element("th", "wide", `${title}: better`),
    element("th", "", "difference"),
  ]);
  const rows = policies.map(({ policy, pairs }) => {
    const look = report.policies[policy];
    const cells = pairs.flatMap((pair) => [
      element("td", "wide", ...(pair.n ? share(look, pair) : [])),
      element("td", "", reading(pair.difference, pair.differences)),
    ]);
    const row = element("tr", "", rowName(look), ...cells);
    row.dataset.policy = policy;
    return row;
  });
  return table("pairs", [...heads("policy"), ...top], rows);
}

function share(look, pair) {
  return [reading(pair.share, pair.shares), interval(look, pair.better, 0, 1, 0.5)];
}
