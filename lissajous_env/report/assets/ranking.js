// Ranking: mean ranks over the scenarios of a kind of robots, and the scores that are comparable between scenarios.

import { interval } from "./strips.js";
import { cell, heading, reading, rowName, scrolling, sortable, table } from "./tables.js";
import { byId, element } from "./words.js";

export function showRankings(report) {
  const box = byId("rankings");
  for (const ranking of report.rankings) box.append(rankingOf(report, ranking));
  byId("ranking").hidden = report.rankings.length === 0;
}

function rankingOf(report, ranking) {
  const names = ranking.scenarios.map((s) => report.scenarios[s].name);
  const box = element("div", "ranking", element("h3", "", `Among ${ranking.kind}: ${names.join(", ")}`));
  box.append(scrolling(`Mean ranks of ${ranking.kind}`, ranksOf(report, ranking)));
  if (ranking.policies.some((policy) => policy.overall.length)) {
    const all = scrolling(`Scores of ${ranking.kind} over all scenarios`, togetherOf(report, ranking));
    const more = element("details", "more-of", element("summary", "", "All episodes of these scenarios together"), all);
    more.open = true;
    box.append(more);
  }
  return box;
}

function ranksOf(report, ranking) {
  const titles = ["all of these", ...ranking.columns.map((column) => column.title)];
  const rows = ranking.policies.map((of, place) => {
    const look = report.policies[of.policy],
      name = rowName(look);
    name.dataset.value = place;
    const cells = of.ranks.map(([mean, low, high], k) => {
      const between = low !== null && low.toFixed(1) !== high.toFixed(1) ? `${low.toFixed(1)}–${high.toFixed(1)}` : "";
      const words = reading(mean.toFixed(1), between, mean === leastRank(ranking, k) ? "best" : "");
      return cell("", mean, words, interval(look, [mean, low, high], 1, ranking.policies.length));
    });
    return element("tr", "", name, ...cells);
  });
  return sortable(table("ranks", sorters(titles), rows));
}

function leastRank(ranking, k) {
  return Math.min(...ranking.policies.map((of) => of.ranks[k][0]));
}

function togetherOf(report, ranking) {
  const rows = ranking.policies.map((of) => {
    const cells = of.overall.map(([words, between, value], k) => {
      const made = element("td", "", reading(words, between));
      made.title = ranking.measures[k].about;
      if (value !== null) made.dataset.value = value;
      return made;
    });
    return element("tr", "", rowName(report.policies[of.policy]), ...cells);
  });
  return sortable(table("together", sorters(ranking.measures.map((measure) => measure.title)), rows));
}

const sorters = (titles) => ["policy", ...titles].map((words) => heading(words));
