// Light or dark theme: by default that of the system; in print always light.

import { coloursOf } from "./colours.js";

const dark = matchMedia("(prefers-color-scheme: dark)");
const paper = matchMedia("print");
let theme = dark.matches ? "dark" : "light";

function paint() {
  const shown = paper.matches ? "light" : theme,
    root = document.documentElement;
  root.dataset.theme = shown;
  document.getElementById("theme").textContent = shown === "dark" ? "Light" : "Dark";
  for (const [name, colour] of Object.entries(coloursOf(shown))) {
    if (typeof colour === "string") root.style.setProperty(`--${name}`, colour);
  }
}

export function currentTheme() {
  return theme;
}

export function beginTheme() {
  const turn = (to) => {
    theme = to;
    paint();
  };
  document.getElementById("theme").addEventListener("click", () => turn(theme === "dark" ? "light" : "dark"));
  document.addEventListener("keydown", (event) => {
    const typing = ["INPUT", "SELECT", "TEXTAREA"].includes(event.target.tagName);
    if (event.key === "t" && !typing && !event.ctrlKey && !event.metaKey && !event.altKey)
      turn(theme === "dark" ? "light" : "dark");
  });
  dark.addEventListener("change", (event) => turn(event.matches ? "dark" : "light"));
  paper.addEventListener("change", paint);
  paint();
}
