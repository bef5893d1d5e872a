// The report of a benchmark: all scenarios together, then what failed, each scenario, and all episodes.

import { Episodes } from "./episodes.js";
import { showFailures } from "./failures.js";
import { showOverall } from "./overall.js";
import { scenarioSection } from "./scenario.js";
import { start } from "./start.js";
import { facts } from "./tables.js";
import { Viewer } from "./viewer.js";
import { byId, element } from "./words.js";

function begin(report) {
  const viewer = new Viewer(report);
  const episodes = new Episodes(report, (id) => viewer.open(id));
  showOverall(report);
  showFailures(report, (wanted) => episodes.narrow(wanted));
  const sections = report.scenarios.map((scenario, s) =>
    scenarioSection(report, scenario, s, (place) => pick(report, viewer, episodes, place)),
  );
  byId("scenarios").append(...sections);
  contents(report);
  byId("made").append(element("dl", "row muted facts-row", ...facts(Object.entries(report.made))));
  globalThis.report = { report, viewer, episodes };
}

// Open the replay of a clicked episode, or else its row in the table.
function pick(report, viewer, episodes, place) {
  const { scenario, policy } = report.episodes,
    replay = episodes.replayOf(place);
  if (replay) viewer.open(replay);
  else episodes.narrow({ scenario: scenario[place], policy: policy[place] });
}

function contents(report) {
  const links = [
    ...(report.overall.length ? [["overall", "All scenarios"]] : []),
    ["failures", "Failures"],
    ...report.scenarios.map((scenario, s) => [`scenario-${s}`, scenario.name]),
    ["episodes", "All episodes"],
  ];
  for (const [id, words] of links) {
    const link = element("a", "", words);
    link.href = `#${id}`;
    byId("contents").append(link);
  }
}

start("lissajous report 3", begin);
