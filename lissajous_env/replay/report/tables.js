// Tables of a report: headings, names of policies, readings with their intervals, and sorting by a click on a heading.

import { badge } from "./svg.js";
import { button, element } from "./words.js";

// Fill a table with the cells of its heading and its rows.
export function fill(table, heads, rows) {
  for (const cell of heads) cell.scope = "col";
  table.replaceChildren(element("thead", "", element("tr", "", ...heads)), element("tbody", "", ...rows));
  return table;
}

export const heads = (...titles) => titles.map((words) => element("th", "", words));

// A heading that sorts.
export function heading(words, name = "", title = "") {
  return Object.assign(element("th", name, button("sort", words)), { title });
}

// The heading of a row: the name of a policy.
export function rowName(policy, ...more) {
  return Object.assign(element("th", "", badge(policy), ...more), { scope: "row" });
}

// A cell; sorting compares the value.
export function cell(name, value, ...content) {
  const part = element("td", name, ...content);
  if (value !== null) part.dataset.value = value;
  return part;
}

// An estimate in words with its interval and, if not all of `count` have a number, how many do; the best one is marked.
export function reading({ words, between, known, best }, count) {
  const value = Object.assign(element("b", best ? "best" : "", words), { title: best ? "the best of the column" : "" });
  const some = known && known < count ? `(${known}/${count})` : "";
  return element("span", "row reading", value, ...[between, some].map((part) => part && element("small", "muted", part)));
}

// A table that scrolls sideways.
export function scrolling(words, table) {
  const box = element("div", "scroll", table);
  box.tabIndex = 0;
  box.setAttribute("role", "region");
  box.setAttribute("aria-label", words);
  return box;
}

// Entries of a list of names and values.
export function facts(pairs) {
  return pairs.map(([name, words]) => element("div", "", element("dt", "", name), element("dd", "", words)));
}

// Sort a table by a click on a heading, by `data-value` of the cells, missing values last.
export function sortable(table) {
  const all = [...table.tHead.rows[0].cells];
  all.forEach((head, column) => {
    head.querySelector("button")?.addEventListener("click", () => {
      const down = head.getAttribute("aria-sort") === "ascending";
      for (const other of all) other.removeAttribute("aria-sort");
      head.setAttribute("aria-sort", down ? "descending" : "ascending");
      const value = (row) => row.cells[column].dataset.value;
      const rows = [...table.tBodies[0].rows].sort((a, b) => ordered(value(a), value(b), down));
      table.tBodies[0].append(...rows);
    });
  });
  return table;
}

// Compare two values; missing ones come last.
export function ordered(a, b, down) {
  const none = (value) => value === undefined || value === null;
  if (none(a) || none(b)) return Number(none(a)) - Number(none(b));
  return down ? Number(b) - Number(a) : Number(a) - Number(b);
}
