// View from above on a canvas: ground, sensors, curve, ring, trails, targets, robots.

import { Bodies } from "./bodies.js";
import { COLOURS, faded, robotPaint } from "./colours.js";
import { FAILED, REMOVED, turned } from "./episode.js";
import { Ground } from "./ground.js";
import { paintRogue, Targets } from "./targets.js";
import { quantile } from "./words.js";

const MOST_TRAIL = 300;
const PAD = 12;
const MOSTLY = 0.95;

// Length of a trail [moment].
function trailOf(episode) {
  return Math.min(Math.max(Math.round(episode.about.trail / episode.step), 2), MOST_TRAIL);
}

export class Stage {
  constructor(canvas, episode, camera) {
    Object.assign(this, { canvas, episode, camera, ground: new Ground(episode) });
    this.context = canvas.getContext("2d");
    this.base = document.createElement("canvas");
    this.floor = document.createElement("canvas");
    this.many = episode.count > 40;
    this.nearest = [];
    this.extent = extentOf(episode);
  }

  // Return the height of the stage for a width [px].
  heightFor(width) {
    return Math.round(Math.max((width * this.extent[1]) / this.extent[0], 170));
  }

  resize(width, height, ratio) {
    this.width = width;
    this.height = height;
    this.ratio = ratio;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    this.fit = Math.min((width / 2 - PAD) / this.extent[0], (height / 2 - PAD) / this.extent[1]);
    this.look();
  }

  // Update after a change of the camera.
  look() {
    this.body = Math.max(this.scale * this.episode.about.radius, this.many ? 3.4 : 6.5);
    this.bodies = new Bodies(this);
    this.targets = new Targets(this);
    this.painted = false;
    this.laid = "";
    this.canvas.style.touchAction = this.camera.isWhole ? "pan-y" : "none";
  }

  // Pixels per metre.
  get scale() {
    return this.fit * this.camera.zoom;
  }

  // Zoom around a place or the centre of the picture [px].
  zoomBy(factor, x = this.width / 2, y = this.height / 2) {
    const { camera, scale } = this;
    camera.zoomBy(factor, camera.x + (x - this.width / 2) / scale, camera.y - (y - this.height / 2) / scale, this.extent);
  }

  // Pan with the pointer [px].
  panBy(right, down) {
    const { camera, scale } = this;
    camera.moveTo(camera.x - right / scale, camera.y + down / scale, this.extent);
  }

  px(x) {
    return this.width / 2 + this.scale * (x - this.camera.x);
  }
  py(y) {
    return this.height / 2 - this.scale * (y - this.camera.y);
  }

  draw(time, layer, selected) {
    const { context, episode } = this,
      at = episode.at(time),
      places = this.places(at);
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    context.clearRect(0, 0, this.width, this.height);
    context.drawImage(this.floorOf(layer, at), 0, 0, this.width, this.height);
    this.paintDiscs(places);
    this.paintBase();
    context.drawImage(this.base, 0, 0, this.width, this.height);
    this.paintRing(places, at);
    this.paintTrails(places, at);
    this.targets.paint(at);
    paintRogue(this, at);
    this.bodies.paintTouches(places, at);
    this.bodies.paint(places, selected);
    this.nearest = places;
  }

  places(at) {
    const { x, y, heading, status } = this.episode.robots;
    return Array.from({ length: this.episode.count }, (_, i) => ({
      x: this.px(this.episode.between(x, i, at)),
      y: this.py(this.episode.between(y, i, at)),
      heading: this.episode.between(heading, i, at, turned),
      status: status[i * this.episode.moments + at.moment],
    }));
  }

  // Return the robot at a place [px], or -1.
  pick(x, y) {
    let best = -1,
      least = Math.max(1.6 * this.body, 18);
    this.nearest.forEach((place, i) => {
      const away = Math.hypot(place.x - x, place.y - y);
      if (away < least) [best, least] = [i, away];
    });
    return best;
  }

  rectangle() {
    const { half } = this.episode.about;
    return [this.px(-half[0]), this.py(half[1]), 2 * half[0] * this.scale, 2 * half[1] * this.scale];
  }

