// A plot with two axes, as wide as its box and redrawn when that changes; a third axis may be on the right.

import { roundOf } from "./scales.js";
import { svg } from "./svg.js";
import { mark } from "./words.js";

const LEFT = 44,
  TOP = 12;

export class Plot {
  // `axes` contains x, y and perhaps right, each {scale, title}, and lines at {x: [[value, words]]}; `fill(plot)` draws.
  constructor(box, name, axes, fill, height = 250) {
    Object.assign(this, { box, name, axes, fill, height, width: 0 });
    this.right = axes.right ? 28 : 14;
    this.bottom = axes.x.title ? 34 : 20;
    new ResizeObserver(() => this.resize()).observe(box);
  }

  x(value) {
    return LEFT + this.axes.x.scale.place(value) * (this.width - LEFT - this.right);
  }
  y(value, scale = this.axes.y.scale) {
    return this.height - this.bottom - scale.place(value) * (this.height - TOP - this.bottom);
  }

  // Distances of the area of the lines from the edges of the picture.
  get inset() {
    return [TOP, this.right, this.bottom, LEFT].map((side) => `${side}px`).join(" ");
  }

  resize() {
    const width = Math.max(Math.round(this.box.clientWidth), 120);
    if (width === this.width) return;
    this.width = width;
    this.draw();
  }

  draw() {
    const viewBox = `0 0 ${this.width} ${this.height}`;
    this.picture = svg("svg", { viewBox, class: "plot", role: "img", "aria-label": this.name });
    this.frame();
    this.fill(this);
    this.box.replaceChildren(this.picture);
  }

  frame() {
    const { x, y, right } = this.axes,
      bottom = this.height - this.bottom,
      end = this.width - this.right;
    for (const value of roundOf(x.scale, this.width < 420 ? 4 : 7)) {
      this.add("line", { x1: this.x(value), x2: this.x(value), y1: TOP, y2: bottom, class: "grid" });
      this.write(this.x(value), bottom + 14, mark(value), "middle");
    }
    for (const value of roundOf(y.scale, 5)) {
      this.add("line", { x1: LEFT, x2: end, y1: this.y(value), y2: this.y(value), class: "grid" });
      this.write(LEFT - 6, this.y(value) + 4, mark(value), "end");
    }
    for (const value of right ? roundOf(right.scale, 5) : []) {
      this.write(end + 6, this.y(value, right.scale) + 4, mark(value), "start");
    }
    if (x.title) this.write((LEFT + end) / 2, this.height - 3, x.title, "middle", "axis-title");
    for (const [value, words] of x.lines || []) {
      if (!x.scale.holds(value)) continue;
      const at = this.x(value),
        late = at > end - 60;
      this.add("line", { x1: at, x2: at, y1: TOP, y2: bottom, class: "limit" });
      this.write(at + (late ? -4 : 4), TOP + 9, words, late ? "end" : "start");
    }
  }

  add(kind, attributes, ...children) {
    return this.picture.appendChild(svg(kind, attributes, ...children));
  }

  write(x, y, words, anchor, look = "tick") {
    return this.add("text", { x: x.toFixed(1), y: y.toFixed(1), "text-anchor": anchor, class: look }, words);
  }

  // Draw a line, interrupted where values are missing; `filled` shades the area below it.
  path(xs, ys, attributes, { stepped = false, filled = false, scale = this.axes.y.scale } = {}) {
    let d = "",
      begun = false;
    for (const [k, value] of ys.entries()) {
      if (value === null) {
        begun = false;
        continue;
      }
      const [x, y] = [this.x(xs[k]).toFixed(1), this.y(value, scale).toFixed(1)];
      d += !begun ? `M${x} ${y}` : stepped ? `H${x}V${y}` : `L${x} ${y}`;
      begun = true;
    }
    if (filled) this.add("path", { d: `${d}V${this.y(0)}H${LEFT}Z`, fill: attributes.stroke, class: "area" });
    return this.add("path", { d, ...attributes });
  }
}
