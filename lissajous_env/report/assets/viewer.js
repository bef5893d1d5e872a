// Plays episodes: the replay page in a frame, with the data of one episode or of two on the same seed.

import { currentTheme } from "./theme.js";
import { element } from "./words.js";

const part = (name) => document.getElementById(name);

export class Viewer {
  // `entries`: by the id of the data {title, group, policy, note}; those of one group stand side by side.
  // `partner(id)`: what stands beside an episode unless something else is chosen.
  constructor(entries, partner) {
    Object.assign(this, { entries, partner });
    part("close").addEventListener("click", () => part("viewer").close());
    part("viewer").addEventListener("close", () => {
      part("frame").srcdoc = "";
      history.replaceState(null, "", location.pathname + location.search);
    });
    part("beside").addEventListener("change", (event) => this.play(this.shown, event.target.value));
    addEventListener("hashchange", () => this.follow());
    this.follow();
  }

  // An address that names a replay opens it.
  follow() {
    const id = decodeURIComponent(location.hash.slice(1));
    if (Object.hasOwn(this.entries, id) && id !== this.shown) this.open(id);
  }

  open(id) {
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
    history.replaceState(null, "", `#${encodeURIComponent(id)}`);
    this.play(id, partner);
  }

  play(id, beside) {
    this.shown = id;
    const ids = beside ? [id, beside] : [id];
    part("viewer-note").textContent = ids
      .map((each) => this.entries[each].note)
      .filter(Boolean)
      .join(" ");
    // What the page holds is JSON in which nothing can end a script; it is put in as it stands.
    const episodes = ids.map((each) => part(each).textContent).join(",");
    const page = JSON.parse(part("viewer-page").textContent).replace("@theme@", currentTheme());
    part("frame").srcdoc = page.replace("@episodes@", () => episodes);
  }
}
