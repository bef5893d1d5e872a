// Format numbers and create elements.

// Format a number with about three significant digits.
export function number(value) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  if (size > 1e-6 && size < 1e-2) return String(Number(value.toPrecision(2)));
  return size >= 1e5 ? value.toExponential(1) : decimals(value, size >= 100 ? 0 : size >= 10 ? 1 : size >= 1 ? 2 : 3);
}

// Format a number with decimals; zero has no sign.
export function decimals(value, count) {
  return value.toFixed(count).replace(/^-(0(?:\.0+)?)$/, "$1");
}

// Format like `number`, but whole numbers exactly.
export function rounded(value) {
  return Number.isInteger(value) && Math.abs(value) < 1e5 ? String(value) : number(value);
}

// Format a tick of an axis.
export function mark(value) {
  return Math.abs(value) >= 1e4 ? value.toExponential(0) : String(Number(value.toPrecision(6)));
}

// Return a quantile, approximately for many numbers.
export function quantile(values, share) {
  const every = Math.ceil(values.length / 100000);
  const some = values.filter((_, k) => k % every === 0).sort((one, other) => one - other);
  return some.length ? some[Math.min(Math.floor(share * some.length), some.length - 1)] : 0;
}

// Return the element with an id.
export const byId = (name) => document.getElementById(name);

// Create an element of a class with text and other elements in it.
export function element(kind, name = "", ...content) {
  const part = document.createElement(kind);
  if (name) part.className = name;
  part.append(...content.filter((child) => child !== ""));
  return part;
}

export function button(name, words, onclick = null) {
  return Object.assign(element("button", name, words), { type: "button", onclick });
}
