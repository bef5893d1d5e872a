// The world from above on a canvas: ground, sensors, curve, ring, trails, rogues, robots.

import { faded, robotColour } from "./colours.js";
import { edges, FLEEING, REMOVED, STUCK } from "./episode.js";
import { Ground } from "./ground.js";

export const TRAIL = 3;
const FLASH = 1;
const PARTS = { WHEEL: "wheel", GROUND: "card", GLASS: "glass" };

export class Stage {
  constructor(canvas, episode) {
    Object.assign(this, { canvas, episode, ground: new Ground(episode), edges: edges(episode) });
    this.context = canvas.getContext("2d");
    this.base = document.createElement("canvas");
    this.many = episode.count > 40;
    this.nearest = [];
    this.extent = extentOf(episode);
  }

  // Height of the stage for a width [px].
  heightFor(width) {
    return Math.round(Math.min(Math.max((width * this.extent[1]) / this.extent[0], 170), 620));
  }

  resize(width, height, ratio) {
    const { radius } = this.episode.about, pad = 6;
    this.width = width;
    this.height = height;
    this.ratio = ratio;
    this.canvas.width = Math.round(width * ratio);
    this.canvas.height = Math.round(height * ratio);
    this.scale = Math.min((width / 2 - pad) / this.extent[0], (height / 2 - pad) / this.extent[1]);
    this.body = Math.max(this.scale * radius, this.many ? 3.4 : 6.5);
    this.shapes = this.episode.about.shape.map(([outline, fill]) => [pathOf(outline, this.body), fill]);
    this.drop = dropOf(this.body);
    this.painted = "";
  }

  // What the picture shows: [sign, words].
  legend(layer) {
    return legendOf(this.episode, this.ground, layer);
  }

  px(x) { return this.width / 2 + this.scale * x; }
  py(y) { return this.height / 2 - this.scale * y; }

  draw(time, view) {
    const { context, episode } = this, colours = view.colours, at = episode.at(time);
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    context.clearRect(0, 0, this.width, this.height);
    this.paintGround(view, at);
    this.paintBase(colours);
    context.drawImage(this.base, 0, 0, this.width, this.height);
    const places = this.places(at);
    this.paintRing(places, at, colours);
    this.paintTrails(at, view);
    this.paintTargets(at, colours);
    this.paintTouches(places, at, colours);
    this.paintRobots(places, at, view);
    this.nearest = places;
  }

  places(at) {
    const { x, y, heading, status } = this.episode.robots;
    return Array.from({ length: this.episode.count }, (_, i) => ({
      x: this.px(this.episode.between(x, i, at)),
      y: this.py(this.episode.between(y, i, at)),
      heading: this.episode.angleBetween(heading, i, at),
      status: status[i * this.episode.moments + at.moment],
    }));
  }

