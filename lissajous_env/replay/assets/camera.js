// The part of the world that the pictures from above show: zoom and middle, one for all of them.

const LEAST_ZOOM = 0.25;
const MOST_ZOOM = 64;

export class Camera {
  constructor() {
    this.whole();
  }

  // The whole rectangle, in the middle.
  whole() {
    this.zoom = 1;
    this.x = this.y = 0;
  }

  get isWhole() {
    return this.zoom === 1 && this.x === 0 && this.y === 0;
  }

  // Zoom so that a point of the world [m] stays where it is; `reach` bounds the middle [m].
  zoomBy(factor, x, y, reach) {
    const zoom = Math.min(Math.max(this.zoom * factor, LEAST_ZOOM), MOST_ZOOM),
      by = this.zoom / zoom;
    // Zoomed out again the picture is exactly what it was at first.
    if (Math.abs(zoom - 1) < 1e-3) return this.whole();
    this.zoom = zoom;
    this.moveTo(x + (this.x - x) * by, y + (this.y - y) * by, reach);
  }

  moveTo(x, y, reach) {
    this.x = Math.min(Math.max(x, -reach[0]), reach[0]);
    this.y = Math.min(Math.max(y, -reach[1]), reach[1]);
  }
}
