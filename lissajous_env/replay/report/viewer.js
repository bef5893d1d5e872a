// Plays episodes in a frame with the replay page: one episode, or two on the same seed.

import { byId } from "./words.js";

export class Viewer {
  // `entries`: {title, group, policy} by the id of the data; those of one group can be side by side.
  // `partner(id)`: the default episode beside another.
  constructor(entries, partner) {
    Object.assign(this, { entries, partner });
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
    if (Object.hasOwn(this.entries, id)) this.open(id, rest.join("&"));
  }

  open(id, at = "") {
    const entry = this.entries[id],
      others = Object.keys(this.entries).filter((other) => other !== id && this.entries[other].group === entry.group);
    byId("viewer-title").textContent = entry.title;
    byId("beside").replaceChildren(
      new Option("nothing", ""),
      ...others.map((other) => new Option(this.entries[other].policy, other)),
    );
    byId("beside").parentElement.hidden = others.length === 0;
    byId("beside").value = this.partner(id, others) || "";
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
