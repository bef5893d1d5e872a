// Light or dark theme: by default that of the system.

import { paintTheme } from "./colours.js";

const dark = matchMedia("(prefers-color-scheme: dark)");
const looks = new CSSStyleSheet();
document.adoptedStyleSheets = [looks];
let theme = dark.matches ? "dark" : "light";

function paint() {
  const { policies } = paintTheme(theme);
  // Rules of the style sheet that concern marks precede these.
  const rules = policies.map((colour, k) => `:where(.c${k}) { stroke: ${colour}; --look: ${colour}; }`);
  looks.replaceSync(rules.join("\n"));
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
  paint();
}
