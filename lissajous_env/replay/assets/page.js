// The page: combines episodes, charts and player, and synchronizes them.

import { Camera } from "./camera.js";
import { placeCharts } from "./chart.js";
import { coloursOf } from "./colours.js";
import { bindControls } from "./controls.js";
import { bindGestures } from "./gestures.js";
import { gradientOf, shareScales } from "./ground.js";
import { Inspector } from "./inspector.js";
import { legendOf } from "./legend.js";
import { Link } from "./link.js";
import { Player } from "./player.js";
import { shareExtents, Stage } from "./stage.js";
import { beginTheme, currentTheme } from "./theme.js";
import { Tiles } from "./tiles.js";
import { numeral, Timeline } from "./timeline.js";
import { button, byId, element } from "./words.js";


export class Page {
  // The default theme is that of the system. `at`, the moment and the robot to begin with, is given in a frame, whose
  // outer page maintains the address.
  constructor(episodes, theme, at) {
    this.episodes = episodes;
    this.camera = new Camera();
    this.duration = Math.max(...episodes.map((episode) => episode.duration));
    this.selected = -1;
    this.player = new Player(this.duration, episodes[0].step, () => this.move());
    this.timeline = new Timeline(byId("timeline"), episodes, this.duration);
    this.title();
    this.views = episodes.map((episode) => this.view(episode));
    shareScales(this.views.map((view) => view.stage.ground));
    this.layer = this.views[0].stage.ground.layers()[0][0];
    this.charts = placeCharts(byId("charts"), byId("chart"), episodes, (each) => this.named(each), (time) =>
      this.player.seek(time),
    );
    this.link = new Link(this, at !== undefined);
    bindControls(this);
    new ResizeObserver(() => this.resize()).observe(byId("episodes"));
    addEventListener("resize", () => this.resize());
    this.legend();
    beginTheme(() => this.paint(), theme);
    this.select(-1);
    this.resize();
    this.link.follow(at ?? location.hash);
    this.move();
  }

  get viewing() {
    return { colours: coloursOf(currentTheme()), layer: this.layer, selected: this.selected };
  }

  title() {
    const [first, second] = this.episodes.map((episode) => episode.raw);
    const policies = second ? `${first.policy} against ${second.policy}` : first.policy;
    byId("name").textContent = policies ? `${first.scenario.name} · ${policies}` : first.scenario.name;
    byId("description").textContent = `${first.scenario.description} Seed ${first.seed}.`;
    byId("length").textContent = ` / ${this.player.words(this.duration)} s`;
    const scrub = byId("scrub");
    scrub.max = String(this.duration);
    scrub.step = String(this.episodes[0].step);
    byId("lanes").replaceChildren(...this.timeline.names().map((words) => element("span", "", words)));
    byId("episodes").classList.toggle("two", this.episodes.length > 1);
    byId("charts").classList.toggle("two", this.episodes.length > 1);
  }

  named(episode) {
    const policy = episode.raw.policy || "episode";
    return this.episodes.length > 1 ? `${numeral(this.episodes.indexOf(episode))} ${policy}` : policy;
  }

  view(episode) {
    const box = byId("episode").content.firstElementChild.cloneNode(true);
    const canvas = box.querySelector("canvas");
    const stage = new Stage(canvas, episode, this.camera);
    box.querySelector(".policy").textContent = this.named(episode);
    canvas.setAttribute(
      "aria-label",
      `${episode.count} robots in ${episode.about.name}, played by ${episode.raw.policy}`,
    );
    bindGestures(canvas, stage, () => this.look());
    const inspector = new Inspector(box.querySelector(".inspector"), episode, (robot) => this.select(robot));
    canvas.addEventListener("click", (event) => {
      const frame = canvas.getBoundingClientRect();
      const robot = stage.pick(event.clientX - frame.left, event.clientY - frame.top);
      this.select(robot === this.selected ? -1 : robot);
    });
    byId("episodes").append(box);
    const tiles = new Tiles(box.querySelector(".stage-head .row"), episode);
    const view = { box, canvas, stage, inspector, episode, tiles };
    this.addLayers(box.querySelector(".stage-foot .choices"), stage);
    return view;
  }

  addLayers(box, stage) {
    for (const [layer, words] of stage.ground.layers()) {
      const choice = button("", words, () => this.lay(layer));
      choice.dataset.layer = layer;
      box.append(choice);
    }
  }

