"""Identify the constants of a car (12) or of a differential drive from a log, by least squares on predicted motion.

The log is cut into segments. Each is predicted by the model from a start that is fitted too, so that noise of the first
pose does not matter, and the constants are those of the smallest sum of squared differences in x, y, heading and speed,
each in units of its own deviation. The dead zone, on which a prediction does not depend smoothly, is the best of the
values between the throttles of the log.
"""

import math
from dataclasses import dataclass
from itertools import pairwise, product
from typing import Any

import numpy as np
from scipy import sparse
from scipy.optimize import least_squares

from lissajous_env.logs.inputs import INPUTS, LARGEST_STEERING
from lissajous_env.logs.log import Series, Track
from lissajous_env.logs.motion import local_deviations, motion_of
from lissajous_env.logs.rollouts import MODELS, Rollouts
from lissajous_env.settings.parts import Robot
from lissajous_env.wording import few_of
from lissajous_env.world.state import WORKING

_SEGMENT = 2.0
"""Duration of a segment [s]."""
_GAP = 0.5
"""Longest time between two poses from which a speed is computed [s]."""
_MOST_SEGMENTS = 120
_ZONES_FITTED = 4
"""Values of the dead zone to each side that are compared together with the best constants of each."""
_DELAYS = np.arange(0.0, 0.5, 0.1)
"""Delays with which fits begin [s]."""
_LIMITS = (1.0, 0.1)
"""Limits with which they begin, in the given ones."""
_CHANGE = 1e-3
"""Relative change for derivatives; for the delay in seconds."""
_ROUNDING = 1e-5
"""Least relative standard error: predictions are computed in single precision."""
_UNKNOWN = 0.1
"""Relative standard error above which a log does not determine a limit."""
_NOISES, _SPREAD = 4.0, 0.05
"""Factors on the noise of the log and on the spread of the motion in a segment, up to which residuals are no misfit."""
_CALM = 0.1
"""Quantile of the deviations from smooth motion that counts as noise: a robot that turns fast deviates, too."""
_LEAST_UNITS = (1e-3, 1e-2, 1e-2, 1e-1, 1.0)
"""Least units in which the smooth constants are fitted."""
_FIRST_SCALE = np.array([0.01, 0.01, 0.02, 0.02, 0.1])
"""First units of the residuals, and of the entries of a start."""


@dataclass(frozen=True)
class Identified:
    """Constants of a robot with their standard errors."""

    values: dict[str, float]
    """Value of each constant by name, those of `lissajous_env.logs.rollouts.MODELS`."""
    errors: dict[str, float]
    """Standard error of each; NaN for a constant that the log does not determine, whose value is then the given one."""
    residual: dict[str, float]
    """Standard deviation of the log from the prediction: x and y together [m], heading [rad], speed [m/s], NaN without
    measured speeds."""
    samples: int
    """Number of poses that were used."""
    misfits: tuple[str, ...] = ()
    """Names of the residuals that exceed both the noise of the log and a twentieth of the motion in a segment."""


def identify(track: Track, commands: Series, guess: Robot | None = None, status: Series | None = None) -> Identified:
    """Fit the model of a car or differential drive to the log of one robot.

    Args:
        track: Its path.
        commands: Its commands, with the names of the model's inputs, or these two numbers without names: steering
            [rad] and throttle of a car, speed [m/s] and yaw rate [rad/s] of a drive.
        guess: The kind, constants that are not fitted, and those to start from; by default a car.
        status: Its status; segments in which it did not work are left out.

    Raises:
        ValueError: the log is too short, the robot does not move or never turns, the commands have other names, or
            steering angles are not in radians.
    """
    guess = guess or Robot()
    inputs, units = INPUTS[guess.kind], MODELS[guess.kind].units
    given = commands.columns(inputs)
    if given is None:
        names = [f"{name} [{unit}]" if unit else name for name, unit in zip(inputs, units, strict=True)]
        got = few_of(commands.names) or f"{commands.value.shape[1]} numbers without names"
        raise ValueError(f"commands must be {' and '.join(names)}, got {got}")
    if guess.kind == "car" and (largest := float(np.abs(given[:, 0]).max())) >= LARGEST_STEERING:
        raise ValueError(f"steering must be an angle below pi / 2 [rad], got {largest:.4g}: is it in degrees?")
    return _Fit(track, Series(commands.time, given), guess, status).run()


