// Wheel, drag and pinch zoom and move a picture from above; other touches are clicks.

const STILL = 4;

export function bindGestures(canvas, stage, onLook) {
  const fingers = new Map();
  let moved = false,
    before = null;
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  canvas.addEventListener(
    "wheel",
    (event) => {
      const lines = event.deltaMode === 1 ? 33 : 1;
      // When zoomed out completely, the page scrolls.
      if (event.deltaY > 0 && stage.camera.isWhole && !event.ctrlKey) return;
      event.preventDefault();
      const factor = Math.exp(-0.002 * lines * event.deltaY * (event.ctrlKey ? 4 : 1));
      stage.zoomBy(event.ctrlKey ? factor : Math.max(factor, 1 / stage.camera.zoom), ...place(event));
      onLook();
    },
    { passive: false },
  );
  canvas.addEventListener("pointerdown", (event) => {
    if (event.button > 0) return;
    if (fingers.size === 0) moved = false;
    fingers.set(event.pointerId, place(event));
    before = spanOf(fingers);
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!fingers.has(event.pointerId)) return;
    const after = new Map(fingers).set(event.pointerId, place(event)),
      now = spanOf(after);
    moved ||= fingers.size > 1 || Math.hypot(now.x - before.x, now.y - before.y) > STILL;
    if (!moved) return;
    canvas.setPointerCapture(event.pointerId);
    fingers.set(event.pointerId, place(event));
    stage.panBy(now.x - before.x, now.y - before.y);
    if (before.wide > 0) stage.zoomBy(now.wide / before.wide, now.x, now.y);
    before = now;
    onLook();
  });
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (event) => {
      fingers.delete(event.pointerId);
      before = spanOf(fingers);
    });
  }
  canvas.addEventListener("click", (event) => moved && event.stopImmediatePropagation(), true);
}

// Return the centre of the fingers and the distance of two of them [px].
function spanOf(fingers) {
  const [first, second] = [...fingers.values()];
  if (!first) return null;
  if (!second) return { x: first[0], y: first[1], wide: 0 };
  const wide = Math.max(Math.hypot(first[0] - second[0], first[1] - second[1]), 1);
  return { x: (first[0] + second[0]) / 2, y: (first[1] + second[1]) / 2, wide };
}
