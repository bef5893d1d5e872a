// Light or dark theme: by default that of the system; a button and the key t change it.

import { coloursOf } from "./colours.js";
import { byId } from "./words.js";

let theme = "light";

export const currentTheme = () => theme;

// Begin with a theme, or that of the system; `onPaint` is called after each change.
export function beginTheme(onPaint = () => {}, first = "") {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  const turn = (to) => {
    theme = to;
    paint();
    onPaint();
  };
  const flip = () => turn(theme === "dark" ? "light" : "dark");
  byId("theme").addEventListener("click", flip);
  document.addEventListener("keydown", (event) => {
    const typing = ["INPUT", "SELECT", "TEXTAREA"].includes(event.target.tagName) && event.target.type !== "range";
    if (event.key === "t" && !typing && !event.ctrlKey && !event.metaKey && !event.altKey) flip();
  });
  dark.addEventListener("change", (event) => turn(event.matches ? "dark" : "light"));
  turn(first || (dark.matches ? "dark" : "light"));
}

// Give the page the colours as properties: `--ink`, and with an index `--robots-0` and `--policies-0`.
function paint() {
  const root = document.documentElement;
  root.dataset.theme = theme;
  byId("theme").textContent = theme === "dark" ? "Light" : "Dark";
  for (const [name, colours] of Object.entries(coloursOf(theme))) {
    if (typeof colours === "string") root.style.setProperty(`--${name}`, colours);
    else for (const [k, colour] of colours.entries()) root.style.setProperty(`--${name}-${k}`, colour);
  }
}
