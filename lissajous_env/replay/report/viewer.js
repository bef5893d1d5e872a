// Plays episodes in a frame with the replay page: one episode, or two on the same seed.

import { byId } from "./words.js";

export class Viewer {
  constructor(report) {
    this.report = report;
    byId("close").addEventListener("click", () => byId("viewer").close());
    byId("viewer").addEventListener("close", () => {
      byId("frame").srcdoc = "";
      history.replaceState(null, "", location.pathname + location.search);
    });
    byId("beside").addEventListener("change", (event) => this.play(this.shown, event.target.value));
    addEventListener("hashchange", () => this.follow());
    this.follow();
  }

  // Open the replay in the address, at its moment and robot: #ID&t=12.3&robot=2.
  follow() {
    const [id, ...rest] = location.hash.slice(1).split("&");
    if (Object.hasOwn(this.report.replays, id)) this.open(id, rest.join("&"));
  }

  // Beside an episode is, by default, that of the reference, or beside that the worst of the others on the same seed.
  open(id, at = "") {
    const { replays, scenarios, policies } = this.report,
      [s, p, seed] = replays[id];
    const others = Object.keys(replays).filter((other) => other !== id && replays[other][0] === s && replays[other][2] === seed);
    byId("viewer-title").textContent = `${scenarios[s].name} · ${policies[p].name} · seed ${seed}`;
    const options = others.map((other) => new Option(policies[replays[other][1]].name, other));
    byId("beside").replaceChildren(new Option("nothing", ""), ...options);
    byId("beside").parentElement.hidden = others.length === 0;
    const reference = others.find((other) => replays[other][1] === scenarios[s].reference);
    byId("beside").value = reference || others[0] || "";
    if (!byId("viewer").open) byId("viewer").showModal();
    history.replaceState(null, "", `#${[id, at].filter(Boolean).join("&")}`);
    this.play(id, byId("beside").value, at);
  }

  play(id, beside, at = "") {
    this.shown = id;
    const ids = beside ? [id, beside] : [id];
    // The data are JSON that cannot end a script, so they are inserted unchanged.
    const episodes = ids.map((name) => byId(name).textContent).join(",");
    const page = JSON.parse(byId("viewer-page").textContent).replace("@at@", at.replaceAll(/[^\w.&=]/g, ""));
    byId("frame").srcdoc = page.replace("@episodes@", () => episodes);
  }
}
