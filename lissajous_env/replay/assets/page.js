// The page: combines episodes, charts and player, and synchronizes them.

import { Camera } from "./camera.js";
import { placeCharts } from "./chart.js";
import { bindControls } from "./controls.js";
import { bindGestures } from "./gestures.js";
import { gradientOf } from "./ground.js";
import { Inspector } from "./inspector.js";
import { legendOf } from "./legend.js";
import { Link } from "./link.js";
import { Player } from "./player.js";
import { shareExtents, Stage } from "./stage.js";
import { numeral, Timeline } from "./timeline.js";
import { button, byId, element } from "./words.js";

export class Page {
  // `at`: moment and robot to begin with, as in an address; by default those of the page's address.
  constructor(episodes, at = location.hash) {
    this.episodes = episodes;
    this.camera = new Camera();
    this.duration = Math.max(...episodes.map((episode) => episode.duration));
    this.selected = -1;
    this.player = new Player(this.duration, episodes[0].step, () => this.move());
    this.timeline = new Timeline(byId("timeline"), episodes, this.duration);
    this.title();
    this.views = episodes.map((episode) => this.view(episode));
    const seek = (time) => this.player.seek(time);
    this.charts = placeCharts(byId("charts"), byId("chart"), episodes, (episode) => this.named(episode), seek);
    this.link = new Link(this);
    bindControls(this);
    new ResizeObserver(() => this.resize()).observe(byId("episodes"));
    addEventListener("resize", () => this.resize());
    this.lay(this.views[0].stage.ground.layers()[0][0]);
    this.select(-1);
    this.resize();
    this.link.follow(at);
    this.move();
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
    for (const id of ["episodes", "charts"]) byId(id).classList.toggle("two", this.episodes.length > 1);
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
    const words = `${episode.count} robots in ${episode.about.name}, played by ${episode.raw.policy}`;
    canvas.setAttribute("aria-label", words);
    bindGestures(canvas, stage, () => this.look());
    const inspector = new Inspector(box.querySelector(".inspector"), episode);
    inspector.box.setAttribute("aria-label", `Robot: ${this.named(episode)}`);
    canvas.addEventListener("click", (event) => {
      const frame = canvas.getBoundingClientRect();
      const robot = stage.pick(event.clientX - frame.left, event.clientY - frame.top);
      this.select(robot === this.selected ? -1 : robot);
    });
    for (const [layer, name] of stage.ground.layers()) {
      const choice = button("", name, () => this.lay(layer));
      choice.dataset.layer = layer;
      box.querySelector(".layers").append(choice);
    }
    byId("episodes").append(box);
    return { box, canvas, stage, inspector, episode };
  }

  // Go to an event, if there is one, and select its robot.
  step(event) {
    if (!event) return;
    this.player.toggle(false);
    this.player.seek(event.time);
    if (event.robots.length) this.select(event.robots[0]);
  }

  // Show a layer of the ground.
  lay(layer) {
    this.layer = layer;
    for (const view of this.views) {
      const entries = legendOf(view.episode, view.stage.ground, layer).map(([mark, words]) => {
        const sign = element("i", `sign ${mark}`);
        if (mark === "ramp") sign.style.background = gradientOf(layer);
        return element("span", "pair", sign, words);
      });
      view.box.querySelector(".legend").replaceChildren(...entries);
    }
    for (const choice of document.querySelectorAll("[data-layer]")) {
      choice.setAttribute("aria-pressed", String(choice.dataset.layer === layer));
    }
    this.draw();
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
    this.timeline.draw(byId("timeline").clientWidth, ratio);
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
    const share = this.views[0].stage.heightFor(1000) / 1000;
    document.body.classList.toggle("tall", this.episodes.length === 1 && share > 1);
    byId("episodes").parentElement.style.setProperty("--picture", `${Math.max(Math.round(room / share) + 14, 420)}px`);
  }

  draw() {
    for (const { stage } of this.views) if (stage.width) stage.draw(this.player.time, this.layer, this.selected);
  }

  // Update everything for the current moment.
  move() {
    const { time, playing } = this.player;
    this.draw();
    for (const chart of this.charts) chart.move(time);
    for (const { inspector } of this.views) inspector.move(time);
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
