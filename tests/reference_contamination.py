"""Possible places of an undetected target: brute force over a fine grid, in float64, with NumPy alone."""

import numpy as np

NOBODY = np.inf


class Field:
    """The field e(x, t) on cells a few of which a rogue moves in a time slice, with exact discs.

    Args:
        sensors: (T + 1, Q, N, 2) places of the sensors in Q slices of each control step, the last one at its end; those
            of the reset are the first row [m].
        half: Half width and half height of the rectangle [m].
        radius: Of the discs [m].
        speed: Of the rogues [m/s].
        step: Control step [s].
        finer: How many cells a rogue moves in a slice. Where they are few, it is slow between the axes: two cells make
            it 29 % slow there, five 5 %.
    """

    def __init__(self, sensors, half, radius, speed, step, finer=5, arrivals=True):
        self.sensors, self.radius = np.asarray(sensors, dtype=float), radius
        slices = self.sensors.shape[1]
        side = speed * step / slices / finer
        self.shape = [int(np.ceil(2 * length / side)) for length in half[::-1]]
        rows, columns = self.shape
        self.y = (np.arange(rows) + 0.5) * 2 * half[1] / rows - half[1]
        self.x = (np.arange(columns) + 0.5) * 2 * half[0] / columns - half[0]
        self.reach = (speed * step / slices) / (2 * half[0] / columns)
        self.arrivals = arrivals

    def sensed(self, places):
        """(rows, columns) whether a cell is in a disc."""
        seen = np.zeros(self.shape, dtype=bool)
        for x, y in places:
            if np.isfinite([x, y]).all() and abs(x) < 1e6:
                seen |= (self.x - x) ** 2 + (self.y[:, None] - y) ** 2 < self.radius**2
        return seen

    def spread(self, field):
        """Least value in the disc that a rogue can come from in a slice."""
        n = int(self.reach + 1e-9)
        rows, columns = field.shape
        wide = np.pad(field, n, constant_values=NOBODY)
        least = field.copy()
        for j in range(-n, n + 1):
            for i in range(-n, n + 1):
                if i * i + j * j <= self.reach**2 + 1e-9:
                    np.minimum(least, wide[n + j : n + j + rows, n + i : n + i + columns], out=least)
        return least

    def run(self, keep=False):
        """(T + 1,) t - min e after each step [step]; with `keep` also the fields of each slice, in order."""
        field = np.zeros(self.shape)
        field[self.sensed(self.sensors[0, -1])] = NOBODY
        fields, ages = [field], [0.0]
        for now in range(1, len(self.sensors)):
            for places in self.sensors[now]:
                field = self.spread(field)
                if self.arrivals:
                    field = np.minimum(field, now)
                field[self.sensed(places)] = NOBODY
                if keep:
                    fields.append(field)
            oldest = field.min()
            ages.append(now - oldest if np.isfinite(oldest) else 0.0)
        return (np.array(ages), fields) if keep else np.array(ages)

    def rogue(self, fields, until):
        """(slices + 1, 2) the way of the rogue that is unseen for longest at slice `until`, from its introduction [m].

        It is found backwards: each of its places is one from which the next can be reached, as old as that.
        """
        n = int(self.reach + 1e-9)
        row, column = np.unravel_index(np.argmin(fields[until]), self.shape)
        born = fields[until][row, column]
        way = [(row, column)]
        for k in range(until - 1, -1, -1):
            near = [
                (j * j + i * i, row + j, column + i)
                for j in range(-n, n + 1)
                for i in range(-n, n + 1)
                if j * j + i * i <= self.reach**2 + 1e-9
                and 0 <= row + j < self.shape[0]
                and 0 <= column + i < self.shape[1]
            ]
            older = [(away, j, i) for away, j, i in near if fields[k][j, i] <= born]
            if not older:
                break
            _, row, column = min(older)
            way.append((row, column))
        return np.array([(self.x[i], self.y[j]) for j, i in way[::-1]])


def sensors_of(simulation, slices):
    """(Q, N, 2) places of the sensors in equal slices of the latest step of world 0, of robots that work now."""
    track = simulation.robots.path.numpy()[0, :, :, :2].astype(float)
    last = track.shape[1] - 1
    at = np.arange(1, slices + 1) / slices * last
    low = np.minimum(at.astype(int), last - 1)
    share = (at - low)[None, :, None]
    places = (1 - share) * track[:, low] + share * track[:, low + 1]
    places[np.abs(simulation.robots.sensor.numpy()[0, :, 0]) > 1e6] = np.nan
    return places.transpose(1, 0, 2)
