// Colours of canvases and style sheets. Those of robots are distinguishable with colour blindness; tests/pictures/test_colours.py checks it.

export const COLOURS = {
  robots: ["#0b62d0", "#c96e00", "#009758", "#e05aa8", "#5a108e", "#00b8f0", "#5d2b23", "#ddb000"],
  policies: [
    "#0072b2", "#d98e00", "#009e73", "#c2649a", "#d55e00", "#3aa0dc", "#962dff",
    "#4a4f57", "#3c2da5", "#692d00", "#9a9a3c", "#5a1e69", "#9678ff",
  ],
  card: "#ffffff",
  ground: "#fdfdfc",
  edge: "#b3bcc7",
  ink: "#1d2733",
  muted: "#66717f",
  hair: "#e3e6ea",
  curve: "#8fa3bd",
  link: "#4d5f78",
  lost: "#d23c2a",
  sensing: "#3d82c4",
  idle: "#d9b46a",
  unseen: "#6a2c74",
  target: "#d3202f",
  found: "#00a06d",
  failed: "#d97b00",
  removed: "#8d95a0",
  touch: "#e31fc4",
  wheel: "#1f2730",
  glass: "#e3f0fb",
  grid: "#eceff2",
};

export const ROBOT_COLOURS = COLOURS.robots.length;

// Give the page the colours as properties: `--ink`, and with an index `--robots-0` and `--policies-0`.
export function paintPage() {
  const { style } = document.documentElement;
  for (const [name, colours] of Object.entries(COLOURS)) {
    if (typeof colours === "string") style.setProperty(`--${name}`, colours);
    else for (const [k, colour] of colours.entries()) style.setProperty(`--${name}-${k}`, colour);
  }
}

// The colour of a robot in a style sheet; colours recur.
export function robotColour(robot) {
  return `var(--robots-${robot % ROBOT_COLOURS})`;
}

// The colour of a robot on a canvas.
export function robotPaint(robot) {
  return COLOURS.robots[robot % ROBOT_COLOURS];
}

// Red, green and blue of a colour "#rrggbb".
export function parts(colour) {
  return [1, 3, 5].map((k) => parseInt(colour.slice(k, k + 2), 16));
}

// A colour "#rrggbb" with an opacity.
export function faded(colour, opacity) {
  return `rgba(${parts(colour).join(", ")}, ${opacity})`;
}