  // Go to an event and select its robot.
  step(event) {
    if (!event) return;
    this.player.toggle(false);
    this.player.seek(event.time);
    if (event.robots.length && event.robots[0] !== this.selected) this.select(event.robots[0]);
  }

  selectIfThere(robot) {
    if (robot < this.episodes[0].count) this.select(robot);
  }

  lay(layer) {
    this.layer = layer;
    this.legend();
    this.draw();
  }

  nextLayer() {
    const layers = this.views[0].stage.ground.layers().map(([layer]) => layer);
    this.lay(layers[(layers.indexOf(this.layer) + 1) % layers.length]);
  }

  // Zoom and pan the camera, which all pictures share.
  steer(act) {
    act(this.views[0].stage);
    this.look();
  }

  look() {
    for (const { stage } of this.views) stage.look();
    this.draw();
  }

  select(robot) {
    this.selected = robot;
    for (const view of this.views) view.inspector.select(robot < view.episode.count ? robot : -1);
    for (const chart of this.charts) chart.select(robot);
    this.move();
  }

  paint() {
    if (this.timeline.width) this.timeline.draw(this.viewing.colours);
    this.draw();
  }

  legend() {
    for (const view of this.views) {
      const box = view.box.querySelector(".legend");
      box.replaceChildren(
        ...legendOf(view.episode, view.stage.ground, this.layer).map(([mark, words]) => {
          const sign = element("i", `sign ${mark}`);
          if (mark === "ramp") sign.style.background = gradientOf(this.layer);
          return element("span", "pair", sign, words);
        }),
      );
    }
    for (const choice of document.querySelectorAll("[data-layer]")) {
      choice.setAttribute("aria-pressed", String(choice.dataset.layer === this.layer));
    }
  }

  resize() {
    const ratio = Math.min(globalThis.devicePixelRatio || 1, 2);
    shareExtents(this.views.map((view) => view.stage));
    const room = this.room();
    this.flow(room);
    for (const view of this.views) {
      const width = view.box.querySelector(".stage").clientWidth;
      const height = Math.min(view.stage.heightFor(width), room);
      view.canvas.style.height = `${height}px`;
      view.stage.resize(width, height, ratio);
    }
    this.timeline.resize(byId("timeline").clientWidth, ratio);
    this.timeline.draw(this.viewing.colours);
    this.draw();
  }

  // Height of a picture that fits above the player, on wide screens with its head and foot [px].
  room() {
    const { canvas, box } = this.views[0],
      above = canvas.getBoundingClientRect().top + globalThis.scrollY;
    const below = box.querySelector(".stage-foot").offsetHeight,
      player = document.querySelector(".transport").offsetHeight;
    const phone = matchMedia("(max-width: 720px)").matches;
    const room = globalThis.innerHeight - player - (phone ? 24 : above + below + 16);
    return Math.min(Math.max(room, 280), 1100);
  }

  // Place the charts beside a picture that is higher than wide.
  flow(room) {
    const [{ stage }] = this.views,
      share = stage.heightFor(1000) / 1000;
    document.body.classList.toggle("tall", this.episodes.length === 1 && share > 1);
    byId("episodes").parentElement.style.setProperty("--picture", `${Math.max(Math.round(room / share) + 14, 420)}px`);
  }

  draw() {
    for (const view of this.views) if (view.stage.width) view.stage.draw(this.player.time, this.viewing);
  }

  // Update everything for the current moment.
  move() {
    const { time, playing } = this.player;
    this.draw();
    for (const chart of this.charts) chart.move(time);
    for (const view of this.views) {
      view.inspector.move(time);
      view.tiles.move(time);
    }
    byId("now").textContent = this.player.words();
    byId("scrub").value = String(time);
    byId("scrub").setAttribute("aria-valuetext", `${this.player.words()} s`);
    this.link.note();
    document.body.dataset.playing = String(playing);
    for (const name of ["title", "aria-label"]) byId("play").setAttribute(name, playing ? "Pause" : "Play");
    const event = this.timeline.latest(time),
      words = event ? `${this.player.words(event.time)} s: ${event.words}` : "";
    if (byId("event").textContent !== words) byId("event").textContent = words;
  }
}
