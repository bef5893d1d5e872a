// Observation and action of the selected robot at the current moment; the score of the episode if none is selected.

import { REMOVED, FAILED } from "./episode.js";
import { decimals, element, number, rounded } from "./words.js";

const STATUS = { 0: "works", [FAILED]: "failed", [REMOVED]: "removed" };
const NOT_SCORED = ["episode", "seed"];

export class Inspector {
  constructor(box, episode) {
    Object.assign(this, { box, episode, robot: -1 });
  }

  select(robot) {
    this.robot = robot;
    this.cells = [];
    this.moment = -1;
    this.box.replaceChildren(...(robot < 0 ? this.scores() : this.values(robot)));
  }

  scores() {
    const words = "Select a robot in the picture, or press R for the next one, to see its observation and action at this moment.";
    const rows = Object.entries(this.episode.raw.score)
      .filter(([name, value]) => typeof value === "number" && !NOT_SCORED.includes(name))
      .map(([name, value]) =>
        element("tr", "", element("td", "entry", name.replaceAll("_", " ")), element("td", "value", rounded(value))),
      );
    return [element("p", "muted", words), section("Score of the episode", rows)];
  }

  values(robot) {
    const { about, robots } = this.episode,
      row = robot * this.episode.moments;
    const facts = element("dl", "facts");
    const fact = (name, wordsAt) => {
      const value = element("dd");
      facts.append(element("dt", "", name), value);
      this.cells.push((moment) => value.replaceChildren(wordsAt(row + moment)));
    };
    fact("status", (k) => STATUS[robots.status[k]]);
    fact("speed", (k) => `${number(robots.speed[k])} m/s`);
    fact("reward of this step", (k) => number(robots.reward[k]));
    const head = element("h3", "", `Robot ${robot}`);
    if (robot >= robots.watched) {
      const words = "Observations of this robot are omitted to limit the size of the page; a replay of this episode alone has them.";
      return [head, facts, element("p", "muted", words)];
    }
    const rows = (names, columns, indexed) =>
      names.map((name, k) => this.row(indexed ? String(k) : "", name.replaceAll("_", " "), columns[k], row));
    return [
      head,
      facts,
      section("Action", rows(about.actions, robots.action, false)),
      section("Observation", rows(robots.names, robots.observation, true)),
    ];
  }

  // A row of index, name, value and a bar of [-1, 1].
  row(index, name, values, first) {
    const value = element("td", "value"),
      bar = element("i");
    this.cells.push((moment) => {
      const now = values[first + moment],
        shown = Math.max(Math.min(now, 1), -1);
      value.textContent = Math.abs(now) < 5e4 ? decimals(now, 3) : now.toExponential(1);
      bar.style.transform = `translateX(${shown < 0 ? 50 + 50 * shown : 50}%) scaleX(${Math.abs(shown) / 2})`;
    });
    return element("tr", "", element("td", "index", index), element("td", "entry", name), value, element("td", "bar", bar));
  }

  move(time) {
    const { moment } = this.episode.at(time);
    if (moment === this.moment) return;
    this.moment = moment;
    for (const fill of this.cells) fill(moment);
  }
}

function section(title, rows) {
  return element("section", "rows", element("h3", "", title), element("table", "", ...rows));
}
