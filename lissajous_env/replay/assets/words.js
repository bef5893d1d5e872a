// Numbers in words, and elements with words.

// A number with about three digits that matter.
export function number(value) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size > 1e-6 && size < 1e-2) return String(Number(value.toPrecision(2)));
  return size >= 1e5 ? value.toExponential(1) : decimals(value, size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3);
}

// A number with so many decimals; what is rounded to zero has no sign.
export function decimals(value, count) {
  return value.toFixed(count).replace(/^-(0(?:\.0+)?)$/, "$1");
}

// The same, whole numbers as they are.
export function rounded(value) {
  return Number.isInteger(value) && Math.abs(value) < 1e5 ? String(value) : number(value);
}

// A mark on an axis.
export function mark(value) {
  return Math.abs(value) >= 1e4 ? value.toExponential(0) : String(Number(value.toPrecision(6)));
}

// The number below which a share of numbers lies, of many of them about.
export function quantile(values, share) {
  const every = Math.ceil(values.length / 100000);
  const some = values.filter((_, k) => k % every === 0).sort((one, other) => one - other);
  return some.length ? some[Math.min(Math.floor(share * some.length), some.length - 1)] : 0;
}

export function element(kind, name = "", words = "") {
  const made = document.createElement(kind);
  if (name) made.className = name;
  if (words) made.textContent = words;
  return made;
}
