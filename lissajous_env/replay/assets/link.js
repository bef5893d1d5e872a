// The moment and the robot that are looked at, as the end of the page's address: #t=12.3&robot=2.

const PATIENCE = 200;

export class Link {
  // `listened`: whether the page is in a frame of a page that keeps the address instead.
  constructor(page, listened) {
    Object.assign(this, { page, listened, timer: 0 });
    this.own = ["file:", "http:", "https:"].includes(location.protocol);
  }

  get isThere() {
    return this.listened || this.own;
  }

  get fragment() {
    const { player, selected } = this.page;
    return `t=${player.words()}${selected < 0 ? "" : `&robot=${selected}`}`;
  }

  // Go to the moment and the robot of an address's end; what it does not say stays.
  follow(fragment) {
    const said = new URLSearchParams(fragment.replace(/^#/, "")),
      time = Number(said.get("t") || NaN),
      robot = Number(said.get("robot") || NaN);
    if (Number.isFinite(time)) this.page.player.seek(time);
    if (Number.isInteger(robot) && robot >= 0) this.page.selectIfThere(robot);
    this.shown = this.fragment;
  }

  // Keep the address at what is looked at; browsers allow few changes a second.
  note() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.show(), PATIENCE);
  }

  show() {
    if (this.page.player.playing || this.fragment === this.shown) return;
    this.shown = this.fragment;
    if (this.listened) parent.postMessage({ replay: this.fragment }, "*");
    else if (this.own) history.replaceState(null, "", `#${this.fragment}`);
  }

  async copy() {
    this.page.player.toggle(false);
    if (this.listened) {
      parent.postMessage({ replay: this.fragment, copy: true }, "*");
      return true;
    }
    this.show();
    return copied(`${location.href.split("#")[0]}#${this.fragment}`);
  }
}

// Copy words; whether that was allowed.
export async function copied(words) {
  // Only the page that has the focus may write, and not the one in its frame.
  globalThis.focus();
  try {
    await navigator.clipboard.writeText(words);
    return true;
  } catch {
    const box = document.createElement("textarea");
    box.value = words;
    (document.querySelector("dialog[open]") || document.body).append(box);
    box.select();
    const done = document.execCommand("copy");
    box.remove();
    return done;
  }
}
