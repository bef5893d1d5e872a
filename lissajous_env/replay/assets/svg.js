// SVG elements; the style sheet defines their colours, so themes need no redrawing.

import { element } from "./words.js";

const SPACE = "http://www.w3.org/2000/svg";

export function svg(kind, attributes = {}, ...children) {
  const part = document.createElementNS(SPACE, kind);
  for (const [name, value] of Object.entries(attributes)) {
    if (value !== undefined && value !== null) part.setAttribute(name, value);
  }
  part.append(...children);
  return part;
}

const OUTLINES = {
  "<": "M-5 0 4-5v10z",
  ">": "M5 0-4-5v10z",
  p: "M0-5 4.800-1.500 2.900 4h-5.800l-1.900-5.500z",
  h: "M0-5 4.300-2.500v5L0 5-4.300 2.500v-5z",
  d: "M0-5.800 3.400 0 0 5.800-3.400 0z",
  s: "M-4-4h8v8h-8z",
  "^": "M0-5 5 4h-10z",
  D: "M0-5.4 5.4 0 0 5.4-5.4 0z",
  v: "M0 5 5-4h-10z",
  P: "M-1.8-5h3.6v3.200h3.200v3.600h-3.200v3.200h-3.600v-3.200h-3.200v-3.600h3.200z",
  X: "M-5-3-3-5 0-2 3-5 5-3 2 0 5 3 3 5 0 2-3 5-5 3-2 0z",
  "*": "M0-6 1.500-1.900 5.800-1.800 2.400.8 3.600 5 0 2.500-3.600 5-2.400.8-5.800-1.800-1.500-1.900z",
};

// Attributes of a part in the colour of a policy.
export function coloured(policy) {
  const colour = `var(--policies-${policy.colour})`;
  return { stroke: colour, fill: colour };
}

// The mark of a policy, around the origin.
export function markOf(policy) {
  const look = { class: policy.hollow ? "mark hollow" : "mark", ...coloured(policy) };
  if (!OUTLINES[policy.mark]) return svg("circle", { r: 4.4, ...look });
  return svg("path", { d: OUTLINES[policy.mark], ...look });
}

export function badge(policy) {
  const sign = svg("svg", { viewBox: "-7 -7 14 14", width: 13, height: 13, "aria-hidden": "true" }, markOf(policy));
  return element("span", "pair badge", sign, element("span", "", policy.name));
}
