// The current moment and robot in the page's address: #t=12.3&robot=2.

const PATIENCE = 200;

export class Link {
  // `listened`: true in a frame, whose outer page maintains the address.
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

  // Go to the moment and the robot in an address, if given.
  follow(fragment) {
    const said = new URLSearchParams(fragment.replace(/^#/, "")),
      time = Number(said.get("t") || NaN),
      robot = Number(said.get("robot") || NaN);
    if (Number.isFinite(time)) this.page.player.seek(time);
    if (Number.isInteger(robot) && robot >= 0) this.page.selectIfThere(robot);
    this.shown = this.fragment;
  }

  // Update the address; browsers limit the changes per second.
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

// Copy text; return true on success.
export async function copied(words) {
  // Only the focused page may write, not its frame.
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
