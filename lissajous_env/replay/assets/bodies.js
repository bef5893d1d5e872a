// Draws the robots: bodies to scale, numbers, failures and collisions.

import { faded, robotPaint } from "./colours.js";
import { REMOVED, STUCK } from "./episode.js";

const PARTS = { WHEEL: "wheel", GROUND: "card", GLASS: "glass" };

export class Bodies {
  // Prepare for the current size of the stage.
  constructor(stage) {
    Object.assign(this, { stage, context: stage.context, size: stage.body });
    this.shapes = stage.episode.about.shape.map(([outline, fill]) => [pathOf(outline, this.size), fill]);
    this.drop = dropOf(this.size);
  }

  paintTouches(places, at, colours) {
    const { context } = this;
    context.strokeStyle = colours.touch;
    context.lineWidth = 2.2;
    for (const [i, j, first, last] of this.stage.episode.raw.contacts) {
      if (at.moment < first || at.moment > last) continue;
      const x = (places[i].x + places[j].x) / 2,
        y = (places[i].y + places[j].y) / 2;
      const apart = Math.hypot(places[i].x - places[j].x, places[i].y - places[j].y) / 2;
      context.beginPath();
      context.arc(x, y, Math.min(apart, 2 * this.size) + 1.25 * this.size + 4, 0, 2 * Math.PI);
      context.stroke();
    }
  }

  paint(places, at, view) {
    const { context } = this,
      colours = view.colours;
    const order = places
      .map((_, i) => i)
      .sort((i, j) => (places[j].status === REMOVED) - (places[i].status === REMOVED));
    for (const i of order) {
      const place = places[i],
        colour = place.status === REMOVED ? colours.removed : robotPaint(colours, i);
      if (this.isOutside(place)) {
        // No arrows for a crowd.
        if (!this.stage.many || i === view.selected) this.paintArrow(place, i, colour, colours);
        continue;
      }
      context.save();
      context.translate(place.x, place.y);
      if (i === view.selected) ring(context, this.size + 6, colours.ink, 2);
      if (place.status === REMOVED) this.paintRemoved(colour);
      else this.paintOne(place, colour, colours);
      context.restore();
    }
    this.paintNumbers(places, order, view);
  }

  // Numbers inside the robots if they fit, otherwise beside them; for a crowd only when zoomed in.
  paintNumbers(places, order, { colours, selected }) {
    const numbered = order
      .filter((i) => !this.isOutside(places[i]) && (!this.stage.many || this.size > 9 || i === selected))
      .map((i) => ({ i, ...places[i] }));
    const inside = this.size > 12 && !this.shapes.length;
    const beside = numbered.filter(({ status }) => !inside || status === REMOVED);
    const at = this.stage.labels.place(beside, this.size, this.stage.width, this.stage.height);
    beside.forEach(({ i }, k) => this.write(String(i), ...at[k], colours.ink, colours.card));
    for (const { i, x, y, status } of numbered) {
      if (inside && status !== REMOVED) this.write(String(i), x, y, colours.card, "", Math.min(0.9 * this.size, 16));
    }
  }

  write(words, x, y, colour, around = "", size = 12) {
    const { context } = this;
    context.font = `600 ${size}px system-ui, sans-serif`;
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.lineWidth = 3.5;
    context.lineJoin = "round";
    context.strokeStyle = around;
    if (around) context.strokeText(words, x, y);
    context.fillStyle = colour;
    context.fillText(words, x, y);
  }

  paintOne(place, colour, colours) {
    const { context } = this;
    if (place.status === STUCK) {
      context.setLineDash([4, 3]);
      ring(context, 1.15 * this.size + 3.5, colours.stuck, 2.2);
      context.setLineDash([]);
    }
    if (this.shapes.length) ring(context, this.stage.scale * this.stage.episode.about.radius, faded(colour, 0.75), 1);
    context.rotate(-place.heading);
    for (const [path, fill] of this.shapes) {
      context.fillStyle = fill === null ? colour : colours[PARTS[fill]] || colours.ink;
      context.fill(path);
    }
    if (!this.shapes.length) {
      context.fillStyle = colour;
      context.strokeStyle = colours.card;
      context.lineWidth = 1.6;
      context.stroke(this.drop);
      context.fill(this.drop);
    }
  }

  paintRemoved(colour) {
    const { context } = this,
      arm = 0.55 * this.size;
    ring(context, this.size, colour, 2);
    context.beginPath();
    context.moveTo(-arm, -arm);
    context.lineTo(arm, arm);
    context.moveTo(-arm, arm);
    context.lineTo(arm, -arm);
    context.stroke();
  }

  // Return true if the centre of a robot is outside the picture.
  isOutside({ x, y }) {
    const { width, height } = this.stage;
    return !(x > 0 && x < width && y > 0 && y < height);
  }

  // Draw an arrow at the edge for a robot outside the picture.
  paintArrow(place, robot, colour, colours) {
    const { context } = this;
    const x = Math.min(Math.max(place.x, 14), this.stage.width - 14),
      y = Math.min(Math.max(place.y, 14), this.stage.height - 14);
    const way = Math.atan2(place.y - y, place.x - x);
    context.save();
    context.translate(x, y);
    context.rotate(way);
    context.fillStyle = colour;
    context.beginPath();
    context.moveTo(11, 0);
    context.lineTo(-4, 6);
    context.lineTo(-4, -6);
    context.fill();
    context.restore();
    this.write(String(robot), x - 14 * Math.cos(way), y - 14 * Math.sin(way), colours.ink, colours.card);
  }
}

function ring(context, radius, colour, width) {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.beginPath();
  context.arc(0, 0, radius, 0, 2 * Math.PI);
  context.stroke();
}

function pathOf(outline, size) {
  const path = new Path2D();
  for (const [x, y] of outline) path.lineTo(size * x, -size * y);
  path.closePath();
  return path;
}

// A disc with a tip ahead.
function dropOf(radius) {
  const path = new Path2D(),
    touch = Math.acos(1 / 1.42);
  path.moveTo(1.42 * radius, 0);
  path.arc(0, 0, radius, touch, 2 * Math.PI - touch);
  path.closePath();
  return path;
}
