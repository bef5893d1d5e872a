// Zoom and centre of the pictures from above, shared by all of them.

const LEAST_ZOOM = 0.25;
const MOST_ZOOM = 64;

export class Camera {
  constructor() {
    this.whole();
  }

  // Show the whole rectangle.
  whole() {
    this.zoom = 1;
    this.x = this.y = 0;
  }

  get isWhole() {
    return this.zoom === 1 && this.x === 0 && this.y === 0;
  }

  // Zoom around a point of the world [m]; `reach` bounds the centre [m].
  zoomBy(factor, x, y, reach) {
    const zoom = Math.min(Math.max(this.zoom * factor, LEAST_ZOOM), MOST_ZOOM),
      by = this.zoom / zoom;
    // Zooming out completely restores the initial picture.
    if (Math.abs(zoom - 1) < 1e-3) return this.whole();
    this.zoom = zoom;
    this.moveTo(x + (this.x - x) * by, y + (this.y - y) * by, reach);
  }

  moveTo(x, y, reach) {
    this.x = Math.min(Math.max(x, -reach[0]), reach[0]);
    this.y = Math.min(Math.max(y, -reach[1]), reach[1]);
  }
}
