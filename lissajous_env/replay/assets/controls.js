// Buttons, slider and keys of the page.

const control = (name) => document.getElementById(name);

export function bindControls(page) {
  const { player, timeline } = page;
  control("play").addEventListener("click", () => player.toggle());
  control("back").addEventListener("click", () => page.step(timeline.before(player.time)));
  control("next").addEventListener("click", () => page.step(timeline.after(player.time)));
  control("speed").addEventListener("change", (event) => {
    player.speed = Number(event.target.value);
  });
  control("scrub").addEventListener("input", (event) => player.seek(Number(event.target.value)));
  control("theme").addEventListener("click", () => page.flip());
  control("help").addEventListener("click", () => showKeys(control("keys").hidden));
  showKeys(matchMedia("(min-width: 1081px)").matches);
  matchMedia("(prefers-color-scheme: dark)").addEventListener("change", (event) => {
    page.theme = event.matches ? "dark" : "light";
    page.paint();
  });
  bindTimeline(page);
  const keys = keysOf(page);
  document.addEventListener("keydown", (event) => {
    const { target } = event;
    if (event.ctrlKey || event.metaKey || event.altKey || target.tagName === "SELECT") return;
    // On a button the space bar is a click on it.
    if (event.key === " " && target.tagName === "BUTTON") return;
    const act = /^\d$/.test(event.key) ? () => page.selectIfThere(Number(event.key)) : keys[event.key];
    if (!act) return;
    event.preventDefault();
    act(event.shiftKey);
  });
}

function keysOf(page) {
  const { player, timeline } = page;
  const by = (sign) => (far) => player.seek(player.time + sign * (far ? 1 : player.step));
  return {
    " ": () => player.toggle(),
    ArrowLeft: by(-1),
    ArrowRight: by(1),
    Home: () => player.seek(0),
    End: () => player.seek(player.duration),
    "[": () => page.step(timeline.before(player.time)),
    "]": () => page.step(timeline.after(player.time)),
    "+": () => pace(player, 1),
    "-": () => pace(player, -1),
    t: () => page.flip(),
    g: () => page.nextLayer(),
    Escape: () => page.select(-1),
    "?": () => showKeys(control("keys").hidden),
  };
}

function pace(player, by) {
  const speeds = control("speed");
  speeds.selectedIndex = Math.min(Math.max(speeds.selectedIndex + by, 0), speeds.length - 1);
  player.speed = Number(speeds.value);
}

function showKeys(shown) {
  control("keys").hidden = !shown;
  control("help").setAttribute("aria-expanded", String(shown));
}

// The marks lie under the slider: it is what is clicked, and says what the nearest mark is.
function bindTimeline(page) {
  const { timeline } = page,
    scrub = control("scrub");
  const place = (event) => {
    const box = control("timeline").getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  scrub.addEventListener("pointermove", (event) => {
    const found = timeline.nearest(...place(event));
    scrub.title = found ? `${found.time.toFixed(1)} s: ${found.words}` : "";
  });
  scrub.addEventListener("click", (event) => {
    const found = event.detail > 0 && timeline.nearest(...place(event));
    if (found && timeline.begins(found, place(event)[0])) page.step(found);
    else if (found && found.robots.length) page.select(found.robots[0]);
  });
}
