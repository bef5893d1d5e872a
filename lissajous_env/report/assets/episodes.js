// The table of all episodes, which can be sorted and filtered; some have a replay.

import { reveal } from "./folding.js";
import { badge } from "./svg.js";
import { fill, heading, heads, ordered } from "./tables.js";
import { button, byId, element, number } from "./words.js";

const FIRST = 50;
const MORE = 250;

export class Episodes {
  constructor(report, onReplay) {
    Object.assign(this, { report, onReplay, most: FIRST, down: true, order: "" });
    const { scenario } = report.episodes;
    this.count = scenario.length;
    this.columns = new Map(report.columns.map((column) => [column.name, column]));
    this.shown = report.columns
      .filter(({ name, listed }) => listed && report.episodes[name].some((value) => value !== null))
      .map(({ name }) => name);
    this.replayOf = new Map(Object.entries(report.replays).map(([name, [s, p, seed]]) => [`${s} ${p} ${seed}`, name]));
    this.choose(
      "of-scenario",
      report.scenarios.map((each) => each.name),
    );
    this.choose(
      "of-policy",
      report.policies.map((each) => each.name),
    );
    this.choose(
      "of-kind",
      report.kinds.map((each) => each.words),
    );
    this.orders();
    byId("more").addEventListener("click", () => {
      this.most += MORE;
      this.fill();
    });
    this.fill();
  }

  choose(name, words) {
    byId(name).append(new Option("all", ""), ...words.map((each, k) => new Option(each, String(k))));
    byId(name).addEventListener("change", () => {
      this.most = FIRST;
      this.fill();
    });
  }

  orders() {
    const known = this.report.columns.filter(({ name }) => this.report.episodes[name].some((value) => value !== null));
    byId("order").append(
      new Option("worst first", ""),
      ...known.flatMap(({ name, title }) => [
        new Option(`${title}, most first`, `-${name}`),
        new Option(`${title}, least first`, `+${name}`),
      ]),
    );
    byId("order").addEventListener("change", (event) =>
      this.sort(event.target.value.slice(1), event.target.value.startsWith("-")),
    );
  }

  sort(order, down) {
    Object.assign(this, { order, down, most: FIRST });
    byId("order").value = order ? `${down ? "-" : "+"}${order}` : "";
    this.fill();
  }

  // Filter by scenario, policy and kind of failure (indices in the data); omitted ones match all.
  narrow({ scenario = "", policy = "", kind = "" }) {
    byId("of-scenario").value = String(scenario);
    byId("of-policy").value = String(policy);
    byId("of-kind").value = String(kind);
    this.sort("", true);
    reveal(byId("episodes"));
  }

  // Return the indices of the listed episodes, in order.
  places() {
    const { episodes } = this.report,
      wanted = (name) => byId(name).value;
    const [s, p, kind] = ["of-scenario", "of-policy", "of-kind"].map(wanted);
    const found = [];
    for (let k = 0; k < this.count; k++) {
      if (s !== "" && episodes.scenario[k] !== Number(s)) continue;
      if (p !== "" && episodes.policy[k] !== Number(p)) continue;
      if (kind !== "" && !(episodes.failed[k] & (1 << Number(kind)))) continue;
      found.push(k);
    }
    const values = this.order && episodes[this.order];
    return values ? found.sort((a, b) => ordered(values[a], values[b], this.down) || a - b) : found;
  }

  fill() {
    const places = this.places();
    const columns = this.order && !this.shown.includes(this.order) ? [this.order, ...this.shown] : this.shown;
    const rows = places.slice(0, this.most).map((k) => this.row(k, columns));
    fill(byId("list"), this.head(columns), rows);
    const listed =
      this.report.total > this.count ? ` listed, the worst of ${this.report.total.toLocaleString("en")}` : "";
    byId("found").textContent = `${places.length.toLocaleString("en")} episodes${listed}`;
    byId("more").hidden = places.length <= this.most;
    byId("more").textContent =
      `Show ${Math.min(MORE, places.length - this.most)} more of ${(places.length - this.most).toLocaleString("en")}`;
  }

  head(columns) {
    const sorters = columns.map((name) => {
      const made = heading(this.columns.get(name).title, "number");
      made.firstChild.dataset.column = name;
      if (name === this.order) made.setAttribute("aria-sort", this.down ? "descending" : "ascending");
      made.firstChild.addEventListener("click", () => this.sort(name, name !== this.order || !this.down));
      return made;
    });
    return [...heads("scenario", "policy", "seed", "failed"), ...sorters, ...heads("")];
  }

  row(k, columns) {
    const { report } = this,
      { episodes } = report;
    const scenario = report.scenarios[episodes.scenario[k]],
      policy = report.policies[episodes.policy[k]];
    const kinds = report.kinds.filter((_, bit) => episodes.failed[k] & (1 << bit)).map((kind) => chip(kind, kind.words));
    const values = columns.map((column) => {
      const { name, whole, open } = this.columns.get(column),
        value = episodes[name][k];
      const words = value === null ? "–" : whole ? String(value) : number(value);
      return element("td", "number", open && episodes[open][k] === 1 ? `> ${words}` : words);
    });
    const row = element(
      "tr",
      "",
      element("td", "name", scenario.name),
      element("td", "name", badge(policy)),
      element("td", "number", String(episodes.seed[k])),
      element("td", "chips", ...kinds),
      ...values,
      this.actions(k),
    );
    row.dataset.place = k;
    return row;
  }

  actions(k) {
    const made = element("td", "actions"),
      { episodes } = this.report;
    const replay = this.replayOf.get(`${episodes.scenario[k]} ${episodes.policy[k]} ${episodes.seed[k]}`);
    if (replay) {
      made.append(button("play", "Replay", () => this.onReplay(replay)));
      made.firstChild.dataset.replay = replay;
    }
    return made;
  }
}

// A kind of failure as a coloured word.
export function chip(kind, words) {
  const made = element("span", `kind ${kind.name}`, words);
  made.title = kind.about;
  return made;
}