  paintDiscs(places) {
    const { context, episode } = this,
      { sensing, sight } = episode.about;
    context.save();
    context.beginPath();
    context.rect(...this.rectangle());
    context.clip();
    // No discs for a crowd, where they would cover everything.
    const strength = episode.count <= 6 ? 1 : episode.count <= 40 ? 0.55 : 0.15;
    context.fillStyle = faded(COLOURS.sensing, 0.07 * strength);
    context.strokeStyle = faded(COLOURS.sensing, 0.5 * strength);
    context.lineWidth = 1;
    for (const place of places) {
      if (place.status === REMOVED || place.status === FAILED) continue;
      context.beginPath();
      context.arc(place.x, place.y, this.scale * sensing, 0, 2 * Math.PI);
      context.fill();
      context.stroke();
      if (sight > sensing) this.bodies.ring(place.x, place.y, this.scale * sight, context.strokeStyle, 1);
    }
    context.restore();
  }

  // The rectangle with its cells, redrawn only when these change.
  floorOf(layer, at) {
    const picture = this.ground.picture(layer, at.now);
    const key = picture ? this.ground.shown : layer;
    if (key === this.laid) return this.floor;
    this.laid = key;
    this.floor.width = this.canvas.width;
    this.floor.height = this.canvas.height;
    const context = this.floor.getContext("2d"),
      box = this.rectangle();
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    context.fillStyle = COLOURS.ground;
    context.fillRect(...box);
    if (picture) context.drawImage(picture, ...box);
    return this.floor;
  }

  // Constant parts: curve and boundary.
  paintBase() {
    if (this.painted) return;
    this.painted = true;
    this.base.width = this.canvas.width;
    this.base.height = this.canvas.height;
    const context = this.base.getContext("2d"),
      curve = this.episode.raw.curve,
      count = curve.length / 3;
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    context.strokeStyle = faded(COLOURS.curve, this.many ? 0.35 : 0.8);
    context.lineWidth = this.many ? 0.7 : 1.4;
    context.lineJoin = "round";
    context.beginPath();
    for (let k = 0; k < count; k++) context.lineTo(this.px(curve[k]), this.py(curve[count + k]));
    context.closePath();
    context.stroke();
    context.strokeStyle = COLOURS.edge;
    context.lineWidth = 1;
    context.strokeRect(...this.rectangle());
  }

  paintRing(places, at) {
    const { context, episode } = this;
    context.lineWidth = 1.3;
    for (const [i, j] of episode.about.links) {
      if (!episode.isThere(i, at.moment) || !episode.isThere(j, at.moment)) continue;
      const lost = episode.isCut(i, j, at.moment);
      context.strokeStyle = lost ? COLOURS.lost : faded(COLOURS.link, this.many ? 0.25 : 0.45);
      context.setLineDash(lost ? [3, 5] : []);
      context.beginPath();
      context.moveTo(places[i].x, places[i].y);
      context.lineTo(places[j].x, places[j].y);
      context.stroke();
    }
    context.setLineDash([]);
  }

  paintTrails(places, at) {
    const { context, episode } = this,
      { x, y } = episode.robots,
      moments = episode.moments;
    const back = Math.round((this.many ? 0.4 : 1) * trailOf(episode)),
      pieces = 4;
    const first = Math.max(at.moment - back, 0);
    context.lineJoin = "round";
    context.lineWidth = Math.min(0.5 * this.body, 4);
    for (let i = 0; i < episode.count; i++) {
      const colour = robotPaint(i),
        row = i * moments;
      for (let piece = 0; piece < pieces; piece++) {
        const from = first + Math.floor(((at.moment - first) * piece) / pieces);
        const to = first + Math.floor(((at.moment - first) * (piece + 1)) / pieces);
        context.strokeStyle = faded(colour, (0.5 * (piece + 1)) / pieces);
        context.beginPath();
        context.moveTo(this.px(x[row + from]), this.py(y[row + from]));
        for (let k = row + from + 1; k <= row + to; k++) context.lineTo(this.px(x[k]), this.py(y[k]));
        if (piece === pieces - 1) context.lineTo(places[i].x, places[i].y);
        context.stroke();
      }
    }
  }

}

// Half of the extent of the whole picture [m]: the rectangle, and the usual positions of robots unless far away.
function extentOf(episode) {
  const { half, radius } = episode.about;
  return [episode.robots.x, episode.robots.y].map((places, axis) => {
    const usual = quantile(places.map(Math.abs), MOSTLY);
    return Math.max(half[axis], Math.min(usual, 1.12 * half[axis])) + 1.3 * radius;
  });
}

// Give pictures side by side a common scale.
export function shareExtents(stages) {
  const shared = [0, 1].map((axis) => Math.max(...stages.map((stage) => stage.extent[axis])));
  for (const stage of stages) stage.extent = shared;
}
