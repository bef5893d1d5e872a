// A plot with two axes, as wide as its box and redrawn when that changes.

import { roundOf } from "./scales.js";
import { svg } from "./svg.js";
import { element, mark } from "./words.js";

const LEFT = 44,
  RIGHT = 14,
  TOP = 12,
  BOTTOM = 34;

export class Plot {
  // `axes` contains x and y, each {scale, title, words}, and lines at {x: [[value, words]], y: [...]}; `fill(plot)` draws.
  constructor(title, about, axes, fill, height = 250) {
    this.box = document.getElementById("figure").content.firstElementChild.cloneNode(true);
    this.box.querySelector("b").textContent = title;
    this.box.querySelector("span").textContent = about;
    Object.assign(this, { axes, fill, height, width: 0 });
    new ResizeObserver(() => this.resize()).observe(this.box.querySelector(".canvas"));
  }

  x(value) {
    return LEFT + this.axes.x.scale.place(value) * (this.width - LEFT - RIGHT);
  }
  y(value) {
    return this.height - BOTTOM - this.axes.y.scale.place(value) * (this.height - TOP - BOTTOM);
  }

  resize() {
    const canvas = this.box.querySelector(".canvas"),
      width = Math.max(Math.round(canvas.clientWidth), 220);
    if (width === this.width) return;
    this.width = width;
    this.picture = svg("svg", {
      viewBox: `0 0 ${width} ${this.height}`,
      class: "plot",
      role: "img",
      "aria-label": this.box.querySelector("b").textContent,
    });
    this.frame();
    this.fill(this);
    canvas.replaceChildren(this.picture);
  }

  frame() {
    const { x, y } = this.axes,
      bottom = this.height - BOTTOM,
      right = this.width - RIGHT;
    for (const value of roundOf(x.scale, this.width < 420 ? 4 : 7)) {
      this.add("line", { x1: this.x(value), x2: this.x(value), y1: TOP, y2: bottom, class: "grid" });
      this.write(this.x(value), bottom + 14, mark(value), "middle");
    }
    for (const value of roundOf(y.scale, 5)) {
      this.add("line", { x1: LEFT, x2: right, y1: this.y(value), y2: this.y(value), class: "grid" });
      this.write(LEFT - 6, this.y(value) + 4, mark(value), "end");
    }
    this.write((LEFT + right) / 2, this.height - 3, x.title, "middle", "axis-title");
    for (const [value, words] of x.lines || []) {
      if (!x.scale.holds(value)) continue;
      const at = this.x(value),
        late = at > right - 60;
      this.add("line", { x1: at, x2: at, y1: TOP, y2: bottom, class: "limit" });
      this.write(at + (late ? -4 : 4), TOP + 9, words, late ? "end" : "start", "limit-name");
    }
  }

  add(kind, attributes, ...children) {
    const made = svg(kind, attributes, ...children);
    this.picture.append(made);
    return made;
  }

  write(x, y, words, anchor, look = "tick") {
    return this.add("text", { x: x.toFixed(1), y: y.toFixed(1), "text-anchor": anchor, class: look }, words);
  }

  path(xs, ys, attributes, stepped = false) {
    let d = "",
      before = null;
    ys.forEach((value, k) => {
      if (value === null) {
        before = null;
        return;
      }
      const [x, y] = [this.x(xs[k]).toFixed(1), this.y(value).toFixed(1)];
      d += before === null ? `M${x} ${y}` : stepped ? `H${x}V${y}` : `L${x} ${y}`;
      before = value;
    });
    return this.add("path", { d, ...attributes });
  }
}

export function pictures(...plots) {
  const box = element("div", "plots");
  box.append(...plots.map((plot) => plot.box));
  return box;
}