class _Fit:
    """A fit in progress."""

    def __init__(self, track: Track, commands: Series, guess: Robot, status: Series | None):
        self._model = model = MODELS[guess.kind]
        first, last = max(track.time[0], commands.time[0]), track.time[-1]
        inside = (track.time >= first - 1e-9) & (track.time <= last)
        time, count = track.time[inside], int(inside.sum())
        if count < 20 or last - first < 2 * _SEGMENT:
            rule = f"log must contain at least 20 poses over {2 * _SEGMENT:g} s with commands"
            raise ValueError(f"{rule}, got {count} over {max(last - first, 0.0):.3g} s")
        motion = motion_of(track, _GAP)
        measured = np.stack([*track.position.T[:2], motion.track.heading, motion.track.speed], axis=1)[inside]
        if np.ptp(measured[:, 3]) < 1e-3 or np.ptp(commands.value[:, model.turning]) < 1e-3:
            raise ValueError(f"log must be of a robot whose speed and {INPUTS[guess.kind][model.turning]} change")
        segment = ((time - time[0]) / _SEGMENT).astype(int)
        failed = np.zeros(count, bool) if status is None else status.before(time) != int(WORKING)
        used = np.setdiff1d(segment, segment[failed])
        if not len(used):
            raise ValueError(f"log must have {_SEGMENT:g} s in which the robot works, got none")
        if len(used) > _MOST_SEGMENTS:
            used = used[np.linspace(0, len(used) - 1, _MOST_SEGMENTS).astype(int)]
        chosen = np.isin(segment, used)
        self._time, self._measured = time[chosen], measured[chosen]
        self._segment = np.searchsorted(used, segment[chosen])
        # A speed that was computed from positions is no second measurement, and lags behind the robot's.
        self._known = np.ones(self._measured.shape, bool)
        self._known[:, 3] = not motion.derived
        self._begin = np.append(np.flatnonzero(np.diff(self._segment, prepend=-1)), len(self._segment))
        self._rollouts = Rollouts(guess, self._begin, self._time, commands.time, commands.value)
        self._names = list(model.constants)
        self._smooth = [k for k, name in enumerate(self._names) if name != "dead_zone"]
        limits = {"acceleration_max": guess.top_acceleration, "yaw_acceleration_max": guess.top_yaw_acceleration}
        given = [limits.get(name, getattr(guess, name, 1.0)) for name in self._names[:-1]]
        self._guess, self._scale = np.array([*given, 0.0], dtype=float), _FIRST_SCALE
        begun = self._begin[:-1]
        heading = self._measured[:, 2]
        after = np.minimum(begun + 1, len(heading) - 1)
        turned = (heading[after] - heading[begun]) / np.maximum(self._time[after] - self._time[begun], 1e-3)
        self._starts = np.column_stack([self._measured[begun], turned])
        self._throttles = np.unique(np.abs(commands.value[:, 1]).round(7))  # of both directions
        # Between two throttles of the log, every value of the dead zone is as good.
        middles = 0.5 * (self._throttles[1:] + self._throttles[:-1])
        self._zones = np.concatenate([[self._throttles[0] - 1e-3], middles])

    def run(self) -> Identified:
        """Fit in turns the constants, the scale of the residuals, and between fits the dead zone."""
        constants = self._best_of(self._begins())
        zone_error = np.nan
        if "dead_zone" in self._names:
            constants, zone_error = self._with_dead_zone(constants, self._names.index("dead_zone"))
        for _ in range(2):
            constants, _ = self._fit(constants)
            self._scale = self._deviations(constants)
        constants, _ = self._fit(constants)
        errors = self._errors(constants)
        if "dead_zone" in self._names:
            errors[self._names.index("dead_zone")] = zone_error
        is_limit = np.array([name in self._model.limits for name in self._names])
        unknown = np.isnan(errors) | (is_limit & (errors > _UNKNOWN * constants))
        constants, errors = np.where(unknown, self._guess, constants), np.where(unknown, np.nan, errors)
        deviations = self._deviations(constants)
        residual = {"position": deviations[0], "heading": deviations[2], "speed": deviations[3]}
        if not self._known[:, 3].any():
            residual["speed"] = math.nan
        values, deviations = (dict(zip(self._names, map(float, row), strict=True)) for row in (constants, errors))
        residual = {name: float(value) for name, value in residual.items()}
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
        """Return the differences (P, K, 4) in units of their deviations, of P sets of constants (P, C)."""
        away = self._rollouts.predict(constants, starts) - self._measured
        away[..., 2] = (away[..., 2] + np.pi) % (2 * np.pi) - np.pi
        return np.where(self._known, away / self._scale[:4], 0.0)

    def _deviations(self, constants: np.ndarray) -> np.ndarray:
        away = self._residuals(constants[None], self._starts[None])[0] * self._scale[:4]
        # A segment's start is fitted too, which costs one degree of freedom for each.
        known = self._known.sum(axis=0)
        square = (away**2).sum(axis=0) / np.maximum(known - len(self._starts), 1)
        place = max(square[:2].mean(), 1e-12)
        speed = square[3] if known[3] else self._scale[3] ** 2
        return np.append(np.sqrt(np.maximum([place, place, square[2], speed], 1e-12)), self._scale[4])

    def _begins(self) -> np.ndarray:
        """Return sets of constants (P, C) with which fits begin: with several delays, and lower limits."""
        begins = []
        for delay, share in product(_DELAYS, _LIMITS if self._model.limits else (1.0,)):
            shares = [share if name in self._model.limits else 1.0 for name in self._names]
            begins.append(self._guess * shares)
            begins[-1][-1] = delay
        return np.array(begins)

    def _best_of(self, sets: np.ndarray) -> np.ndarray:
        """Return the constants of the best of some fits that begin with sets of constants (P, C)."""
        begun, fits = self._starts, []
        for constants in sets:
            # A bad value leads the starts astray, from where the next value would not find back.
            self._starts = begun
            fitted, cost = self._fit(constants, evaluations=8)
            fits.append((cost, fitted, self._starts))
        _, best, self._starts = min(fits, key=lambda fit: fit[0])
        return best

    def _fit(self, constants: np.ndarray, evaluations: int = 40) -> tuple[np.ndarray, float]:
        """Fit the smooth constants and the starts together; return the constants and the cost."""
        unit = np.maximum(np.abs(constants[self._smooth]), _LEAST_UNITS)
        free, count = self._model.free, len(self._smooth)

        def parts(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            given, starts = constants.copy(), self._begun.copy()
            given[self._smooth] = x[:count] * unit
            starts[:, :free] += x[count:].reshape(-1, free) * self._scale[:free]
            return given, starts

        self._begun = self._starts
        low = np.append(np.array(self._model.least)[self._smooth] / unit, np.full(len(self._starts) * free, -np.inf))
        begin = np.append(np.maximum(constants[self._smooth] / unit, low[:count]), np.zeros(len(low) - count))
        solution = least_squares(
            lambda x: self._residuals(*(values[None] for values in parts(x)))[0].ravel(),
            begin,
            lambda x: self._slopes(*parts(x), unit),  # type: ignore[arg-type]
            (low, np.inf),
            tr_solver="lsmr",
            max_nfev=evaluations,
        )
        fitted, self._starts = parts(solution.x)
        return fitted, float(solution.cost)

    def _slopes(self, constants: np.ndarray, starts: np.ndarray, unit: np.ndarray) -> Any:
        """Return the slopes (4 K, C + E S) of the residuals along C smooth constants and E entries of each of S starts.

        They are sparse: a start changes the residuals of its own segment only, so all segments are changed at once.
        """
        count, free = len(self._smooth), self._model.free
        changes = np.zeros((count, len(constants)))
        changes[np.arange(count), self._smooth] = _CHANGE * unit
        sets = np.concatenate([constants + changes, constants - changes])
        away = self._residuals(sets, np.repeat(starts[None], len(sets), axis=0))
        along = (away[:count] - away[count:]).reshape(count, -1).T / (2 * _CHANGE)
        begun = np.repeat(starts[None], 2 * free, axis=0)
        entries = np.arange(free)
        begun[entries, :, entries] += 0.5 * self._scale[entries, None]
        begun[free + entries, :, entries] -= 0.5 * self._scale[entries, None]
        away = self._residuals(np.repeat(constants[None], len(begun), axis=0), begun)
        of_starts = (away[:free] - away[free:]).reshape(free, -1)
        rows = np.tile(np.arange(of_starts.shape[1]), free)
        columns = np.repeat(self._segment, 4) * free + entries[:, None]
        shape = of_starts.shape[1], free * len(starts)
        return sparse.hstack([along, sparse.csr_matrix((of_starts.ravel(), (rows, columns.ravel())), shape)], "csr")

    def _errors(self, constants: np.ndarray) -> np.ndarray:
        """Return the standard errors of the constants; NaN for those on which the log does not depend."""
        unit, count = np.maximum(np.abs(constants[self._smooth]), _LEAST_UNITS), len(self._smooth)
        slopes = self._slopes(constants, self._starts, unit)
        square = (slopes.T @ slopes).toarray()
        cost = float((self._residuals(constants[None], self._starts[None]) ** 2).sum())
        degrees = max(int(self._known.sum()) - len(square), 1)
        variance = np.diag(np.linalg.pinv(square))[:count] * cost / degrees
        errors = np.full(len(constants), np.nan)
        errors[self._smooth] = np.where(np.diag(square)[:count] < 1e-16, np.nan, np.sqrt(variance) * unit)
        return np.maximum(errors, _ROUNDING * np.abs(constants))

    def _with_dead_zone(self, constants: np.ndarray, zone: int) -> tuple[np.ndarray, float]:
        """Return constants with the best dead zone, and its standard error; NaN where no throttle lies within it.

        The dead zone depends on the other constants and they on it, so that they are fitted with each of some values,
        ever closer around the best.
        """
        zones, width = self._zones, len(self._zones)
        while width > 1:
            around = int(np.argmin(np.abs(zones - constants[zone])))
            places = np.linspace(around - width, around + width, 2 * _ZONES_FITTED + 1)
            tried = zones[np.unique(np.clip(places, 0, len(zones) - 1).astype(int))]
            sets = np.repeat(constants[None], len(tried), axis=0)
            sets[:, zone] = tried
            constants = self._best_of(sets)
            width //= _ZONES_FITTED
        without = constants.copy()
        without[zone] = zones[0]
        costs = [(self._residuals(given[None], self._starts[None]) ** 2).sum() for given in (constants, without)]
        if constants[zone] == zones[0] or costs[1] <= costs[0] + 1:
            constants[zone] = self._guess[zone]
            return constants, np.nan
        # Any value between the throttles on both sides would do.
        place = int(np.searchsorted(self._throttles, constants[zone]))
        return constants, 0.5 * float(self._throttles[place] - self._throttles[place - 1])
