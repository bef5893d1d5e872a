// What the signs on the picture mean.

import { FLEEING } from "./episode.js";

// [[sign, words]] for what an episode shows.
export function legendOf(episode, ground, layer) {
  const { targets } = episode.raw,
    entries = [];
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
