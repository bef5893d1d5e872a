// Scales from values to shares of a width, and their ticks.

// Linear from 0 on; where the largest is far beyond the middle one, or `bend`, by asinh: linear near 0, then logarithmic.
// Nearby `lines` [[value, words]] are included.
export function scaleOf(values, lines, bend = 0) {
  const known = values.filter((value) => value !== null && Number.isFinite(value)).sort((a, b) => a - b);
  const most = Math.max(...known.slice(-1), 0),
    least = Math.min(...known.slice(0, 1), 0);
  const reached = Math.max(most, ...lines.map(([value]) => value).filter((value) => value < 1.6 * most));
  const far = reached > least ? reached : least + 1;
  const middle = bend || known[Math.floor(known.length / 2)] || far;
  const bent = least >= 0 && far > 10 * middle ? Math.max(middle, far / 1e4) : 0;
  const of = bent ? (value) => Math.asinh(value / bent) : (value) => value;
  const pad = 0.04 * (of(far) - of(least)),
    low = of(least) - (least < 0 ? pad : 0),
    high = of(far) + pad;
  const place = (value) => (of(value) - low) / (high - low || 1);
  return { place, far, least, bent, holds: (value) => value >= least && place(value) <= 1 };
}

// Return a few round ticks of a scale.
export function roundOf(scale, most = 4) {
  if (scale.bent) {
    const marks = [0],
      first = Math.ceil(Math.log10(scale.bent / 2)),
      last = Math.floor(Math.log10(scale.far));
    const ladder = last - first < 2 ? [1, 2, 5] : [1];
    for (let power = first; power <= last; power++)
      marks.push(...ladder.map((factor) => factor * 10 ** power).filter((value) => value <= scale.far));
    const stride = Math.ceil((marks.length - 1) / Math.max(most - 1, 1));
    return marks.filter((_, k) => k === 0 || (marks.length - 1 - k) % stride === 0);
  }
  const span = scale.far - scale.least || 1,
    rough = 10 ** Math.floor(Math.log10(span / most));
  const step = [1, 2, 5, 10].map((factor) => factor * rough).find((value) => span / value <= most);
  const marks = [];
  for (let k = Math.ceil(scale.least / step); k * step <= scale.far + 1e-9 * span; k++)
    marks.push(Number((k * step).toPrecision(6)));
  return marks;
}

// Linear between two values.
export function linear(least, far) {
  const place = (value) => (value - least) / (far - least || 1);
  return { place, far, least, bent: 0, holds: (value) => value >= least && value <= far };
}
