// Draws the targets, undetected, just detected or never detected, and the rogue that a policy misses. Targets that stay
// are green while they are in sight; where targets are seen before they are detected, those out of sight are pale.

import { COLOURS, faded } from "./colours.js";
import { FLEEING } from "./episode.js";

export class Targets {
  constructor(stage) {
    Object.assign(this, { stage, context: stage.context });
  }

  paint(at) {
    const { context, stage } = this,
      { episode } = stage,
      { targets } = episode;
    const step = at.now * episode.raw.every,
      flash = episode.about.flash / episode.raw.step;
    const closer = Math.min(Math.max(Math.sqrt(stage.camera.zoom), 1), 2),
      size = closer * (targets.count > 400 ? 1.8 : targets.count > 150 ? 2.6 : 3.8);
    const { leave, sight, sensing } = episode.about;
    const pale = faded(COLOURS.target, 0.4);
    const colours = leave ? [sight > sensing ? pale : COLOURS.target, COLOURS.target] : [COLOURS.target, COLOURS.found];
    const groups = { plain: [[], []], flees: [[], []], missed: [] };
    for (let t = 0; t < targets.count; t++) {
      if (targets.appears[t] > step) continue;
      const found = targets.found[t],
        place = [stage.px(episode.between(targets.x, t, at)), stage.py(episode.between(targets.y, t, at))];
      if (found >= 0 && found <= step) {
        const age = (step - found) / flash;
        if (age < 1) this.paintFlash(place, age, size);
        if (leave) continue;
      }
      if (found < 0) groups.missed.push(place);
      else groups[targets.motion[t] === FLEEING ? "flees" : "plain"][targets.seen[t * episode.moments + at.moment]].push(place);
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
    if (size > 2) dots([...groups.plain, ...groups.flees].flat(), COLOURS.card, size + 1.2);
    colours.forEach((colour, k) => dots([...groups.plain[k], ...groups.flees[k]], colour, size));
    dots(groups.flees.flat(), COLOURS.card, 0.42 * size);
    this.paintMissed(groups.missed, size);
  }

  // Draw a target that is never detected: a cross in a ring.
  paintMissed(places, size) {
    const { context } = this,
      arm = 0.62 * size;
    for (const [colour, wider] of [
      [COLOURS.card, 2.4],
      [COLOURS.target, 0],
    ]) {
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

  paintFlash([x, y], age, size) {
    const { context } = this;
    context.fillStyle = faded(COLOURS.found, (1 - age) ** 1.5);
    context.beginPath();
    context.arc(x, y, size, 0, 2 * Math.PI);
    context.fill();
    this.stage.bodies.ring(x, y, size * (1.6 + 2.6 * age), faded(COLOURS.found, 1 - age), 2);
  }
}

// Draw the path of a rogue so far and, once it is there, its place: a diamond in a ring.
export function paintRogue(stage, at) {
  const { rogue, every } = stage.episode.raw;
  if (!rogue) return;
  const { context } = stage,
    step = at.now * every,
    { begin, until, places } = rogue;
  if (step < begin || step > until + stage.episode.about.flash / stage.episode.raw.step) return;
  const passed = Math.min((step - begin) / rogue.every, places.length - 1),
    before = Math.floor(passed);
  const after = places[Math.min(before + 1, places.length - 1)];
  const [x, y] = places[before].map((from, axis) => from + (passed - before) * (after[axis] - from));
  context.strokeStyle = faded(COLOURS.unseen, 0.75);
  context.lineWidth = 1.6;
  context.beginPath();
  for (const place of [...places.slice(0, before + 1), [x, y]]) context.lineTo(stage.px(place[0]), stage.py(place[1]));
  context.stroke();
  const [px, py] = [stage.px(x), stage.py(y)];
  context.lineWidth = 2;
  context.fillStyle = step < until ? COLOURS.unseen : COLOURS.found;
  context.strokeStyle = COLOURS.card;
  context.beginPath();
  for (const [right, down] of [[0, -7], [6, 0], [0, 7], [-6, 0]]) context.lineTo(px + right, py + down);
  context.closePath();
  context.fill();
  context.stroke();
}
