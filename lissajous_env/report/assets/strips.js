// The episodes of a policy in one column as a strip: quartile box, a dot for each episode, and theoretical lines.

import { roundOf } from "./scales.js";
import { coloured, svg } from "./svg.js";
import { mark } from "./words.js";

const HEIGHT = 18;
const MOST_DOTS = 64;

const percent = (share) => `${(100 * share).toFixed(2)}%`;

// `dots` are [value, index of the episode in the data].
export function strip(policy, cell, measure, scale, dots) {
  const picture = svg("svg", { class: "strip", height: HEIGHT, width: "100%", "aria-hidden": "true" });
  picture.append(...linesOf(measure, scale, HEIGHT));
  if (cell.quartiles) {
    const [least, lower, middle, upper, most] = cell.quartiles.map(scale.place);
    const y = HEIGHT / 2;
    picture.append(
      svg("line", { x1: percent(least), x2: percent(most), y1: y, y2: y, class: "whisker", ...coloured(policy) }),
      svg("rect", {
        x: percent(lower),
        width: percent(Math.max(upper - lower, 0.002)),
        y: y - 5,
        height: 10,
        class: "box",
        ...coloured(policy),
      }),
      svg("line", { x1: percent(middle), x2: percent(middle), y1: y - 6, y2: y + 6, class: "median", ...coloured(policy) }),
    );
  }
  const every = Math.ceil(dots.length / MOST_DOTS);
  for (const [k, [value, episode]] of dots.entries()) {
    if (k % every) continue;
    // All but the worst and the best are jittered, so that equal values are visible.
    const y = HEIGHT / 2 + ((k * 7) % 5) - 2;
    picture.append(
      svg("circle", {
        cx: percent(scale.place(value)),
        cy: y,
        r: 1.9,
        class: "dot",
        ...coloured(policy),
        "data-episode": episode,
      }),
    );
  }
  return picture;
}

// Ticks and names of the lines above the strips of a column.
export function stripAxis(measure, scale) {
  const picture = svg("svg", { class: "strip axis", height: 14, width: "100%", "aria-hidden": "true" });
  for (const value of roundOf(scale, 4)) {
    const share = scale.place(value),
      anchor = share < 0.06 ? "start" : share > 0.9 ? "end" : "middle";
    picture.append(svg("text", { x: percent(share), y: 10, "text-anchor": anchor }, mark(value)));
  }
  return picture;
}

function linesOf(measure, scale, height) {
  return measure.lines
    .filter(([value]) => scale.holds(value))
    .map(([value]) =>
      svg("line", {
        x1: percent(scale.place(value)),
        x2: percent(scale.place(value)),
        y1: 0,
        y2: height,
        class: "limit",
      }),
    );
}
