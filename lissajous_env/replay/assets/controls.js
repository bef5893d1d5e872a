// Buttons, slider and keys of the page.

import { byId } from "./words.js";

const CLOSER = 1.5;

export function bindControls(page) {
  const { player, timeline } = page;
  byId("play").addEventListener("click", () => player.toggle());
  byId("back").addEventListener("click", () => page.step(timeline.before(player.time)));
  byId("next").addEventListener("click", () => page.step(timeline.after(player.time)));
  addSpeeds(byId("speed"), page.duration);
  byId("speed").addEventListener("change", (event) => {
    player.speed = Number(event.target.value);
  });
  byId("scrub").addEventListener("input", (event) => player.seek(Number(event.target.value)));
  bindTimeline(page);
  const looks = {
    closer: (stage) => stage.zoomBy(CLOSER),
    farther: (stage) => stage.zoomBy(1 / CLOSER),
    whole: (stage) => stage.camera.whole(),
  };
  for (const button of document.querySelectorAll("[data-look]")) {
    button.addEventListener("click", () => page.steer(looks[button.dataset.look]));
  }
  bindKeys(page);
}

function bindKeys(page) {
  const { player, timeline } = page;
  const by = (sign) => (far) => player.seek(player.time + sign * (far ? 10 : 1) * player.step);
  const keys = {
    " ": () => player.toggle(),
    ArrowLeft: by(-1),
    ArrowRight: by(1),
    "[": () => page.step(timeline.before(player.time)),
    "]": () => page.step(timeline.after(player.time)),
    r: () => page.select((page.selected + 1) % Math.max(...page.episodes.map((episode) => episode.count))),
    Escape: () => page.select(-1),
  };
  document.addEventListener("keydown", (event) => {
    const { target, key } = event;
    if (!keys[key] || event.ctrlKey || event.metaKey || event.altKey || target.tagName === "SELECT") return;
    if (key === " " && target.tagName === "BUTTON") return; // the space bar clicks it
    event.preventDefault();
    keys[key](event.shiftKey);
  });
}

// Speeds in steps of about two or three, so that an episode lasts from a minute to some seconds.
function addSpeeds(box, duration) {
  const speeds = [0.1, 0.25, 0.5, 1, 2, 4, 8, 30];
  while (duration / speeds[0] < 60) speeds.unshift(Number((speeds[0] / 4).toPrecision(1)));
  while (duration / speeds.at(-1) > 10) speeds.push(Number((speeds.at(-1) * 4).toPrecision(1)));
  for (const speed of speeds) box.append(new Option(`${speed}×`, String(speed), speed === 1, speed === 1));
}

// The slider lies above the marks, so it handles clicks and names the nearest mark.
function bindTimeline(page) {
  const { timeline } = page,
    scrub = byId("scrub");
  const nearest = (event) => {
    const box = byId("timeline").getBoundingClientRect();
    return timeline.nearest(event.clientX - box.left, event.clientY - box.top);
  };
  scrub.addEventListener("pointermove", (event) => {
    const mark = nearest(event);
    scrub.title = mark ? `${page.player.words(mark.time)} s: ${mark.words}` : "";
  });
  scrub.addEventListener("click", (event) => event.detail > 0 && page.step(nearest(event)));
}
