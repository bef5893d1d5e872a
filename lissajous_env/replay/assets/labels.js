// Places of the robots' numbers: beside their robots, if possible without overlaps.

const SIDES = [
  [1, -1],
  [1, 1],
  [-1, -1],
  [-1, 1],
  [1, 0],
  [-1, 0],
  [0, -1],
  [0, 1],
];
const HIGH = 13;
const DIGIT = 7.5;

export class Labels {
  constructor() {
    this.sides = new Map();
  }

  // Return places [px] of the numbers of robots {i, x, y} with bodies of a size; a number stays on its side
  // while there is space.
  place(robots, size, width, height) {
    const boxes = robots.map(({ x, y }) => [x - size, y - size, x + size, y + size]),
      placed = [];
    return robots.map(({ i, x, y }, own) => {
      const wide = DIGIT * String(i).length + 2;
      const boxOn = ([right, down]) => {
        const slanted = right && down ? 0.78 : 1.15;
        const cx = x + right * (slanted * size + (right && down ? 7 : 2 + wide / 2)),
          cy = y + down * (slanted * size + (right && down ? 7 : HIGH / 2));
        const inX = Math.min(Math.max(cx, wide / 2), width - wide / 2),
          inY = Math.min(Math.max(cy, HIGH / 2), height - HIGH / 2);
        return [inX - wide / 2, inY - HIGH / 2, inX + wide / 2, inY + HIGH / 2];
      };
      let best = null;
      for (const side of new Set([this.sides.get(i) ?? SIDES[0], ...SIDES])) {
        const box = boxOn(side);
        const shared =
          placed.reduce((sum, other) => sum + 3 * overlap(box, other), 0) +
          boxes.reduce((sum, other, k) => sum + (k === own ? 0.5 : 1) * overlap(box, other), 0);
        if (!best || shared < best.shared - 1) best = { side, box, shared };
        if (best.shared === 0) break;
      }
      this.sides.set(i, best.side);
      placed.push(best.box);
      return [(best.box[0] + best.box[2]) / 2, (best.box[1] + best.box[3]) / 2];
    });
  }
}

// Return the overlap of two boxes [px^2].
function overlap(one, other) {
  const wide = Math.min(one[2], other[2]) - Math.max(one[0], other[0]),
    high = Math.min(one[3], other[3]) - Math.max(one[1], other[1]);
  return wide > 0 && high > 0 ? wide * high : 0;
}
