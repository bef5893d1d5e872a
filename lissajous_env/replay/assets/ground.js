// The ground: time since cells were last sensed, or for which a target can have stayed there undetected.

import { quantile } from "./words.js";

const RAMP = 64;
const EVERY = 7;
const USUAL = 0.95;

export class Ground {
  constructor(episode) {
    this.episode = episode;
    this.canvas = document.createElement("canvas");
    this.shown = "";
    this.scales = {};
    for (const [layer, share] of [
      ["unseen", 1.25],
      ["idle", 2],
    ]) {
      this.scales[layer] = this.scaleOf(layer, share * episode.about.bound);
    }
  }

  // Return the layers of the scenario: [name, words].
  layers() {
    const found = [];
    if (this.episode.ground.unseen) found.push(["unseen", "Undetected time"]);
    if (this.episode.ground.sensed) found.push(["idle", "Idleness"]);
    return [...found, ["none", "Plain"]];
  }

  kept(layer) {
    return { unseen: this.episode.ground.unseen, idle: this.episode.ground.sensed }[layer] || null;
  }

  // Age with the full colour, and the longest age [s]: a multiple of T_max, so that pictures are comparable,
  // unless most ages of the episode exceed it or all are far below.
  scaleOf(layer, usual) {
    const kept = this.kept(layer),
      ages = [];
    if (!kept) return { full: usual, most: 0 };
    const pictures = kept.shape[2];
    let most = 0;
    for (let k = 0; k < kept.values.length; k++) {
      const age = ((k % pictures) * kept.stride - kept.values[k]) * this.episode.raw.step;
      if (kept.values[k] === kept.none || !(age > 0)) continue;
      if (age > most) most = age;
      if (k % EVERY === 0) ages.push(age);
    }
    return { full: most < usual / 2 ? most || usual : Math.max(usual, quantile(ages, USUAL)), most };
  }

  // Return a canvas with a pixel per cell at a moment, highest row first; null if there is nothing to draw.
  picture(layer, exact, colours) {
    const kept = this.kept(layer);
    if (!kept) return null;
    const [rows, columns, pictures] = kept.shape;
    const step = exact * this.episode.raw.every;
    const index = Math.min(Math.floor(step / kept.stride + 1e-6), pictures - 1);
    const key = `${layer} ${index} ${colours.card}`;
    if (key === this.shown) return this.canvas;
    this.shown = key;
    this.canvas.width = columns;
    this.canvas.height = rows;
    const context = this.canvas.getContext("2d");
    const image = context.createImageData(columns, rows);
    const pixels = new Uint32Array(image.data.buffer);
    const ramp = rampOf(layer === "unseen" ? colours.unseen : colours.idle, layer === "unseen" ? 0.62 : 0.5);
    const now = index * kept.stride,
      scale = (RAMP - 1) / (this.scales[layer].full / this.episode.raw.step);
    for (let row = 0; row < rows; row++) {
      for (let column = 0; column < columns; column++) {
        const since = kept.values[(row * columns + column) * pictures + index];
        const shade = Math.min(Math.max(Math.ceil((now - since) * scale), 0), RAMP - 1);
        // A cell where a target can be is visible at once.
        const least = layer === "unseen" ? 9 : 0;
        pixels[(rows - 1 - row) * columns + column] = since === kept.none ? 0 : ramp[Math.max(shade, least)];
      }
    }
    context.putImageData(image, 0, 0);
    return this.canvas;
  }
}

// Give pictures side by side a common colour scale.
export function shareScales(grounds) {
  for (const layer of ["unseen", "idle"]) {
    const scales = grounds.map((ground) => ground.scales[layer]);
    const [full, most] = ["full", "most"].map((name) => Math.max(...scales.map((scale) => scale[name])));
    for (const ground of grounds) ground.scales[layer] = { full, most };
  }
}

export function gradientOf(layer) {
  const [least, most] = layer === "unseen" ? [12, 62] : [0, 50];
  const share = (percent) => `color-mix(in srgb, var(--${layer}) ${percent}%, transparent)`;
  return `linear-gradient(90deg, ${share(least)}, ${share(most)})`;
}

// Colours as pixels of an image, by age.
function rampOf(colour, most) {
  const part = (k) => parseInt(colour.slice(k, k + 2), 16);
  const base = (part(5) << 16) | (part(3) << 8) | part(1);
  return Uint32Array.from({ length: RAMP }, (_, k) => ((Math.round((255 * most * k) / (RAMP - 1)) << 24) | base) >>> 0);
}
