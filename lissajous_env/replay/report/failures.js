// Failures: a count for each kind, and a matrix of policies and scenarios, worst policy first.

import { fill, heads, rowName } from "./tables.js";
import { button, byId, element } from "./words.js";

// Number of the episodes of a policy that can fail in a way: without a worst-case undetected time, none loses a guarantee.
const judged = (kind, of) => (kind.name === "open" ? (of.cells.guaranteed_detection_time?.known ?? 0) : of.episodes);

export function showFailures(report, onPick) {
  byId("raised").hidden = report.failures.length === 0;
  byId("raised").replaceChildren(
    ...report.failures.map(([scenario, policy, error]) => element("span", "", `${policy} raised on ${scenario}: ${error}`)),
  );
  const all = report.scenarios.flatMap((scenario) => scenario.policies),
    sum = (value) => all.reduce((total, of) => total + value(of), 0);
  const tallies = report.kinds.map((kind, k) => {
    const box = button(`tally ${kind.name}`, "", () => onPick({ kind: k }));
    box.title = kind.about;
    box.hidden = sum((of) => judged(kind, of)) === 0;
    box.append(element("b", "", `${sum((of) => of.failed[k])} of ${sum((of) => judged(kind, of))}`), ` episodes ${kind.words}`);
    return box;
  });
  byId("tallies").replaceChildren(...tallies);
  matrix(report, onPick);
}

function matrix(report, onPick) {
  const collisions = report.scenarios.flatMap(({ policies }) => policies.map((of) => of.collisions));
  const most = Math.max(...collisions, 1);
  const rows = inOrder(report).map((p) => {
    const cells = report.scenarios.map((scenario, s) => {
      const of = scenario.policies.find(({ policy }) => policy === p);
      return element("td", "", of ? meters(report, of, most, () => onPick({ scenario: s, policy: p })) : "");
    });
    return element("tr", "", rowName(report.policies[p]), ...cells);
  });
  fill(byId("matrix"), heads("policy", ...report.scenarios.map((scenario) => scenario.name)), rows);
}

// Sort the policies, worst first, by the failures and then the collisions of their episodes.
function inOrder(report) {
  const key = (p) => {
    const played = report.scenarios.flatMap(({ policies }) => policies.filter((of) => of.policy === p));
    const mean = (value) => played.reduce((total, of) => total + value(of), 0) / played.length;
    return [p, mean((of) => of.failed.reduce((total, count) => total + count, 0) / of.episodes), mean((of) => Math.log1p(of.collisions))];
  };
  const keys = [...report.policies.keys()].map(key).filter(([, failed]) => !Number.isNaN(failed));
  return keys.sort((a, b) => b[1] - a[1] || b[2] - a[2]).map(([p]) => p);
}

function meters(report, of, most, onClick) {
  const box = button("meters", "", onClick),
    phrases = [];
  report.kinds.forEach((kind, k) => {
    if (judged(kind, of) === 0) return;
    const share = of.failed[k] / of.episodes,
      collided = kind.name === "collided",
      collisions = of.cells.collisions.words;
    phrases.push(`${of.failed[k]} of ${of.episodes} ${kind.words}${collided ? `, ${collisions} collisions each` : ""}`);
    if (share === 0) return;
    const bar = element("i"),
      length = collided ? Math.log1p(of.collisions) / Math.log1p(most) : share;
    bar.style.width = `${(100 * length).toFixed(1)}%`;
    const words = collided ? collisions : `${of.failed[k]}/${of.episodes}`;
    box.append(element("span", `muted meter ${kind.name}`, element("i", "", bar), element("span", "", words)));
  });
  box.title = phrases.join("\n");
  box.setAttribute("aria-label", phrases.join("; "));
  if (!box.childElementCount) box.append(element("span", "clean", "no failure"));
  return box;
}
