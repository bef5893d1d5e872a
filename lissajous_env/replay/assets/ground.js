// The ground: time since cells were last sensed, or for which a target can have stayed there undetected.

import { COLOURS, parts } from "./colours.js";

const RAMP = 64;
// For each layer: its name, its multiple of T_max with the full colour, its least and its full opacity.
const LAYERS = {
  unseen: { words: "Undetected time", bounds: 1.25, opacity: [0.1, 0.62] },
  idle: { words: "Idleness", bounds: 2, opacity: [0, 0.5] },
  none: { words: "Plain" },
};

export class Ground {
  constructor(episode) {
    this.episode = episode;
    this.canvas = document.createElement("canvas");
    this.shown = "";
    this.stored = { unseen: episode.ground.unseen, idle: episode.ground.sensed };
  }

  // Return the layers of the scenario: [name, words].
  layers() {
    const there = Object.entries(LAYERS).filter(([layer]) => layer === "none" || this.stored[layer]);
    return there.map(([layer, { words }]) => [layer, words]);
  }

  // Age with the full colour [s]: a multiple of T_max, so that pictures of a scenario are comparable, or all of the episode.
  full(layer) {
    return Math.min(LAYERS[layer].bounds * this.episode.about.bound, this.episode.duration);
  }

  // Return a canvas with a pixel per cell at a moment, highest row first; null if there is nothing to draw.
  picture(layer, exact) {
    if (!this.stored[layer]) return null;
    const { cells, stride } = this.stored[layer],
      { raw } = this.episode,
      [rows, columns, pictures] = cells.shape;
    const index = Math.min(Math.floor((exact * raw.every) / stride + 1e-6), pictures - 1);
    const key = `${layer} ${index}`;
    if (key === this.shown) return this.canvas;
    this.shown = key;
    this.canvas.width = columns;
    this.canvas.height = rows;
    const context = this.canvas.getContext("2d"),
      image = context.createImageData(columns, rows),
      pixels = new Uint32Array(image.data.buffer);
    const ramp = rampOf(COLOURS[layer], LAYERS[layer].opacity),
      scale = ((RAMP - 1) * raw.step) / this.full(layer);
    for (let row = 0; row < rows; row++) {
      for (let column = 0; column < columns; column++) {
        const since = cells[(row * columns + column) * pictures + index];
        const shade = Math.min(Math.max(Math.ceil((index * stride - since) * scale), 0), RAMP - 1);
        pixels[(rows - 1 - row) * columns + column] = since === cells.none ? 0 : ramp[shade];
      }
    }
    context.putImageData(image, 0, 0);
    return this.canvas;
  }
}

export function gradientOf(layer) {
  const share = (opacity) => `color-mix(in srgb, var(--${layer}) ${100 * opacity}%, transparent)`;
  return `linear-gradient(90deg, ${LAYERS[layer].opacity.map(share).join(", ")})`;
}

// Colours as pixels of an image, by age.
function rampOf(colour, [least, full]) {
  const [red, green, blue] = parts(colour),
    base = (blue << 16) | (green << 8) | red;
  return Uint32Array.from({ length: RAMP }, (_, k) => {
    const opacity = least + ((full - least) * k) / (RAMP - 1);
    return ((Math.round(255 * opacity) << 24) | base) >>> 0;
  });
}
