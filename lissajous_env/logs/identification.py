"""Identify the constants of the car model (12) from a log, by least squares on predicted motion.

The log of a car is cut into segments. Each is predicted by the model from a start that is fitted too, so that noise of
the first pose does not matter, and the constants are those of the smallest sum of squared differences in x, y, heading
and speed, each in units of its own deviation. The dead zone, on which a prediction does not depend smoothly, is the
best of the values between the throttles of the log.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from lissajous_env.logs.car_input import LARGEST_STEERING
from lissajous_env.logs.log import Series, Track
from lissajous_env.logs.motion import SOME, local_deviations, motion_of
from lissajous_env.logs.rollouts import CONSTANTS, Rollouts
from lissajous_env.settings.robot import Robot
from lissajous_env.wording import few_of
from lissajous_env.world.state import WORKING

_SEGMENT = 2.0
"""Duration of a segment [s]."""
_GAP = 0.5
"""Longest time between two poses from which a speed is computed [s]."""
_MOST_SEGMENTS = 120
_MOST_ZONES = 48
"""Values of the dead zone that are compared at once."""
_ZONES_FITTED = 6
"""Values of the dead zone to each side that are compared together with the best constants of each."""
_CHANGE = 1e-3
"""Relative change for derivatives; for the delay in seconds."""
_ZONE, _DELAY = CONSTANTS.index("dead_zone"), CONSTANTS.index("delay")
_SMOOTH = [k for k in range(len(CONSTANTS)) if k != _ZONE]
_LEAST = np.array([1e-4, 1e-5, 1e-5, 0.0, 0.0])
"""Least values of the smooth constants."""
_LEAST_UNIT = np.array([1e-3, 1e-2, 1e-2, 1e-1, 1.0])
"""Least units in which they are fitted."""
_ROUNDING = 1e-5
"""Least relative standard error: predictions are computed in single precision."""
_NOISES, _SPREAD = 4.0, 0.05
"""Factors on the noise of the log and on the spread of the motion in a segment, up to which residuals are no misfit."""
_CALM = 0.1
"""Quantile of the deviations from smooth motion that counts as noise: a car that turns fast deviates, too."""
_FIRST_STEPS = 6
"""Steps to the best starts with which a fit begins."""
_SHARES = np.array([1.0, 0.3, 0.1, 0.0])
"""Shares of a step to the best start that are compared."""
_FIRST_SCALE = np.array([0.01, 0.01, 0.02, 0.02])


INPUTS = ("steering", "throttle")
"""Names of the commands."""


@dataclass(frozen=True)
class Identified:
    """Constants of a car with their standard errors."""

    values: dict[str, float]
    """Value of each constant by name, of a car those of `CONSTANTS`."""
    errors: dict[str, float]
    """Standard error of each; NaN for a constant that the log does not determine, whose value is then the given one."""
    residual: dict[str, float]
    """Standard deviation of the log from the prediction: for cars x and y together [m], heading [rad], speed [m/s], NaN
    without measured speeds."""
    samples: int
    """Number of poses that were used."""
    misfits: tuple[str, ...] = ()
    """Names of the residuals that exceed both the noise of the log and a twentieth of the motion in a segment."""


def identify(track: Track, commands: Series, guess: Robot | None = None, status: Series | None = None) -> Identified:
    """Fit the car model to the log of one car.

    Args:
        track: Its path.
        commands: Its commands, with the names steering [rad] and throttle, or these two numbers without names.
        guess: Constants that are not fitted, and those to start from.
        status: Its status; segments in which it did not work are left out.

    Raises:
        ValueError: the log is too short, the car does not move or is never steered, the commands have other names, or
            their steering angles are not in radians.
    """
    given = commands.columns(INPUTS)
    if given is None:
        got = few_of(commands.names) or f"{commands.value.shape[1]} numbers without names"
        raise ValueError(f"commands must be {' [rad] and '.join(INPUTS)}, got {got}")
    if (largest := float(np.abs(given[:, 0]).max())) >= LARGEST_STEERING:
        raise ValueError(f"steering must be an angle below pi / 2 [rad], got {largest:.4g}: is it in degrees?")
    return _Fit(track, Series(commands.time, given), guess or Robot(), status).run()


class _Fit:
    """A fit in progress."""

    def __init__(self, track: Track, commands: Series, guess: Robot, status: Series | None):
        first, last = max(track.time[0], commands.time[0]), track.time[-1]
        inside = (track.time >= first - 1e-9) & (track.time <= last)
        time, count = track.time[inside], int(inside.sum())
        if count < 20 or last - first < 2 * _SEGMENT:
            raise ValueError(
                f"log must contain at least 20 poses over {2 * _SEGMENT:g} s with commands, got {count} over "
                f"{max(last - first, 0.0):.3g} s"
            )
        motion = motion_of(track, _GAP)
        measured = np.stack([*track.position.T[:2], motion.track.heading, motion.track.speed], axis=1)[inside]
        if np.ptp(measured[:, 3]) < 1e-3 or np.ptp(commands.value[:, 0]) < 1e-3:
            raise ValueError("log must be of a car whose steering and speed change")
        segment = ((time - time[0]) / _SEGMENT).astype(int)
        failed = np.zeros(count, bool) if status is None else status.before(time) != int(WORKING)
        used = np.setdiff1d(segment, segment[failed])
        if not len(used):
            raise ValueError(f"log must have {_SEGMENT:g} s in which the car works, got none")
        if len(used) > _MOST_SEGMENTS:
            used = used[np.linspace(0, len(used) - 1, _MOST_SEGMENTS).astype(int)]
        chosen = np.isin(segment, used)
        self._time = time[chosen]
        self._segment = np.searchsorted(used, segment[chosen])
        self._measured = measured[chosen]
        # A speed that was computed from positions is no second measurement, and lags behind the car's.
        logged = np.isfinite(track.speed) & (track.measured and motion.derived in ("", SOME))
        self._known = np.ones(self._measured.shape, bool)
        self._known[:, 3] = (logged & (motion.track.speed == track.speed))[inside][chosen]
        self._begin = np.append(np.flatnonzero(np.diff(self._segment, prepend=-1)), len(self._segment))
        self._rollouts = Rollouts(guess, self._begin, time[chosen], commands.time, commands.value)
        self._throttles = np.unique(np.abs(commands.value[:, 1]).round(7))  # of both directions
        # Between two throttles of the log, every value is as good.
        middles = 0.5 * (self._throttles[1:] + self._throttles[:-1])
        self._zones = np.concatenate([[self._throttles[0] - 1e-3], middles])
        self._guess = np.array([guess.wheelbase, guess.drag, guess.drive, guess.offset, guess.dead_zone, 0.0])
        self._scale = _FIRST_SCALE
        self._starts = self._measured[self._begin[:-1]].copy()

    def run(self) -> Identified:
        """Fit in turns the smooth constants, the dead zone, and the scale of the residuals."""
        constants = self._likely_zone(self._best_of(self._guess, _DELAY, np.arange(0, 0.5, 0.05)))
        zone_error = np.nan
        for _ in range(2):
            constants, errors = self._fit(constants)
            constants[_ZONE], zone_error = self._best_zone(constants)
            self._scale = self._deviations(constants)
        constants, errors = self._fit(constants)
        errors = np.maximum(errors, _ROUNDING * np.abs(constants))
        errors[_ZONE] = zone_error
        if np.isnan(zone_error):
            constants[_ZONE] = self._guess[_ZONE]
        deviations = self._deviations(constants)
        residual = {
            "position": float(deviations[0]),
            "heading": float(deviations[2]),
            "speed": float(deviations[3]) if self._known[:, 3].any() else math.nan,
        }
        values, deviations = (dict(zip(CONSTANTS, map(float, numbers), strict=True)) for numbers in (constants, errors))
        return Identified(values, deviations, residual, len(self._measured), self._misfits(residual))

    def _misfits(self, residual: dict[str, float]) -> tuple[str, ...]:
        """Return the names of the residuals that the noise of the log does not explain."""
        names, counts = [], np.diff(self._begin)
        for name, columns in (("position", [0, 1]), ("heading", [2]), ("speed", [3])):
            values, noise = self._measured[:, columns], []
            for begin, end in pairwise(self._begin.tolist()):
                noise.append(local_deviations(self._time[begin:end], values[begin:end]))
            middle = np.add.reduceat(values, self._begin[:-1]) / counts[:, None]
            spread = float((values - middle[self._segment]).std())
            if residual[name] > max(_NOISES * float(np.quantile(np.concatenate(noise), _CALM)), _SPREAD * spread):
                names.append(name)
        return tuple(names)

    def _residuals(self, constants: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """Return the differences (P, K, 4) in units of their deviations."""
        away = self._rollouts.predict(constants, starts) - self._measured
        away[..., 2] = (away[..., 2] + np.pi) % (2 * np.pi) - np.pi
        return np.where(self._known, away / self._scale, 0.0)

    def _deviations(self, constants: np.ndarray) -> np.ndarray:
        away = self._residuals(constants[None], self._starts[None])[0] * self._scale
        # A segment's start is fitted too, which costs one degree of freedom for each.
        known = self._known.sum(axis=0)
        square = (away**2).sum(axis=0) / np.maximum(known - len(self._starts), 1)
        place = max(square[:2].mean(), 1e-12)
        speed = square[3] if known[3] else self._scale[3] ** 2
        return np.sqrt(np.maximum([place, place, square[2], speed], 1e-12))

    def _best_of(self, constants: np.ndarray, which: int, values: np.ndarray) -> np.ndarray:
        """Return the constants of the best fit of some that begin with, or have, these values of one of them."""
        sets = np.repeat(constants[None], len(values), axis=0)
        sets[:, which] = values
        begun, fits = self._starts, []
        for constants in sets:
            # A bad value leads the starts astray, from where the next value would not find back.
            self._starts = begun
            fitted = self._fit(constants, evaluations=4)[0]
            fits.append(((self._from_best_starts(fitted) ** 2).sum(), fitted, self._starts))
        _, best, self._starts = min(fits, key=lambda fit: fit[0])
        return best

    def _likely_zone(self, constants: np.ndarray) -> np.ndarray:
        """Return constants with a dead zone near the best, which depends on the other constants and they on it."""
        zones, width = self._zones, len(self._zones)
        while width > 1:
            around = int(np.argmin(np.abs(zones - constants[_ZONE])))
            places = np.linspace(around - width, around + width, 2 * _ZONES_FITTED + 1)
            tried = zones[np.unique(np.clip(places, 0, len(zones) - 1).astype(int))]
            constants = self._best_of(constants, _ZONE, tried)
            width //= _ZONES_FITTED
        return constants

    def _cost(self, constants: np.ndarray, starts: np.ndarray) -> np.ndarray:
        return (self._residuals(constants, starts) ** 2).sum(axis=(1, 2))

    def _fit(self, constants: np.ndarray, evaluations: int = 30) -> tuple[np.ndarray, np.ndarray]:
        """Fit the smooth constants, each segment's start among them; return them and their standard errors."""
        unit = np.maximum(np.abs(constants[_SMOOTH]), _LEAST_UNIT)

        def constants_of(x: np.ndarray) -> np.ndarray:
            given = constants.copy()
            given[_SMOOTH] = x * unit
            return given

        def residuals(x: np.ndarray) -> np.ndarray:
            return self._from_best_starts(constants_of(x)).ravel()

        def jacobian(x: np.ndarray) -> np.ndarray:
            return self._slopes(constants_of(x), unit)

        self._from_best_starts(constants, _FIRST_STEPS)
        low = _LEAST / unit
        begin: Any = np.maximum(constants[_SMOOTH] / unit, low)
        slopes: Any = jacobian
        solution = least_squares(residuals, begin, slopes, (low, np.inf), max_nfev=evaluations)
        free = max(int(self._known.sum()) - len(solution.x) - self._starts.size, 1)
        covariance = np.linalg.pinv(solution.jac.T @ solution.jac) * (2 * solution.cost / free)
        errors = np.full(len(CONSTANTS), np.nan)
        errors[_SMOOTH] = np.sqrt(np.diag(covariance)) * unit
        self._from_best_starts(constants_of(solution.x))
        return constants_of(solution.x), errors

    def _from_best_starts(self, constants: np.ndarray, steps: int = 2) -> np.ndarray:
        """Return the residuals (K, 4) from the best start of each segment, which some Gauss-Newton steps find.

        A step that would make a segment's residuals larger is shortened, or left out.
        """
        first, segments = self._begin[:-1], np.arange(len(self._starts))
        for _ in range(steps):
            away, slopes = self._start_slopes(constants)
            step = self._explained(slopes, away[..., None])[..., 0] * self._scale
            tried = self._starts - _SHARES[:, None, None] * step
            rest = self._residuals(np.repeat(constants[None], len(_SHARES), axis=0), tried)
            costs = np.add.reduceat((rest**2).sum(axis=2), first, axis=1)
            self._starts = tried[np.argmin(costs, axis=0), segments]
        return self._residuals(constants[None], self._starts[None])[0]

    def _start_slopes(self, constants: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the residuals (K, 4), and their slopes (K, 4, 4) along each entry of their segment's start."""
        sets = np.repeat(constants[None], 5, axis=0)
        begun = np.repeat(self._starts[None], 5, axis=0)
        begun[np.arange(1, 5), :, np.arange(4)] += self._scale[:, None]
        away = self._residuals(sets, begun)
        return away[0], np.moveaxis(away[1:] - away[0], 0, -1)

    def _explained(self, slopes: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Return the changes of the starts (S, 4, C), in units, that explain values (K, 4, C) best."""
        first = self._begin[:-1]
        square = np.add.reduceat(np.einsum("kia,kib->kab", slopes, slopes), first)
        mixed = np.add.reduceat(np.einsum("kia,kic->kac", slopes, values), first)
        return np.linalg.solve(square + 1e-9 * np.eye(4), mixed)

    def _slopes(self, constants: np.ndarray, unit: np.ndarray) -> np.ndarray:
        """Return the slopes of the residuals along the smooth constants, less what the starts explain of them."""
        changes = np.zeros((len(_SMOOTH), len(CONSTANTS)))
        changes[np.arange(len(_SMOOTH)), _SMOOTH] = _CHANGE * unit
        sets = np.concatenate([constants + changes, constants - changes])
        away = self._residuals(sets, np.repeat(self._starts[None], len(sets), axis=0))
        along = np.moveaxis(away[: len(_SMOOTH)] - away[len(_SMOOTH) :], 0, -1) / (2 * _CHANGE)
        _, slopes = self._start_slopes(constants)
        explained = self._explained(slopes, along)[self._segment]
        return (along - np.einsum("kia,kac->kic", slopes, explained)).reshape(-1, len(_SMOOTH))

    def _best_zone(self, constants: np.ndarray) -> tuple[float, float]:
        """Return the dead zone of the least cost and its standard error; NaN where nothing rules out a smaller one."""
        zones = self._zones
        for _ in range(4):  # ever finer around the best
            tried = zones[np.unique(np.linspace(0, len(zones) - 1, _MOST_ZONES).astype(int))]
            sets = np.repeat(constants[None], len(tried), axis=0)
            sets[:, _ZONE] = tried
            costs = self._cost(sets, np.repeat(self._starts[None], len(tried), axis=0))
            good = tried[costs <= costs.min() + 1]
            if len(tried) == len(zones):
                break
            around = np.flatnonzero(np.isin(tried, good))
            low, high = tried[max(around[0] - 1, 0)], tried[min(around[-1] + 1, len(tried) - 1)]
            zones = zones[(zones >= low) & (zones <= high)]
        if good[0] <= self._throttles[0]:
            return float(self._guess[_ZONE]), np.nan
        # Any value between the throttles on both sides would do.
        low, high = self._throttles[self._throttles < good[0]].max(), self._throttles[self._throttles > good[-1]].min()
        return float(good.mean()), 0.5 * float(high - low)
