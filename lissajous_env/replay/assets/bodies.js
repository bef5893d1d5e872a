// Draws the robots: bodies to scale, numbers, failures and collisions.

import { COLOURS, faded, robotPaint } from "./colours.js";
import { REMOVED, FAILED } from "./episode.js";

const PARTS = { WHEEL: "wheel", GROUND: "card", GLASS: "glass" };

export class Bodies {
  // Prepare for the current size of the stage.
  constructor(stage) {
    Object.assign(this, { stage, context: stage.context, size: stage.body });
    this.shapes = stage.episode.about.shape.map(([outline, fill]) => [pathOf(outline, this.size), fill]);
  }

  paintTouches(places, at) {
    for (const [i, j, first, last] of this.stage.episode.raw.contacts) {
      if (at.moment < first || at.moment > last) continue;
      const [one, other] = [places[i], places[j]],
        apart = Math.hypot(one.x - other.x, one.y - other.y) / 2;
      const radius = Math.min(apart, 2 * this.size) + 1.25 * this.size + 4;
      this.ring((one.x + other.x) / 2, (one.y + other.y) / 2, radius, COLOURS.touch, 2.2);
    }
  }

  paint(places, selected) {
    const order = places
      .map((place, i) => ({ i, ...place }))
      .sort((one, other) => (other.status === REMOVED) - (one.status === REMOVED));
    for (const place of order) {
      if (this.isOutside(place)) this.paintArrow(place);
      else this.paintOne(place, place.i === selected);
    }
    for (const place of order) {
      // Numbers of a crowd only when zoomed in.
      if (this.isOutside(place) || (this.stage.many && this.size <= 9 && place.i !== selected)) continue;
      const aside = 0.8 * this.size + 7;
      this.write(String(place.i), place.x + aside, place.y - aside);
    }
  }

  paintOne({ i, x, y, heading, status }, isSelected) {
    const { context } = this;
    if (isSelected) this.ring(x, y, this.size + 6, COLOURS.ink, 2);
    if (status === REMOVED) return this.ring(x, y, this.size, COLOURS.removed, 2);
    if (status === FAILED) {
      context.setLineDash([4, 3]);
      this.ring(x, y, 1.15 * this.size + 3.5, COLOURS.failed, 2.2);
      context.setLineDash([]);
    }
    const colour = robotPaint(i);
    this.ring(x, y, this.stage.scale * this.stage.episode.about.radius, faded(colour, 0.75), 1);
    context.save();
    context.translate(x, y);
    context.rotate(-heading);
    for (const [path, fill] of this.shapes) {
      context.fillStyle = fill === null ? colour : COLOURS[PARTS[fill]] || COLOURS.ink;
      context.fill(path);
    }
    context.restore();
  }

  ring(x, y, radius, colour, width) {
    const { context } = this;
    context.strokeStyle = colour;
    context.lineWidth = width;
    context.beginPath();
    context.arc(x, y, radius, 0, 2 * Math.PI);
    context.stroke();
  }

  write(words, x, y) {
    const { context } = this;
    context.font = "600 12px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.lineWidth = 3.5;
    context.lineJoin = "round";
    context.strokeStyle = COLOURS.card;
    context.strokeText(words, x, y);
    context.fillStyle = COLOURS.ink;
    context.fillText(words, x, y);
  }

  // Return true if the centre of a robot is outside the picture.
  isOutside({ x, y }) {
    const { width, height } = this.stage;
    return !(x > 0 && x < width && y > 0 && y < height);
  }

  // Draw an arrow at the edge for a robot outside the picture; none for a crowd.
  paintArrow({ i, x, y }) {
    const { context, stage } = this;
    if (stage.many) return;
    const [right, down] = [Math.min(Math.max(x, 14), stage.width - 14), Math.min(Math.max(y, 14), stage.height - 14)];
    const way = Math.atan2(y - down, x - right);
    context.save();
    context.translate(right, down);
    context.rotate(way);
    context.fillStyle = robotPaint(i);
    context.fill(pathOf([[11, 0], [-4, 6], [-4, -6]], 1));
    context.restore();
    this.write(String(i), right - 14 * Math.cos(way), down - 14 * Math.sin(way));
  }
}

function pathOf(outline, size) {
  const path = new Path2D();
  for (const [x, y] of outline) path.lineTo(size * x, -size * y);
  path.closePath();
  return path;
}
