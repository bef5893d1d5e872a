// Plays episodes in a frame with the replay page: one episode, or two on the same seed.

import { copied } from "./link.js";
import { currentTheme } from "./theme.js";
import { byId } from "./words.js";

// Moment and robot in an address.
const PLACE = /^t=[\d.]+(&robot=\d+)?$/;


export class Viewer {
  // `entries`: {title, group, policy, note} by the id of the data; those of one group can be side by side.
  // `partner(id)`: the default episode beside another.
  constructor(entries, partner) {
    Object.assign(this, { entries, partner });
    byId("close").addEventListener("click", () => byId("viewer").close());
    byId("viewer").addEventListener("close", () => {
      byId("frame").srcdoc = "";
      this.address = "";
      history.replaceState(null, "", location.pathname + location.search);
    });
    byId("beside").addEventListener("change", (event) => this.play(this.shown, event.target.value, this.at));
    addEventListener("hashchange", () => this.follow());
    addEventListener("message", (event) => this.hear(event));
    this.follow();
  }

  // Open the replay in the address, at its moment and robot: #ID&t=12.3&robot=2.
  follow() {
    const [name, ...rest] = location.hash.slice(1).split("&"),
      id = decodeURIComponent(name);
    if (Object.hasOwn(this.entries, id) && location.hash !== this.address) this.open(id, rest.join("&"));
  }

  // The page in the frame changed its moment or robot, or its link is copied.
  hear(event) {
    const { replay, copy } = event.data || {};
    if (event.source !== byId("frame").contentWindow || !PLACE.test(replay)) return;
    this.remember(replay);
    if (copy) copied(location.href);
  }

  // Update the address.
  remember(at) {
    this.at = at;
    this.address = `#${encodeURIComponent(this.shown)}${at ? `&${at}` : ""}`;
    history.replaceState(null, "", this.address);
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
    const partner = this.partner(id, others) || "";
    byId("beside").value = partner;
    if (!byId("viewer").open) byId("viewer").showModal();
    this.play(id, partner, PLACE.test(at) ? at : "");
  }

  play(id, beside, at = "") {
    this.shown = id;
    this.remember(at);
    const ids = beside ? [id, beside] : [id];
    byId("viewer-note").textContent = ids
      .map((each) => this.entries[each].note)
      .filter(Boolean)
      .join(" ");
    // The data are JSON that cannot end a script, so they are inserted unchanged.
    const episodes = ids.map((each) => byId(each).textContent).join(",");
    const page = JSON.parse(byId("viewer-page").textContent).replace("@theme@", currentTheme()).replace("@at@", at);
    byId("frame").srcdoc = page.replace("@episodes@", () => episodes);
  }
}
