// Decode the arrays of lissajous_env/replay/packing.py.

const KINDS = { 8: Uint8Array, 16: Uint16Array, 32: Uint32Array };

// Decode whole numbers: {values, shape, none}; the last axis is time.
export async function wholes(packed) {
  const bytes = Uint8Array.from(atob(packed.data), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const planes = new Uint8Array(await new Response(stream).arrayBuffer());
  const size = packed.bits / 8,
    count = planes.length / size;
  const values = new KINDS[packed.bits](count);
  for (let plane = 0; plane < size; plane++) {
    for (let k = 0; k < count; k++) values[k] |= planes[plane * count + k] << (8 * plane);
  }
  const length = packed.shape[packed.shape.length - 1];
  for (let k = 1; k < count; k++) if (k % length !== 0) values[k] += values[k - 1];
  return { values, shape: packed.shape, none: packed.none };
}

// Decode numbers: {values, shape}.
export async function reals(packed) {
  const whole = await wholes(packed);
  return { values: Float32Array.from(whole.values, (q) => packed.low + packed.scale * q), shape: whole.shape };
}
