// Colours by theme. Colours of robots are distinguishable with colour blindness; tests/pictures/test_colours.py checks it.

const LIGHT = {
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
  stuck: "#d97b00",
  removed: "#8d95a0",
  touch: "#e31fc4",
  wheel: "#1f2730",
  glass: "#e3f0fb",
  grid: "#eceff2",
};

const DARK = {
  robots: ["#5a9cf0", "#f0a030", "#00d099", "#d98fc0", "#8a5cf5", "#b5e6fa", "#b06a20", "#eef08b"],
  policies: [
    "#4aa8e8", "#f0ac2e", "#2cc79a", "#e08fbd", "#f0813a", "#8fd0f6", "#b868ff",
    "#b4bcc8", "#8a7dff", "#b4703c", "#c8c864", "#c05cd8", "#c8b4ff",
  ],
  card: "#171d25",
  ground: "#12171e",
  edge: "#4a5665",
  ink: "#e6ebf1",
  muted: "#95a1b0",
  hair: "#2a333e",
  curve: "#52647c",
  link: "#8fa2bc",
  lost: "#ff7a66",
  sensing: "#5fa5e6",
  idle: "#bfa468",
  unseen: "#9a5fd0",
  target: "#ff5a63",
  found: "#2fd39b",
  stuck: "#ffab3d",
  removed: "#7c8795",
  touch: "#ff6fe0",
  wheel: "#05080b",
  glass: "#0f2233",
  grid: "#232b35",
};

export function coloursOf(theme) {
  return theme === "dark" ? DARK : LIGHT;
}

export const ROBOT_COLOURS = LIGHT.robots.length;

// The colour of a robot in a style sheet; colours recur.
export function robotColour(robot) {
  return `var(--robots-${robot % ROBOT_COLOURS})`;
}

// The colour of a robot on a canvas.
export function robotPaint(colours, robot) {
  return colours.robots[robot % ROBOT_COLOURS];
}

// A colour "#rrggbb" with an opacity.
export function faded(colour, opacity) {
  const part = (k) => parseInt(colour.slice(k, k + 2), 16);
  return `rgba(${part(1)}, ${part(3)}, ${part(5)}, ${opacity})`;
}
