// Estimates over all scenarios of a kind of robots.

import { cell, fill, heading, reading, rowName, scrolling, sortable } from "./tables.js";
import { byId, element } from "./words.js";

export function showOverall(report) {
  for (const overall of report.overall) {
    const words = `Among ${overall.kind}: ${overall.scenarios.join(", ")}`;
    byId("overalls").append(element("div", "", element("h3", "", words), scrolling(words, tableOf(report, overall))));
  }
  byId("overall").hidden = report.overall.length === 0;
}

function tableOf(report, { scenarios, measures, policies }) {
  const rows = policies.map((of, place) => {
    const name = rowName(report.policies[of.policy]);
    name.dataset.value = place;
    const cells = measures.map(({ column }) => {
      const { words, value } = of.cells[column];
      return cell("", words.startsWith(">") ? Number.MAX_VALUE : value, reading(of.cells[column], scenarios.length));
    });
    return element("tr", "", name, ...cells);
  });
  const heads = measures.map(({ title, about }) => heading(title, "", about));
  return sortable(fill(element("table", "together"), [heading("policy"), ...heads], rows));
}
