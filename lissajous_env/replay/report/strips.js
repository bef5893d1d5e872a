// Distributions in the cells of tables: strips of episodes with quartile box and theoretical lines.

import { roundOf } from "./scales.js";
import { coloured, svg } from "./svg.js";
import { mark } from "./words.js";

const HEIGHT = 18;
const MOST_DOTS = 64;

const percent = (share) => `${(100 * share).toFixed(2)}%`;

const strip = (look, height, ...parts) =>
  svg("svg", { class: look, height, width: "100%", "aria-hidden": "true" }, ...parts);

const across = (from, to, y, look) => svg("line", { x1: percent(from), x2: percent(to), y1: y, y2: y, ...look });

const upright = (at, top, bottom, look) =>
  svg("line", { x1: percent(at), x2: percent(at), y1: top, y2: bottom, ...look });

// The episodes of a policy in one column; `dots` are [value, index of the episode in the data].
export function episodesStrip(policy, cell, measure, scale, dots) {
  const y = HEIGHT / 2,
    colour = coloured(policy);
  const lines = measure.lines.filter(([value]) => scale.holds(value));
  const parts = lines.map(([value]) => upright(scale.place(value), 0, HEIGHT, { class: "limit" }));
  if (cell.quartiles) {
    const [least, lower, middle, upper, most] = cell.quartiles.map(scale.place);
    const width = percent(Math.max(upper - lower, 0.002));
    parts.push(
      across(least, most, y, { class: "whisker", ...colour }),
      svg("rect", { x: percent(lower), width, y: y - 5, height: 10, class: "box", ...colour }),
      upright(middle, y - 6, y + 6, { class: "median", ...colour }),
    );
  }
  const every = Math.ceil(dots.length / MOST_DOTS);
  for (const [k, [value, episode]] of dots.entries()) {
    if (k % every) continue;
    // All but the worst and the best are jittered, so that equal values are visible.
    const place = { cx: percent(scale.place(value)), cy: y + ((k * 7) % 5) - 2, r: 1.9 };
    parts.push(svg("circle", { ...place, class: "dot", "data-episode": episode, ...colour }));
  }
  return strip("strip", HEIGHT, ...parts);
}

// Ticks above the strips of a column.
export function stripAxis(scale) {
  const ticks = roundOf(scale, 4).map((value) => {
    const share = scale.place(value),
      anchor = share < 0.06 ? "start" : share > 0.9 ? "end" : "middle";
    return svg("text", { x: percent(share), y: 10, "text-anchor": anchor }, mark(value));
  });
  return strip("strip axis", 14, ...ticks);
}
