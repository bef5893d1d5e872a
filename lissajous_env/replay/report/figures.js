// Figures of a report: plots with a title and a sentence.

import { Plot } from "./plot.js";
import { element } from "./words.js";

// `axes`, `fill` and `height` are those of a plot.
export function figure(title, about, axes, fill, height) {
  const box = element("div");
  new Plot(box, title, axes, fill, height);
  return element("figure", "figure", element("figcaption", "muted", element("b", "", title), " ", about), box);
}

export function pictures(...figures) {
  return element("div", "plots", ...figures);
}
