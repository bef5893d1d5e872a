// Ranking: mean ranks over the scenarios of a kind of robots, and the scores that are comparable between scenarios.

import { isNarrow } from "./folding.js";
import { sortable } from "./sorting.js";
import { badge, svg } from "./svg.js";
import { element } from "./words.js";

export function showRankings(report) {
  const box = document.getElementById("rankings");
  for (const ranking of report.rankings) box.append(rankingOf(report, ranking));
  document.getElementById("ranking").hidden = report.rankings.length === 0;
}

function rankingOf(report, ranking) {
  const box = element("div", "ranking"),
    names = ranking.scenarios.map((s) => report.scenarios[s].name);
  box.append(element("h3", "", `Among ${ranking.kind}: ${names.join(", ")}`));
  box.append(scrolling(`Mean ranks of ${ranking.kind}`, ranksOf(report, ranking)));
  if (ranking.policies.some((policy) => policy.overall.length)) {
    const more = element("details", "more-of");
    more.open = !isNarrow();
    more.append(element("summary", "", "All episodes of these scenarios together"));
    more.append(scrolling(`Scores of ${ranking.kind} over all scenarios`, togetherOf(report, ranking)));
    box.append(more);
  }
  return box;
}

function ranksOf(report, ranking) {
  const titles = ["all of these", ...ranking.columns.map((column) => column.title)];
  const table = element("table", "ranks"),
    body = element("tbody");
  table.append(titleRow(["policy", ...titles]), body);
  for (const [place, of] of ranking.policies.entries()) {
    const row = element("tr"),
      name = element("th");
    name.scope = "row";
    name.dataset.value = place;
    name.append(badge(report.policies[of.policy]));
    row.append(name);
    for (const [k, [mean, low, high]] of of.ranks.entries()) {
      const cell = element("td"),
        line = element("span", "reading");
      cell.dataset.value = mean;
      cell.dataset.title = titles[k];
      line.append(element("b", mean === leastRank(ranking, k) ? "best" : "", mean.toFixed(1)));
      if (low !== null && low.toFixed(1) !== high.toFixed(1))
        line.append(element("small", "", `${low.toFixed(1)}–${high.toFixed(1)}`));
      cell.append(line, interval(report.policies[of.policy], [mean, low, high], 1, ranking.policies.length));
      row.append(cell);
    }
    body.append(row);
  }
  sortable(table);
  return table;
}

function leastRank(ranking, k) {
  return Math.min(...ranking.policies.map((of) => of.ranks[k][0]));
}

function togetherOf(report, ranking) {
  const table = element("table", "together"),
    body = element("tbody");
  table.append(titleRow(["policy", ...ranking.measures.map((measure) => measure.title)]), body);
  for (const of of ranking.policies) {
    const row = element("tr"),
      name = element("th");
    name.scope = "row";
    name.append(badge(report.policies[of.policy]));
    row.append(name);
    for (const [k, [words, between]] of of.overall.entries()) {
      const cell = element("td"),
        line = element("span", "reading");
      cell.title = ranking.measures[k].about;
      cell.dataset.value = Number.parseFloat(words);
      line.append(element("b", "", words));
      if (between) line.append(element("small", "", between));
      cell.append(line);
      row.append(cell);
    }
    body.append(row);
  }
  sortable(table);
  return table;
}

function titleRow(titles) {
  const made = element("thead"),
    row = element("tr");
  for (const words of titles) {
    const cell = element("th"),
      button = element("button", "sort", words);
    button.type = "button";
    cell.scope = "col";
    cell.append(button);
    row.append(cell);
  }
  made.append(row);
  return made;
}

// Draw a mean and its interval on a line from `least` to `most`, optionally with a mark in the middle.
export function interval(policy, [mean, low, high], least, most, middle = null) {
  const at = (value) => `${(3 + (94 * (value - least)) / (most - least || 1)).toFixed(2)}%`;
  const picture = svg("svg", { class: "strip", height: 12, width: "100%", "aria-hidden": "true" });
  picture.append(svg("line", { x1: "3%", x2: "97%", y1: 6, y2: 6, class: "grid" }));
  if (middle !== null) picture.append(svg("line", { x1: at(middle), x2: at(middle), y1: 0, y2: 12, class: "limit" }));
  if (low !== null) {
    picture.append(svg("line", { x1: at(low), x2: at(high), y1: 6, y2: 6, class: `range c${policy.colour}` }));
  }
  if (mean !== null) picture.append(svg("circle", { cx: at(mean), cy: 6, r: 3.2, class: `spot c${policy.colour}` }));
  return picture;
}

export function scrolling(words, table) {
  const box = element("div", "scroll");
  box.tabIndex = 0;
  box.setAttribute("role", "region");
  box.setAttribute("aria-label", words);
  box.append(table);
  return box;
}
