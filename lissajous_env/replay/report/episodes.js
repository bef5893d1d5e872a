// The table of all episodes, which can be sorted and filtered; some have a replay.

import { badge } from "./svg.js";
import { fill, heading, heads, ordered } from "./tables.js";
import { button, byId, element, number } from "./words.js";

const FIRST = 50;
const MORE = 250;
const FILTERS = { scenario: "of-scenario", policy: "of-policy", kind: "of-kind" };

export class Episodes {
  constructor(report, onReplay) {
    Object.assign(this, { report, onReplay, most: FIRST, down: true, order: "" });
    this.columns = report.columns.filter(
      ({ name, listed }) => listed && report.episodes[name].some((value) => value !== null),
    );
    this.replays = new Map(Object.entries(report.replays).map(([name, [s, p, seed]]) => [`${s} ${p} ${seed}`, name]));
    this.choose(FILTERS.scenario, report.scenarios.map((scenario) => scenario.name));
    this.choose(FILTERS.policy, report.policies.map((policy) => policy.name));
    this.choose(FILTERS.kind, report.kinds.map((kind) => kind.words));
    byId("more").addEventListener("click", () => this.fill(this.most + MORE));
    this.fill();
  }

  choose(name, words) {
    byId(name).append(new Option("all", ""), ...words.map((name, k) => new Option(name, String(k))));
    byId(name).addEventListener("change", () => this.fill());
  }

  // Filter by scenario, policy and kind of failure (indices in the data); omitted ones match all.
  narrow(wanted) {
    for (const [name, id] of Object.entries(FILTERS)) byId(id).value = String(wanted[name] ?? "");
    this.order = "";
    this.fill();
    byId("episodes").scrollIntoView({ block: "start" });
  }

  // Return the indices of the listed episodes, in order; by default the worst are first.
  places() {
    const { episodes } = this.report,
      [s, p, kind] = Object.values(FILTERS).map((id) => byId(id).value);
    const wanted = (k) =>
      (s === "" || episodes.scenario[k] === Number(s)) &&
      (p === "" || episodes.policy[k] === Number(p)) &&
      (kind === "" || episodes.failed[k] & (1 << Number(kind)));
    const places = [...episodes.seed.keys()].filter(wanted),
      values = this.order && episodes[this.order];
    return values ? places.sort((a, b) => ordered(values[a], values[b], this.down) || a - b) : places;
  }

  fill(most = FIRST) {
    this.most = most;
    const places = this.places(),
      { total } = this.report,
      count = this.report.episodes.seed.length;
    fill(byId("list"), this.head(), places.slice(0, most).map((k) => this.row(k)));
    const listed = total > count ? ` listed, the worst of ${total.toLocaleString("en")}` : "";
    byId("found").textContent = `${places.length.toLocaleString("en")} episode${places.length === 1 ? "" : "s"}${listed}`;
    byId("more").hidden = places.length <= most;
    byId("more").textContent = `Show more of ${(places.length - most).toLocaleString("en")}`;
  }

  head() {
    const sorters = this.columns.map(({ name, title }) => {
      const head = heading(title, "number");
      head.firstChild.dataset.column = name;
      if (name === this.order) head.setAttribute("aria-sort", this.down ? "descending" : "ascending");
      head.firstChild.addEventListener("click", () => {
        this.down = name !== this.order || !this.down;
        this.order = name;
        this.fill();
      });
      return head;
    });
    return [...heads("scenario", "policy", "seed", "failed"), ...sorters, ...heads("replay")];
  }

  row(k) {
    const { report } = this,
      { episodes } = report;
    const scenario = report.scenarios[episodes.scenario[k]],
      policy = report.policies[episodes.policy[k]];
    const kinds = report.kinds.filter((_, bit) => episodes.failed[k] & (1 << bit)).map((kind) => chip(kind, kind.words));
    const values = this.columns.map(({ name, whole, open }) => {
      const value = episodes[name][k],
        words = value === null ? "–" : whole ? String(value) : number(value);
      return element("td", "number", open && episodes[open][k] === 1 ? `> ${words}` : words);
    });
    return element(
      "tr",
      "",
      element("td", "name", scenario.name),
      element("td", "name", badge(policy)),
      element("td", "number", String(episodes.seed[k])),
      element("td", "chips", ...kinds),
      ...values,
      element("td", "actions", ...this.actions(k)),
    );
  }

  // Return the id of the replay of an episode, if there is one.
  replayOf(k) {
    const { scenario, policy, seed } = this.report.episodes;
    return this.replays.get(`${scenario[k]} ${policy[k]} ${seed[k]}`);
  }

  actions(k) {
    const replay = this.replayOf(k);
    if (!replay) return [];
    const play = button("play", "Replay", () => this.onReplay(replay));
    play.dataset.replay = replay;
    return [play];
  }
}

// A kind of failure as a coloured word.
export function chip(kind, words) {
  return Object.assign(element("span", `kind ${kind.name}`, words), { title: kind.about });
}