  // The robot at a place [px], or -1.
  pick(x, y) {
    let best = -1, least = Math.max(1.6 * this.body, 18);
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

  paintGround(view, at) {
    const { context, episode } = this, colours = view.colours, box = this.rectangle();
    context.fillStyle = colours.ground;
    context.fillRect(...box);
    context.save();
    context.beginPath();
    context.rect(...box);
    context.clip();
    const picture = this.ground.picture(view.layer, at.now, colours);
    if (picture) {
      context.imageSmoothingEnabled = view.layer !== "unseen" || picture.width > 60;
      context.imageSmoothingQuality = "high";
      context.drawImage(picture, ...box);
    }
    // Discs of a crowd would make one surface.
    const strength = episode.count <= 6 ? 1 : episode.count <= 40 ? 0.55 : 0.15;
    context.fillStyle = faded(colours.sensing, 0.07 * strength);
    context.strokeStyle = faded(colours.sensing, 0.5 * strength);
    context.lineWidth = 1;
    for (const place of this.places(at)) {
      if (place.status === REMOVED || place.status === STUCK) continue;
      context.beginPath();
      context.arc(place.x, place.y, this.scale * episode.about.sensing, 0, 2 * Math.PI);
      context.fill();
      context.stroke();
    }
    context.restore();
  }

  // What never changes: curve and edge.
  paintBase(colours) {
    const key = `${this.width} ${this.height} ${this.ratio} ${colours.card}`;
    if (key === this.painted) return;
    this.painted = key;
    this.base.width = this.canvas.width;
    this.base.height = this.canvas.height;
    const context = this.base.getContext("2d"), curve = this.episode.curve, count = curve.length / 3;
    context.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    context.strokeStyle = faded(colours.curve, this.many ? 0.35 : 0.8);
    context.lineWidth = this.many ? 0.7 : 1.4;
    context.lineJoin = "round";
    context.beginPath();
    for (let k = 0; k < count; k++) context.lineTo(this.px(curve[k]), this.py(curve[count + k]));
    context.closePath();
    context.stroke();
    context.strokeStyle = colours.edge;
    context.lineWidth = 1;
    context.strokeRect(...this.rectangle());
  }

  paintRing(places, at, colours) {
    const { context, episode } = this;
    context.lineWidth = 1.3;
    for (const [i, j] of this.edges) {
      if (places[i].status === REMOVED || places[j].status === REMOVED) continue;
      const lost = isCut(episode, i, j, at.moment);
      context.strokeStyle = lost ? colours.lost : faded(colours.link, this.many ? 0.25 : 0.45);
      context.setLineDash(lost ? [3, 5] : []);
      context.beginPath();
      context.moveTo(places[i].x, places[i].y);
      context.lineTo(places[j].x, places[j].y);
      context.stroke();
    }
    context.setLineDash([]);
  }

  paintTrails(at, view) {
    const { context, episode } = this, { x, y } = episode.robots, moments = episode.moments;
    const back = Math.round((this.many ? 0.4 : 1) * (TRAIL / episode.step)), pieces = 4;
    const first = Math.max(at.moment - back, 0);
    context.lineJoin = "round";
    context.lineWidth = Math.min(0.5 * this.body, 4);
    for (let i = 0; i < episode.count; i++) {
      const colour = robotColour(view.colours, i), row = i * moments;
      for (let piece = 0; piece < pieces; piece++) {
        const from = first + Math.floor(((at.moment - first) * piece) / pieces);
        const to = first + Math.floor(((at.moment - first) * (piece + 1)) / pieces);
        context.strokeStyle = faded(colour, (0.5 * (piece + 1)) / pieces);
        context.beginPath();
        for (let f = from; f <= to; f++) context.lineTo(this.px(x[row + f]), this.py(y[row + f]));
        if (piece === pieces - 1) {
          context.lineTo(this.px(episode.between(x, i, at)), this.py(episode.between(y, i, at)));
        }
        context.stroke();
      }
    }
  }

  paintTargets(at, colours) {
    const { context, episode } = this, { x, y } = episode.targets, raw = episode.raw.targets;
    const step = at.now * episode.raw.every, second = FLASH / episode.raw.step;
    const size = raw.count > 400 ? 1.8 : raw.count > 150 ? 2.6 : 3.8;
    const groups = { plain: [], flees: [], missed: [], stays: [] };
    for (let t = 0; t < raw.count; t++) {
      if (raw.appears[t] > step) continue;
      const found = raw.found[t], place = [this.px(episode.between(x, t, at)), this.py(episode.between(y, t, at))];
      if (found >= 0 && found <= step) {
        const age = (step - found) / second;
        if (age < 1) this.paintFlash(place, age, size, colours);
        if (!episode.about.leave) groups.stays.push(place);
      } else {
        groups[found < 0 ? "missed" : raw.motion[t] === FLEEING ? "flees" : "plain"].push(place);
      }
    }
    const dots = (places, colour, radius) => {
      context.fillStyle = colour;
      context.beginPath();
      for (const [px, py] of places) {
        context.moveTo(px + radius, py);
        context.arc(px, py, radius, 0, 2 * Math.PI);
      }
      context.fill();
    };
    dots(groups.stays, colours.found, size);
    if (size > 2) dots([...groups.plain, ...groups.flees], colours.card, size + 1.2);
    dots(groups.plain, colours.rogue, size);
    dots(groups.flees, colours.rogue, size);
    dots(groups.flees, colours.card, 0.42 * size);
    this.paintMissed(groups.missed, size, colours);
  }

  // One that nobody sees until the end: a cross in a ring.
  paintMissed(places, size, colours) {
    const { context } = this, arm = 0.62 * size;
    context.lineWidth = size > 2 ? 1.7 : 1;
    for (const [colour, wider] of [[colours.card, 2.4], [colours.rogue, 0]]) {
      context.strokeStyle = colour;
      context.lineWidth = (size > 2 ? 1.7 : 1) + wider;
      context.beginPath();
      for (const [x, y] of places) {
        context.moveTo(x + 1.35 * size, y);
        context.arc(x, y, 1.35 * size, 0, 2 * Math.PI);
        context.moveTo(x - arm, y - arm);
        context.lineTo(x + arm, y + arm);
        context.moveTo(x - arm, y + arm);
        context.lineTo(x + arm, y - arm);
      }
      context.stroke();
    }
  }

  paintFlash([x, y], age, size, colours) {
    const { context } = this;
    context.fillStyle = faded(colours.found, (1 - age) ** 1.5);
    context.beginPath();
    context.arc(x, y, size, 0, 2 * Math.PI);
    context.fill();
    context.strokeStyle = faded(colours.found, 1 - age);
    context.lineWidth = 2;
    context.beginPath();
    context.arc(x, y, size * (1.6 + 2.6 * age), 0, 2 * Math.PI);
    context.stroke();
  }

  paintTouches(places, at, colours) {
    const { context } = this;
    context.strokeStyle = colours.touch;
    context.lineWidth = 2.2;
    for (const [i, j, first, last] of this.episode.raw.contacts) {
      if (at.moment < first || at.moment > last) continue;
      const x = (places[i].x + places[j].x) / 2, y = (places[i].y + places[j].y) / 2;
      const apart = Math.hypot(places[i].x - places[j].x, places[i].y - places[j].y) / 2;
      context.beginPath();
      context.arc(x, y, Math.min(apart, 2 * this.body) + 1.25 * this.body + 4, 0, 2 * Math.PI);
      context.stroke();
    }
  }

  paintRobots(places, at, view) {
    const { context } = this, colours = view.colours;
    const order = places.map((_, i) => i).sort((i, j) => (places[j].status === REMOVED) - (places[i].status === REMOVED));
    for (const i of order) {
      const place = places[i], colour = place.status === REMOVED ? colours.removed : robotColour(colours, i);
      if (this.isOutside(place)) {
        this.paintArrow(place, i, colour, colours);
        continue;
      }
      context.save();
      context.translate(place.x, place.y);
      if (i === view.selected) ring(context, this.body + 6, colours.ink, 2);
      if (place.status === REMOVED) this.paintRemoved(colour);
      else this.paintBody(place, colour, colours);
      context.restore();
      if (!this.many || i === view.selected) this.paintNumber(place, i, colour, colours);
    }
  }

  paintBody(place, colour, colours) {
    const { context } = this;
    if (place.status === STUCK) {
      context.setLineDash([4, 3]);
      ring(context, 1.15 * this.body + 3.5, colours.stuck, 2.2);
      context.setLineDash([]);
    }
    if (this.shapes.length) ring(context, this.scale * this.episode.about.radius, faded(colour, 0.75), 1);
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
    const { context } = this, arm = 0.55 * this.body;
    ring(context, this.body, colour, 2);
    context.beginPath();
    context.moveTo(-arm, -arm);
    context.lineTo(arm, arm);
    context.moveTo(-arm, arm);
    context.lineTo(arm, -arm);
    context.stroke();
  }

  paintNumber(place, robot, colour, colours) {
    const { context } = this, inside = this.body > 12 && !this.shapes.length && place.status !== REMOVED;
    const away = inside ? 0 : 0.78 * this.body + 7;
    context.font = `600 ${inside ? Math.min(0.9 * this.body, 16) : 12}px system-ui, sans-serif`;
    context.textAlign = "center";
    context.textBaseline = "middle";
    const x = Math.min(Math.max(place.x + away, 8), this.width - 8);
    const y = Math.min(Math.max(place.y - away, 9), this.height - 9);
    context.lineWidth = 3.5;
    context.lineJoin = "round";
    context.strokeStyle = inside ? faded(colour, 0) : colours.card;
    context.strokeText(String(robot), x, y);
    context.fillStyle = inside ? colours.card : colours.ink;
    context.fillText(String(robot), x, y);
  }

  isOutside({ x, y }) {
    return !(x > -this.body && x < this.width + this.body && y > -this.body && y < this.height + this.body);
  }

  // A robot that has left the picture: an arrow at its edge.
  paintArrow(place, robot, colour, colours) {
    const { context } = this;
    const x = Math.min(Math.max(place.x, 14), this.width - 14), y = Math.min(Math.max(place.y, 14), this.height - 14);
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
    this.paintNumber({ x: x - 24 * Math.cos(way) - 11, y: y - 24 * Math.sin(way) + 11, status: REMOVED }, robot, colour, colours);
  }
}

// Half of what the picture shows [m]: the rectangle, and the robots wherever they went, unless that was far away.
function extentOf(episode) {
  const { half, radius } = episode.about, around = 1.6 * radius;
  return [episode.robots.x, episode.robots.y].map((places, axis) => {
    let reach = half[axis];
    for (const place of places) reach = Math.max(reach, Math.abs(place));
    return Math.min(reach, 1.25 * half[axis] + 2 * radius) + around;
  });
}

// Pictures side by side have one scale.
export function shareExtents(stages) {
  const extents = stages.map((stage) => stage.extent).filter(Boolean);
  for (const stage of stages) stage.extent &&= [0, 1].map((axis) => Math.max(...extents.map((each) => each[axis])));
}

export function legendOf(episode, ground, layer) {
  const { targets } = episode.raw, entries = [];
  const kinds = new Set(episode.events.map((event) => event.kind));
  if (targets.count > 0) entries.push(["rogue", "rogue"]);
  if (targets.motion.includes(FLEEING)) entries.push(["flees", "one that flees"]);
  if (kinds.has("missed")) entries.push(["missed", "never seen"]);
  if (targets.count > 0) entries.push(["found", "just seen"]);
  if (kinds.has("touch")) entries.push(["touch", "touch"]);
  if (kinds.has("fault")) entries.push(["stuck", "stuck"]);
  if (episode.losesMessages) entries.push(["lost", "message lost"]);
  const full = `${Number(ground.full(layer).toPrecision(2))} s`;
  if (layer === "unseen") entries.push(["ramp", `a rogue unseen for 0 – ${full}`]);
  if (layer === "idle") entries.push(["ramp", `not sensed for 0 – ${full}`]);
  return entries;
}

// Whether a message between two robots, in either direction, did not come.
export function isCut(episode, i, j, moment) {
  const sides = (of, from) => episode.about.neighbours[of].map((other, side) => [other, side]).filter(([other]) => other === from);
  const lost = (of, from) => sides(of, from).some(([, side]) => episode.isLost(of, side, moment));
  return lost(i, j) || lost(j, i);
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
  const path = new Path2D(), touch = Math.acos(1 / 1.42);
  path.moveTo(1.42 * radius, 0);
  path.arc(0, 0, radius, touch, 2 * Math.PI - touch);
  path.closePath();
  return path;
}
