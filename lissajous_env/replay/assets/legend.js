// The legend of a picture.

import { FLEEING } from "./episode.js";
import { number } from "./words.js";

// Return [[sign, words]] for an episode.
export function legendOf(episode, ground, layer) {
  const { targets } = episode,
    entries = [];
  const kinds = new Set(episode.events.map((event) => event.kind));
  if (targets.count > 0) entries.push(["target", "target"]);
  if (targets.motion.includes(FLEEING)) entries.push(["flees", "evading target"]);
  if (episode.hasSightings) entries.push(episode.about.leave ? ["pale", "out of sight"] : ["seen", "in sight"]);
  if (kinds.has("missed")) entries.push(["missed", "never detected"]);
  if (targets.count > 0) entries.push(["found", "just detected"]);
  if (kinds.has("rogue")) entries.push(["rogue", "the rogue that this policy misses"]);
  if (kinds.has("touch")) entries.push(["touch", "collision"]);
  if (kinds.has("fault")) entries.push(["failed", "failed"]);
  if (episode.losesMessages) entries.push(["lost", "message lost"]);
  const what = { unseen: "target here undetected for", idle: "not covered for" }[layer];
  if (what) entries.push(["ramp", `${what} 0 – ${number(ground.full(layer))} s or more`]);
  return entries;
}
