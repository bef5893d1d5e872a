// Plays episodes in a frame with the replay page: one episode, or two on the same seed.

import { copied } from "./link.js";
import { currentTheme } from "./theme.js";
import { element } from "./words.js";

// Moment and robot in an address.
const PLACE = /^t=[\d.]+(&robot=\d+)?$/;

const part = (name) => document.getElementById(name);

export class Viewer {
  // `entries`: {title, group, policy, note} by the id of the data; those of one group can be side by side.
  // `partner(id)`: the default episode beside another.
  constructor(entries, partner) {
    Object.assign(this, { entries, partner });
    part("close").addEventListener("click", () => part("viewer").close());
    part("viewer").addEventListener("close", () => {
      part("frame").srcdoc = "";
      this.address = "";
      history.replaceState(null, "", location.pathname + location.search);
    });
    part("beside").addEventListener("change", (event) => this.play(this.shown, event.target.value, this.at));
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
    if (event.source !== part("frame").contentWindow || !PLACE.test(replay)) return;
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
    part("viewer-title").textContent = entry.title;
    part("beside").replaceChildren(
      element("option", "", "nothing"),
      ...others.map((other) => element("option", "", this.entries[other].policy)),
    );
    [...part("beside").options].forEach((option, k) => {
      option.value = k ? others[k - 1] : "";
    });
    part("beside").parentElement.hidden = others.length === 0;
    const partner = this.partner(id, others) || "";
    part("beside").value = partner;
    if (!part("viewer").open) part("viewer").showModal();
    this.play(id, partner, PLACE.test(at) ? at : "");
  }

  play(id, beside, at = "") {
    this.shown = id;
    this.remember(at);
    const ids = beside ? [id, beside] : [id];
    part("viewer-note").textContent = ids
      .map((each) => this.entries[each].note)
      .filter(Boolean)
      .join(" ");
    // The data are JSON that cannot end a script, so they are inserted unchanged.
    const episodes = ids.map((each) => part(each).textContent).join(",");
    const page = JSON.parse(part("viewer-page").textContent).replace("@theme@", currentTheme()).replace("@at@", at);
    part("frame").srcdoc = page.replace("@episodes@", () => episodes);
  }
}
