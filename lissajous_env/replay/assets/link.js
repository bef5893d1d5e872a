// The current moment and robot in the page's address: #t=12.3&robot=2; a page in a frame has no address.

const PATIENCE = 200;

export class Link {
  constructor(page) {
    Object.assign(this, { page, timer: 0, isThere: ["file:", "http:", "https:"].includes(location.protocol) });
    addEventListener("hashchange", () => this.follow(location.hash));
  }

  get fragment() {
    const { player, selected } = this.page;
    return `#t=${player.words()}${selected < 0 ? "" : `&robot=${selected}`}`;
  }

  // Go to the moment and the robot in an address, if given.
  follow(fragment) {
    const given = new URLSearchParams(fragment.replace(/^#/, "")),
      time = Number(given.get("t") || NaN),
      robot = Number(given.get("robot") || NaN);
    if (Number.isFinite(time)) this.page.player.seek(time);
    if (Number.isInteger(robot) && robot >= 0 && robot < this.page.episodes[0].count) this.page.select(robot);
    this.shown = this.fragment;
  }

  // Update the address unless it plays; browsers limit the changes per second.
  note() {
    clearTimeout(this.timer);
    this.timer = setTimeout(() => {
      if (!this.isThere || this.page.player.playing || this.fragment === this.shown) return;
      this.shown = this.fragment;
      history.replaceState(null, "", this.fragment);
    }, PATIENCE);
  }
}
