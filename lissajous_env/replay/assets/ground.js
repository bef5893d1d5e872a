// What lies on the ground: for how long cells were not sensed, or since when a rogue can be in them unseen.

import { faded } from "./colours.js";

const RAMP = 64;

export class Ground {
  constructor(episode) {
    this.episode = episode;
    this.canvas = document.createElement("canvas");
    this.shown = "";
  }

  // The layers that the scenario keeps: [name, words].
  layers() {
    const found = [];
    if (this.episode.ground.unseen) found.push(["unseen", "Rogue unseen"]);
    if (this.episode.ground.sensed) found.push(["idle", "Idleness"]);
    return [...found, ["none", "Plain"]];
  }

  // Age that is drawn in full [s].
  full(layer) {
    return (layer === "unseen" ? 1.25 : 2) * this.episode.about.bound;
  }

  // A canvas of one pixel a cell at a moment, the highest row first; null where nothing is to be drawn.
  picture(layer, exact, colours) {
    const kept = layer === "unseen" ? this.episode.ground.unseen : layer === "idle" ? this.episode.ground.sensed : null;
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
      scale = (RAMP - 1) / (this.full(layer) / this.episode.raw.step);
    for (let row = 0; row < rows; row++) {
      for (let column = 0; column < columns; column++) {
        const since = kept.values[(row * columns + column) * pictures + index];
        const shade = Math.min(Math.max(Math.ceil((now - since) * scale), 0), RAMP - 1);
        // A cell that a rogue can be in shows at once, however short it is there.
        const least = layer === "unseen" ? 9 : 0;
        pixels[(rows - 1 - row) * columns + column] = since === kept.none ? 0 : ramp[Math.max(shade, least)];
      }
    }
    context.putImageData(image, 0, 0);
    return this.canvas;
  }
}

export function gradientOf(layer, colours) {
  const [colour, most] = layer === "unseen" ? [colours.unseen, 0.62] : [colours.idle, 0.5];
  return `linear-gradient(90deg, ${faded(colour, layer === "unseen" ? 0.12 : 0)}, ${faded(colour, most)})`;
}

// Colours as pixels of an image, by age.
function rampOf(colour, most) {
  const part = (k) => parseInt(colour.slice(k, k + 2), 16);
  const base = (part(5) << 16) | (part(3) << 8) | part(1);
  return Uint32Array.from({ length: RAMP }, (_, k) => ((Math.round((255 * most * k) / (RAMP - 1)) << 24) | base) >>> 0);
}
