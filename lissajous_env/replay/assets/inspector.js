// Observation and action of one robot at the current moment.

import { robotColour } from "./colours.js";
import { REMOVED, STUCK } from "./episode.js";
import { button, decimals, element, number, rounded } from "./words.js";

const STATUS = { 0: "works", [STUCK]: "failed", [REMOVED]: "removed" };
const MOST_CHIPS = 40;
const NOT_SCORED = ["episode", "seed"];

export class Inspector {
  constructor(box, episode, onPick) {
    Object.assign(this, { box, episode, onPick, robot: -1 });
    this.chips = box.querySelector(".chips");
    this.panel = box.querySelector(".robot");
    this.addChips();
  }

  addChips() {
    for (let i = 0; i < Math.min(this.episode.count, MOST_CHIPS); i++) {
      const chip = button("chip", String(i), () => this.onPick(this.robot === i ? -1 : i));
      chip.setAttribute("aria-label", `Robot ${i}`);
      chip.style.setProperty("--robot", robotColour(i));
      this.chips.append(chip);
    }
  }

  select(robot) {
    this.robot = robot;
    [...this.chips.children].forEach((chip, i) => chip.setAttribute("aria-pressed", String(i === robot)));
    this.cells = [];
    this.shownMoment = -1;
    if (robot < 0) this.invite();
    else this.lay(robot);
  }

  // Without a robot, show the score of the episode.
  invite() {
    const words = "Select a robot, here or in the picture, to see its observation and action at this moment.";
    const scores = Object.entries(this.episode.raw.score)
      .filter(([name, value]) => typeof value === "number" && !NOT_SCORED.includes(name))
      .map(([name, value]) =>
        element("tr", "", element("td", "entry", name.replaceAll("_", " ")), element("td", "value", rounded(value))),
      );
    this.panel.replaceChildren(element("p", "muted", words), section("Score of the episode", scores));
  }

  lay(robot) {
    const { robots } = this.episode.raw;
    const facts = element("dl", "facts");
    for (const name of ["status", "speed", "reward of this step"]) this.fact(facts, name, robot);
    const parts = [facts];
    if (robot < robots.watched) {
      parts.push(this.table("Action", this.episode.about.actions, this.episode.robots.action, robot, false));
      parts.push(this.table("Observation", robots.names, this.episode.robots.observation, robot, true));
    } else {
      const words =
        "Observations of this robot are omitted to limit the size of the page; a replay of this episode alone has them.";
      parts.push(element("p", "muted", words));
    }
    this.panel.replaceChildren(...parts);
  }

  fact(list, name, robot) {
    const value = element("dd");
    list.append(element("dt", "", name), value);
    const { robots } = this.episode,
      row = robot * this.episode.moments;
    this.cells.push((moment) => {
      const status = robots.status[row + moment];
      if (name === "status") value.textContent = STATUS[status];
      else if (name === "speed") value.textContent = `${number(robots.speed[row + moment])} m/s`;
      else value.textContent = number(robots.reward[row + moment]);
    });
  }

  // Rows of index, name, value and a bar of [-1, 1], grouped by neighbour, robot or target.
  table(title, names, columns, robot, indexed) {
    const rows = [];
    let group = null;
    names.forEach((name, k) => {
      const [of, rest] = parted(name);
      if (indexed && of !== group) {
        group = of;
        const head = element("th", "", of);
        head.colSpan = 4;
        rows.push(element("tr", "group", head));
      }
      rows.push(this.row(indexed ? String(k) : "", indexed ? rest : name, columns[k], robot));
    });
    return section(title, rows);
  }

  row(index, name, values, robot) {
    const value = element("td", "value"),
      bar = element("i");
    const names = [element("td", "index", index), element("td", "entry", name)];
    const row = element("tr", "", ...names, value, element("td", "bar", bar));
    const first = robot * this.episode.moments;
    this.cells.push((moment) => {
      const now = values[first + moment],
        shown = Math.max(Math.min(now, 1), -1);
      value.textContent = Math.abs(now) < 5e4 ? decimals(now, 3) : now.toExponential(1);
      bar.style.transform = `translateX(${shown < 0 ? 50 + 50 * shown : 50}%) scaleX(${Math.abs(shown) / 2})`;
    });
    return row;
  }

  move(time) {
    const { moment } = this.episode.at(time);
    if (this.robot < 0 || moment === this.shownMoment) return;
    this.shownMoment = moment;
    for (const fill of this.cells) fill(moment);
  }
}

function section(title, rows) {
  return element("section", "rows", element("h3", "", title), element("table", "", ...rows));
}

// Split "neighbour_0_cos_phase" into "neighbour 0" and "cos phase"; other entries belong to the robot itself.
function parted(name) {
  const found = /^(neighbour|robot|target)_(\d+)_(.+)$/.exec(name);
  return found ? [`${found[1]} ${found[2]}`, found[3].replaceAll("_", " ")] : ["itself", name.replaceAll("_", " ")];
}
