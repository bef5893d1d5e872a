// The wheel zooms a picture from above and a drag moves it; other touches are clicks.

const STILL = 4;

export function bindGestures(canvas, stage, onLook) {
  let before = null,
    moved = false;
  const place = (event) => {
    const box = canvas.getBoundingClientRect();
    return [event.clientX - box.left, event.clientY - box.top];
  };
  canvas.addEventListener(
    "wheel",
    (event) => {
      // When zoomed out completely, the page scrolls.
      if (event.deltaY > 0 && stage.camera.isWhole) return;
      event.preventDefault();
      const lines = event.deltaMode === 1 ? 33 : 1;
      stage.zoomBy(Math.max(Math.exp(-0.002 * lines * event.deltaY), 1 / stage.camera.zoom), ...place(event));
      onLook();
    },
    { passive: false },
  );
  canvas.addEventListener("pointerdown", (event) => {
    if (event.button > 0) return;
    before = place(event);
    moved = false;
  });
  canvas.addEventListener("pointermove", (event) => {
    if (!before) return;
    const now = place(event),
      by = now.map((value, axis) => value - before[axis]);
    moved ||= Math.hypot(...by) > STILL;
    if (!moved) return;
    canvas.setPointerCapture(event.pointerId);
    stage.panBy(...by);
    before = now;
    onLook();
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => (before = null));
  canvas.addEventListener("click", (event) => moved && event.stopImmediatePropagation(), true);
}
