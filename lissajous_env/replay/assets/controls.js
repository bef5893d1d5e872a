// Buttons, slider and keys of the page.

import { byId } from "./words.js";

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
  byId("help").addEventListener("click", () => showKeys(byId("keys").hidden));
  bindTimeline(page);
  bindLink(page);
  for (const button of document.querySelectorAll("[data-look]")) {
    button.addEventListener("click", () => LOOKS[button.dataset.look](page));
  }
  const keys = keysOf(page);
  document.addEventListener("keydown", (event) => {
    const { target } = event;
    if (event.ctrlKey || event.metaKey || event.altKey || target.tagName === "SELECT") return;
    // On a button, the space bar clicks it.
    if (event.key === " " && target.tagName === "BUTTON") return;
    const act = /^\d$/.test(event.key) ? () => page.selectIfThere(Number(event.key)) : keys[event.key];
    if (!act) return;
    event.preventDefault();
    act(event.shiftKey);
  });
}

const CLOSER = 1.5;
const ASIDE = 0.12;
// Zoom and pan of the picture.
const LOOKS = {
  closer: (page) => page.steer((stage) => stage.zoomBy(CLOSER)),
  farther: (page) => page.steer((stage) => stage.zoomBy(1 / CLOSER)),
  whole: (page) => page.steer((stage) => stage.camera.whole()),
};

function keysOf(page) {
  const { player, timeline } = page;
  const by = (sign) => (far) => player.seek(player.time + sign * (far ? 10 : 1) * player.step);
  const aside = (right, down) => () =>
    page.steer((stage) => stage.panBy(-right * ASIDE * stage.width, -down * ASIDE * stage.height));
  return {
    " ": () => player.toggle(),
    ArrowLeft: by(-1),
    ArrowRight: by(1),
    Home: () => player.seek(0),
    End: () => player.seek(player.duration),
    "[": () => page.step(timeline.before(player.time)),
    "]": () => page.step(timeline.after(player.time)),
    ">": () => pace(player, 1),
    "<": () => pace(player, -1),
    "+": () => LOOKS.closer(page),
    "=": () => LOOKS.closer(page),
    "-": () => LOOKS.farther(page),
    v: () => LOOKS.whole(page),
    w: aside(0, -1),
    a: aside(-1, 0),
    s: aside(0, 1),
    d: aside(1, 0),
    l: () => byId("link").click(),
    g: () => page.nextLayer(),
    Escape: () => page.select(-1),
    "?": () => showKeys(byId("keys").hidden),
  };
}

function pace(player, by) {
  const speeds = byId("speed");
  speeds.selectedIndex = Math.min(Math.max(speeds.selectedIndex + by, 0), speeds.length - 1);
  player.speed = Number(speeds.value);
}

// Speeds in steps of about two or three, so that an episode lasts from a minute to some seconds.
function addSpeeds(box, duration) {
  const speeds = [0.1, 0.25, 0.5, 1, 2, 4, 8, 30];
  while (duration / speeds[0] < 60) speeds.unshift(Number((speeds[0] / 4).toPrecision(1)));
  while (duration / speeds.at(-1) > 10) speeds.push(Number((speeds.at(-1) * 4).toPrecision(1)));
  for (const speed of speeds) box.append(new Option(`${speed}×`, String(speed), speed === 1, speed === 1));
}

// Button that copies a link to the current view; hidden without an address.
function bindLink(page) {
  const button = byId("link"),
    words = button.textContent;
  button.hidden = !page.link.isThere;
  button.addEventListener("click", async () => {
    button.textContent = (await page.link.copy()) ? "Copied" : "Not allowed";
    setTimeout(() => {
      button.textContent = words;
    }, 1500);
  });
  addEventListener("hashchange", () => page.link.follow(location.hash));
}

function showKeys(shown) {
  byId("keys").hidden = !shown;
  byId("help").setAttribute("aria-expanded", String(shown));
}

// The slider lies above the marks, so it handles clicks and names the nearest mark.
function bindTimeline(page) {
  const { timeline } = page,
    scrub = byId("scrub");
  const place = (event) => {
    const box = byId("timeline").getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  scrub.addEventListener("pointermove", (event) => {
    const found = timeline.nearest(...place(event));
    scrub.title = found ? `${page.player.words(found.time)} s: ${found.words}` : "";
  });
  scrub.addEventListener("click", (event) => {
    const found = event.detail > 0 && timeline.nearest(...place(event));
    if (found && timeline.begins(found, place(event)[0])) page.step(found);
    else if (found && found.robots.length) page.select(found.robots[0]);
  });
}
