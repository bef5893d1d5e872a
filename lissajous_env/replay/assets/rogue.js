// The rogue that a policy misses: an event, a sign of the legend, and its path and place in the picture.

import { faded } from "./colours.js";
import { number } from "./words.js";

// Return the event of a rogue.
export function rogueEvent({ steps, until, detected }, step) {
  const words = `the rogue that this policy misses: undetected for ${number((until - steps[0]) * step)} s`;
  const ends = detected ? `, then detected at ${number(until * step)} s` : ", until the end";
  return { kind: "rogue", time: steps[0] * step, until: until * step, robots: [], words: words + ends };
}

// Draw the path of a rogue so far and, once it is there, its place: a diamond in a ring.
export function paintRogue(stage, at, colours) {
  const { rogue, every } = stage.episode.raw;
  if (!rogue) return;
  const { context } = stage,
    step = at.now * every,
    { steps, places } = rogue;
  if (step < steps[0] || step > rogue.until + stage.episode.about.flash / stage.episode.raw.step) return;
  const next = steps.findIndex((each) => each > step),
    after = next < 0 ? steps.length : next;
  const share = next < 0 ? 0 : (step - steps[after - 1]) / (steps[after] - steps[after - 1]);
  const [x, y] = [0, 1].map((axis) => {
    const [from, to] = [places[after - 1][axis], (places[after] || places[after - 1])[axis]];
    return from + share * (to - from);
  });
  context.strokeStyle = faded(colours.unseen, 0.75);
  context.lineWidth = 1.6;
  context.beginPath();
  for (const place of [...places.slice(0, after), [x, y]]) context.lineTo(stage.px(place[0]), stage.py(place[1]));
  context.stroke();
  const [px, py] = [stage.px(x), stage.py(y)];
  context.lineWidth = 2;
  context.fillStyle = step < rogue.until ? colours.unseen : colours.found;
  context.strokeStyle = colours.card;
  context.beginPath();
  for (const [right, down] of [[0, -7], [6, 0], [0, 7], [-6, 0]]) context.lineTo(px + right, py + down);
  context.closePath();
  context.fill();
  context.stroke();
}
