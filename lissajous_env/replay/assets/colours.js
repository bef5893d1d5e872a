// Colours by theme. Those of the robots are told apart with two kinds of cones too; tests/test_replay_page.py measures it.

const LIGHT = {
  robots: ["#0b6bcb", "#e08a00", "#00856a", "#c2569a", "#5b4bb7", "#4aa9d8", "#8a5a2b", "#7a8b00"],
  card: "#ffffff", ground: "#fdfdfc", edge: "#b3bcc7", ink: "#1d2733", muted: "#66717f", hair: "#e3e6ea",
  curve: "#8fa3bd", link: "#4d5f78", lost: "#d23c2a", sensing: "#3d82c4", idle: "#d9b46a", unseen: "#8a3a86",
  rogue: "#d3202f", found: "#00a06d", stuck: "#d97b00", removed: "#8d95a0", touch: "#d61fb4", wheel: "#1f2730",
  glass: "#e3f0fb", grid: "#eceff2",
};

const DARK = {
  robots: ["#5aa9f5", "#f2a93b", "#2fc19f", "#ee8fc6", "#a595ff", "#9adcf7", "#c99363", "#c3d348"],
  card: "#171d25", ground: "#12171e", edge: "#4a5665", ink: "#e6ebf1", muted: "#95a1b0", hair: "#2a333e",
  curve: "#52647c", link: "#8fa2bc", lost: "#ff7a66", sensing: "#5fa5e6", idle: "#c99a3f", unseen: "#c06bbb",
  rogue: "#ff5a63", found: "#2fd39b", stuck: "#ffab3d", removed: "#7c8795", touch: "#ff6fe0", wheel: "#05080b",
  glass: "#0f2233", grid: "#232b35",
};

export function coloursOf(theme) {
  return theme === "dark" ? DARK : LIGHT;
}

export function robotColour(colours, robot) {
  return colours.robots[robot % colours.robots.length];
}

// A colour "#rrggbb" with an opacity.
export function faded(colour, opacity) {
  const part = (k) => parseInt(colour.slice(k, k + 2), 16);
  return `rgba(${part(1)}, ${part(3)}, ${part(5)}, ${opacity})`;
}
