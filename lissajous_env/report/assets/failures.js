// Failures: a count for each kind, and a matrix of policies and scenarios, worst policy first.

import { fill, heads, rowName } from "./tables.js";
import { button, byId, element, number } from "./words.js";


export function showFailures(report, onPick) {
  raised(report);
  byId("tallies").replaceChildren(...report.kinds.map((kind, k) => tally(report, kind, k, onPick)));
  matrix(report, onPick);
}

function raised(report) {
  byId("raised").hidden = report.failures.length === 0;
  byId("raised").replaceChildren(
    ...report.failures.map(([scenario, policy, error]) =>
      element("span", "", `${policy} raised on ${scenario}: ${error}`),
    ),
  );
}

// Return the cells of the matrix, one for each policy and scenario.
function cellsOf(report) {
  return report.scenarios.flatMap((scenario, s) =>
    scenario.policies.map((of) => ({ s, scenario, of, policy: of.policy })),
  );
}

function tally(report, kind, k, onPick) {
  const cells = cellsOf(report),
    count = (of) => of.reduce((sum, cell) => sum + cell.of.failed[k], 0);
  const failed = count(cells),
    all = cells.reduce((sum, cell) => sum + cell.of.episodes, 0);
  const box = button(`tally ${kind.name}`, "", () => onPick({ kind: k }));
  box.title = kind.about;
  box.append(element("b", "", `${failed} of ${all}`), element("span", "", ` episodes ${kind.words}`));
  const shares = report.policies.map((policy, p) => {
    const of = cells.filter((cell) => cell.policy === p);
    return [policy, count(of), of.reduce((sum, cell) => sum + cell.of.episodes, 0)];
  });
  const worst = shares.filter(([, of]) => of > 0).sort((a, b) => b[1] / b[2] - a[1] / a[2]);
  const never = shares.filter(([, of]) => of === 0).map(([policy]) => policy.name);
  const most = worst
    .slice(0, 3)
    .map(([policy, of, total]) => `${policy.name} ${of}/${total}`)
    .join(", ");
  const words =
    failed === 0
      ? "none"
      : never.length && never.length <= 4
        ? `most: ${most}; never: ${never.join(", ")}`
        : `most: ${most}`;
  box.append(element("small", "muted", words));
  return box;
}

// Sort the policies, worst first, by the failures and then the collisions of their episodes.
function inOrder(report) {
  const sums = report.policies.map(() => [0, 0, 0]);
  for (const { of, policy } of cellsOf(report)) {
    sums[policy][0] += of.badness[0];
    sums[policy][1] += Math.log1p(of.badness[2]);
    sums[policy][2] += 1;
  }
  const key = (p) => [sums[p][0] / sums[p][2], sums[p][1] / sums[p][2]];
  const worse = (a, b) => key(b)[0] - key(a)[0] || key(b)[1] - key(a)[1];
  return [...report.policies.keys()].filter((p) => sums[p][2]).sort(worse);
}

function matrix(report, onPick) {
  const most = Math.max(...cellsOf(report).map((each) => each.of.badness[2]), 1);
  const rows = inOrder(report).map((p) => {
    const cells = report.scenarios.map((scenario, s) => {
      const of = scenario.policies.find((each) => each.policy === p);
      return element("td", "", of ? meters(report, of, most, () => onPick({ scenario: s, policy: p })) : "");
    });
    return element("tr", "", rowName(report.policies[p]), ...cells);
  });
  fill(byId("matrix"), heads("policy", ...report.scenarios.map((scenario) => scenario.name)), rows);
}

function meters(report, of, most, onClick) {
  const box = button("meters", "", onClick),
    said = [];
  report.kinds.forEach((kind, k) => {
    const share = of.failed[k] / of.episodes,
      collided = kind.name === "collided";
    said.push(
      `${of.failed[k]} of ${of.episodes} ${kind.words}${collided ? `, ${number(of.badness[2])} collisions each` : ""}`,
    );
    if (share === 0) return;
    const bar = element("i"),
      length = collided ? Math.log1p(of.badness[2]) / Math.log1p(most) : share;
    bar.style.width = `${(100 * length).toFixed(1)}%`;
    const words = collided ? number(of.badness[2]) : `${of.failed[k]}/${of.episodes}`;
    box.append(element("span", `muted meter ${kind.name}`, element("i", "", bar), element("span", "", words)));
  });
  box.title = said.join("\n");
  box.setAttribute("aria-label", said.join("; "));
  if (!box.childElementCount) box.append(element("span", "clean", "no failure"));
  return box;
}
