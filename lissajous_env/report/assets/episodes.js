// The table of all episodes, which can be sorted and filtered; each has a replay or the command for one.

import { isNarrow, reveal } from "./folding.js";
import { ordered } from "./sorting.js";
import { badge } from "./svg.js";
import { element, number } from "./words.js";

const FIRST = isNarrow() ? 8 : 50;
const MORE = 250;
const box = (name) => document.getElementById(name);

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
      report.policies.map((each) => each.shown),
    );
    this.choose(
      "of-kind",
      report.kinds.map((each) => each.words),
    );
    this.orders();
    box("more").addEventListener("click", () => {
      this.most += MORE;
      this.fill();
    });
    this.fill();
  }

  choose(name, words) {
    box(name).append(option("", "all"), ...words.map((each, k) => option(String(k), each)));
    box(name).addEventListener("change", () => {
      this.most = FIRST;
      this.fill();
    });
  }

  orders() {
    const known = this.report.columns.filter(({ name }) => this.report.episodes[name].some((value) => value !== null));
    box("order").append(
      option("", "worst first"),
      ...known.flatMap(({ name, title }) => [
        option(`-${name}`, `${title}, most first`),
        option(`+${name}`, `${title}, least first`),
      ]),
    );
    box("order").addEventListener("change", (event) =>
      this.sort(event.target.value.slice(1), event.target.value.startsWith("-")),
    );
  }

  sort(order, down) {
    Object.assign(this, { order, down, most: FIRST });
    box("order").value = order ? `${down ? "-" : "+"}${order}` : "";
    this.fill();
  }

  // Filter by scenario, policy and kind of failure (indices in the data); omitted ones match all.
  narrow({ scenario = "", policy = "", kind = "" }) {
    box("of-scenario").value = String(scenario);
    box("of-policy").value = String(policy);
    box("of-kind").value = String(kind);
    this.sort("", true);
    reveal(box("episodes"));
  }

  // Return the indices of the listed episodes, in order.
  places() {
    const { episodes } = this.report,
      wanted = (name) => box(name).value;
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
    const places = this.places(),
      body = element("tbody");
    const columns = this.order && !this.shown.includes(this.order) ? [this.order, ...this.shown] : this.shown;
    for (const k of places.slice(0, this.most)) body.append(this.row(k, columns));
    box("list").replaceChildren(this.head(columns), body);
    const listed =
      this.report.total > this.count ? ` listed, the worst of ${this.report.total.toLocaleString("en")}` : "";
    box("found").textContent = `${places.length.toLocaleString("en")} episodes${listed}`;
    box("more").hidden = places.length <= this.most;
    box("more").textContent =
      `Show ${Math.min(MORE, places.length - this.most)} more of ${(places.length - this.most).toLocaleString("en")}`;
  }

  head(columns) {
    const head = element("thead"),
      row = element("tr");
    for (const words of ["scenario", "policy", "seed", "failed"]) row.append(element("th", "", words));
    for (const name of columns) {
      const cell = element("th", "number"),
        button = element("button", "sort", this.columns.get(name).title);
      button.type = "button";
      button.dataset.column = name;
      if (name === this.order) cell.setAttribute("aria-sort", this.down ? "descending" : "ascending");
      button.addEventListener("click", () => this.sort(name, name !== this.order || !this.down));
      cell.append(button);
      row.append(cell);
    }
    row.append(element("th", "", ""));
    for (const cell of row.cells) cell.scope = "col";
    head.append(row);
    return head;
  }

  row(k, columns) {
    const { report } = this,
      { episodes } = report,
      row = element("tr");
    const scenario = report.scenarios[episodes.scenario[k]],
      policy = report.policies[episodes.policy[k]];
    row.dataset.place = k;
    const name = element("td", "name");
    name.append(badge(policy));
    const kinds = element("td", "chips");
    report.kinds.forEach((kind, bit) => {
      if (!(episodes.failed[k] & (1 << bit))) return;
      const chip = element("span", `kind ${kind.name}`, kind.words);
      chip.title = kind.about;
      kinds.append(chip);
    });
    const seed = element("td", "number", String(episodes.seed[k]));
    seed.dataset.title = "seed";
    row.append(element("td", "name", scenario.name), name, seed, kinds);
    for (const { name, title, whole, open } of columns.map((column) => this.columns.get(column))) {
      const value = episodes[name][k],
        words = value === null ? "–" : whole ? String(value) : number(value),
        cell = element("td", "number", open && episodes[open][k] === 1 ? `> ${words}` : words);
      cell.dataset.title = title;
      row.append(cell);
    }
    row.append(this.actions(k, scenario, policy));
    return row;
  }

  actions(k, scenario, policy) {
    const cell = element("td", "actions"),
      { episodes } = this.report;
    const replay = this.replayOf.get(`${episodes.scenario[k]} ${episodes.policy[k]} ${episodes.seed[k]}`);
    const command = commandOf(this.report, scenario, policy, episodes.seed[k]);
    if (replay) {
      const button = element("button", "play", "Replay");
      button.type = "button";
      button.dataset.replay = replay;
      button.addEventListener("click", () => this.onReplay(replay));
      cell.append(button);
    } else if (command) {
      const button = element("button", "quiet", "Command");
      button.type = "button";
      button.title = "Show the command for a replay";
      button.addEventListener("click", () => tell(cell, command));
      cell.append(button);
    }
    return cell;
  }
}

// Return the command that replays an episode beside the reference, if a command can name it.
export function commandOf(report, scenario, policy, seed) {
  if (!scenario.command || !policy.named || !policy.rival) return null;
  const [name, ...changes] = scenario.command.split(" --set "),
    reference = report.policies[scenario.reference];
  const against = reference && reference.named && reference !== policy ? ` --against ${quoted(reference.name)}` : "";
  const file = `${scenario.name}-${policy.name}-${seed}.html`.replaceAll(/[^\w.-]+/g, "-");
  const set = changes.length ? ` --set ${changes.join(" --set ")}` : "";
  return `lissajous replay ${name} ${quoted(policy.name)} --seed ${seed}${against} --out ${file}${set}`;
}

function quoted(word) {
  return /^[\w@%+=:,./-]+$/.test(word) ? word : `'${word.replaceAll("'", "'\"'\"'")}'`;
}

// Show a command in a separate row and copy it.
function tell(cell, command) {
  const row = cell.parentElement,
    next = row.nextElementSibling;
  if (next && next.classList.contains("told")) {
    next.remove();
    return;
  }
  const told = element("tr", "told"),
    wide = element("td"),
    code = element("code", "", command),
    said = element("small");
  wide.colSpan = row.cells.length;
  wide.append(code, said);
  told.append(wide);
  row.after(told);
  getSelection().selectAllChildren(code);
  const copying = globalThis.navigator.clipboard
    ? navigator.clipboard.writeText(command)
    : Promise.reject(new Error("no clipboard"));
  copying.then(
    () => {
      said.textContent = "copied";
    },
    () => {
      said.textContent = "selected; press Ctrl+C";
    },
  );
}

function option(value, words) {
  const made = element("option", "", words);
  made.value = value;
  return made;
}
