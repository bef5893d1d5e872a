"""Identify the constants of a car (12) from a log, by least squares on predicted motion.

The log is cut into segments. Each is predicted by the model from a start that is fitted too, so that noise of the first
pose does not matter, and the constants are those of the smallest sum of squared differences in x, y, heading and speed,
each in units of its own deviation. The dead zone, on which a prediction does not depend smoothly, is the best of the
values between the throttles of the log.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp
from scipy import sparse
from scipy.optimize import least_squares

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.devices import compile_quietly
from lissajous_env.device.structs import RobotStruct, to_struct
from lissajous_env.logs.inputs import INPUTS, LARGEST_STEERING
from lissajous_env.logs.log import Series, Track
from lissajous_env.logs.motion import local_deviations, motion_of
from lissajous_env.settings.parts import Robot
from lissajous_env.wording import few_of
from lissajous_env.world.robots.car import car_step, motor_push
from lissajous_env.world.state import WORKING

wp.set_module_options(OPTIONS)

CONSTANTS = {"wheelbase": "m", "drag": "1/s", "drive": "m/s^2", "offset": "m/s^2", "delay": "s", "dead_zone": ""}
"""Constants of (12) and the delay of the commands, with their units."""
_LEAST = (1e-4, 1e-5, 1e-5, 0.0, 0.0)
"""Least values of the constants but the dead zone, on which a prediction depends smoothly."""
_LEAST_UNITS = (1e-3, 1e-2, 1e-2, 1e-1, 0.1)
"""Least units in which they are fitted."""
_LONGEST = wp.constant(wp.float64(0.05))
"""Longest integration step [s]."""
_ON_TIME = wp.constant(wp.float64(1e-9))
"""Difference up to which two times are the same [s]."""
_SEGMENT = 2.0
"""Duration of a segment [s]."""
_GAP = 0.5
"""Longest time between two poses from which a speed is computed [s]."""
_MOST_SEGMENTS = 120
_ZONES_FITTED = 4
"""Values of the dead zone to each side that are compared together with the best constants of each."""
_DELAYS = np.arange(0.0, 0.5, 0.1)
"""Delays with which fits begin [s]."""
_CHANGE = 1e-3
"""Change for derivatives, in units of a constant."""
_ROUNDING = 1e-5
"""Least relative standard error: predictions are computed in single precision."""
_NOISES, _SPREAD = 4.0, 0.05
"""Factors on the noise of the log and on the spread of the motion in a segment, up to which residuals are no misfit."""
_CALM = 0.1
"""Quantile of the deviations from smooth motion that counts as noise: a robot that turns fast deviates, too."""
_FIRST_SCALE = np.array([0.01, 0.01, 0.02, 0.02])
"""First units of the residuals x, y [m], heading [rad] and speed [m/s]."""


@wp.kernel
def roll_out(
    robot: RobotStruct,
    constants: wp.array2d(dtype=float),
    starts: wp.array2d(dtype=wp.vec4),
    begin: wp.array(dtype=int),
    time: wp.array(dtype=wp.float64),
    command_time: wp.array(dtype=wp.float64),
    command: wp.array(dtype=wp.vec2),
    predicted_out: wp.array2d(dtype=wp.vec4),
):
    """Predict x, y, heading and speed of a car at the times of a segment of a log, with one set of `CONSTANTS`."""
    p, s = wp.tid()
    own = robot
    own.drag = constants[p, 1]
    own.offset = constants[p, 3]
    own.dead_zone = constants[p, 5]
    delay = wp.float64(constants[p, 4])
    last = command.shape[0] - 1
    state = starts[p, s]
    now = time[begin[s]]
    k = int(wp.lower_bound(command_time, now - delay))
    if k > last or command_time[wp.min(k, last)] + delay > now + _ON_TIME:
        k = wp.max(k - 1, 0)
    predicted_out[p, begin[s]] = state
    for j in range(begin[s] + 1, begin[s + 1]):
        while now < time[j] - _ON_TIME:
            until = wp.min(time[j], now + _LONGEST)
            if k < last:
                until = wp.min(until, wp.max(command_time[k + 1] + delay, now))
            push = motor_push(own, constants[p, 2], command[k][1])
            state = car_step(own, state, wp.tan(command[k][0]) / constants[p, 0], push, float(until - now))
            now = until
            following = wp.min(k + 1, last)
            if following > k and command_time[following] + delay <= now + _ON_TIME:
                k = following
        predicted_out[p, j] = state


@dataclass(frozen=True)
class Identified:
    """Constants of a car with their standard errors."""

    values: dict[str, float]
    """Value of each constant by name, those of `CONSTANTS`."""
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
    """Fit the model of a car to the log of one robot.

    Args:
        track: Its path.
        commands: Its commands, with the names steering [rad] and throttle, or these two numbers without names.
        guess: Constants that are not fitted, and those to start from; by default those of the paper's car.
        status: Its status; segments in which it did not work are left out.

    Raises:
        ValueError: the log is too short, the robot does not move or never turns, the commands have other names, or
            steering angles are not in radians.
    """
    given = commands.columns(INPUTS["car"])
    if given is None:
        got = few_of(commands.names) or f"{commands.value.shape[1]} numbers without names"
        raise ValueError(f"commands must be steering [rad] and throttle, got {got}")
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
            rule = f"log must contain at least 20 poses over {2 * _SEGMENT:g} s with commands"
            raise ValueError(f"{rule}, got {count} over {max(last - first, 0.0):.3g} s")
        motion = motion_of(track, _GAP)
        measured = np.stack([*track.position.T[:2], motion.track.heading, motion.track.speed], axis=1)[inside]
        if np.ptp(measured[:, 3]) < 1e-3 or np.ptp(commands.value[:, 0]) < 1e-3:
            raise ValueError("log must be of a robot whose speed and steering change")
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
        self._is_known = np.array([True, True, True, not motion.derived])
        self._begin = np.append(np.flatnonzero(np.diff(self._segment, prepend=-1)), len(self._segment))
        self._starts, self._scale = self._measured[self._begin[:-1]], _FIRST_SCALE
        self._guess = np.array([getattr(guess, name, 0.0) for name in CONSTANTS], dtype=float)
        kinds = (
            (self._begin, wp.int32),
            (self._time, wp.float64),
            (commands.time, wp.float64),
            (commands.value, wp.vec2),
        )
        self._data = [wp.array(values, dtype=kind, device="cpu") for values, kind in kinds]
        self._robot = to_struct(RobotStruct, guess)
        # Between two throttles of the log, of either direction, every value of the dead zone is as good.
        self._throttles = np.unique(np.abs(commands.value[:, 1]).round(7))
        middles = 0.5 * (self._throttles[1:] + self._throttles[:-1])
        self._zones = np.concatenate([[self._throttles[0] - 1e-3], middles])

    def run(self) -> Identified:
        """Fit in turns the constants, the scale of the residuals, and between fits the dead zone."""
        constants = self._best_of(np.array([[*self._guess[:4], delay, 0.0] for delay in _DELAYS]))
        constants, zone_error = self._with_dead_zone(constants)
        for _ in range(2):
            constants, _ = self._fit(constants)
            self._scale = self._deviations(constants)
        constants, _ = self._fit(constants)
        errors = np.append(self._errors(constants), zone_error)
        constants, errors = np.where(np.isnan(errors), self._guess, constants), errors
        place, _, heading, speed = map(float, self._deviations(constants))
        residual = {"position": place, "heading": heading, "speed": speed if self._is_known[3] else math.nan}
        values, deviations = (dict(zip(CONSTANTS, map(float, row), strict=True)) for row in (constants, errors))
        return Identified(values, deviations, residual, len(self._time), self._misfits(residual))

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
        """Return the differences (P, K, 4) in units of their deviations, of P constants and starts (P, S, 4)."""
        predicted: Any = wp.zeros((len(constants), len(self._time)), dtype=wp.vec4, device="cpu")
        given = [wp.array(constants, dtype=wp.float32, device="cpu"), wp.array(starts, dtype=wp.vec4, device="cpu")]
        with compile_quietly():
            wp.launch(roll_out, starts.shape[:2], [self._robot, *given, *self._data], [predicted], device="cpu")
        away = predicted.numpy() - self._measured
        away[..., 2] = (away[..., 2] + np.pi) % (2 * np.pi) - np.pi
        return np.where(self._is_known, away / self._scale, 0.0)

    def _deviations(self, constants: np.ndarray) -> np.ndarray:
        """Return the standard deviations (4,) of the log from the prediction."""
        away = self._residuals(constants[None], self._starts[None])[0] * self._scale
        # A segment's start is fitted too, which costs one degree of freedom for each.
        square = np.maximum((away**2).sum(axis=0) / max(len(away) - len(self._starts), 1), 1e-12)
        square[:2] = square[:2].mean()
        return np.where(self._is_known, np.sqrt(square), self._scale)

    def _fit(self, constants: np.ndarray, evaluations: int = 40) -> tuple[np.ndarray, float]:
        """Fit all constants but the dead zone, and the starts; return the constants and the cost."""
        unit = np.maximum(np.abs(constants[:-1]), _LEAST_UNITS)
        count, begun = len(unit), self._starts

        def parts(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return np.append(x[:count] * unit, constants[-1]), begun + x[count:].reshape(-1, 4) * self._scale

        low = np.append(np.array(_LEAST) / unit, np.full(begun.size, -np.inf))
        begin = np.append(np.maximum(constants[:-1] / unit, low[:count]), np.zeros(begun.size))
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
        """Return the slopes (4 K, C + 4 S) of the residuals along C constants and the four entries of each of S starts.

        They are sparse: a start changes the residuals of its own segment only, so all segments are changed at once.
        """
        count = len(unit)
        sets, begun = np.tile(constants, (2 * (count + 4), 1)), np.tile(starts, (2 * (count + 4), 1, 1))
        for k in range(count):
            sets[2 * k : 2 * k + 2, k] += np.array([_CHANGE, -_CHANGE]) * unit[k]
        for k in range(4):
            begun[2 * (count + k) :][:2, :, k] += np.array([[0.5], [-0.5]]) * self._scale[k]
        away = self._residuals(sets, begun)
        slopes = (away[::2] - away[1::2]).reshape(count + 4, -1)
        rows = np.tile(np.arange(slopes.shape[1]), 4)
        columns = np.repeat(self._segment, 4) * 4 + np.arange(4)[:, None]
        of_starts = sparse.csr_matrix((slopes[count:].ravel(), (rows, columns.ravel())), (slopes.shape[1], starts.size))
        return sparse.hstack([slopes[:count].T / (2 * _CHANGE), of_starts], "csr")

    def _errors(self, constants: np.ndarray) -> np.ndarray:
        """Return the standard errors of all constants but the dead zone; NaN for those that change nothing."""
        unit = np.maximum(np.abs(constants[:-1]), _LEAST_UNITS)
        slopes = self._slopes(constants, self._starts, unit)
        square = (slopes.T @ slopes).toarray()
        cost = float((self._residuals(constants[None], self._starts[None]) ** 2).sum())
        degrees = max(len(self._time) * int(self._is_known.sum()) - len(square), 1)
        variance = np.diag(np.linalg.pinv(square))[: len(unit)] * cost / degrees
        errors = np.where(np.diag(square)[: len(unit)] < 1e-16, np.nan, np.sqrt(variance) * unit)
        return np.maximum(errors, _ROUNDING * np.abs(constants[:-1]))

    def _with_dead_zone(self, constants: np.ndarray) -> tuple[np.ndarray, float]:
        """Return constants with the best dead zone, and its standard error; NaN where no throttle lies within it.

        The dead zone depends on the other constants and they on it, so that they are fitted with each of some values,
        ever closer around the best.
        """
        zones, width = self._zones, len(self._zones)
        while width > 1:
            around = int(np.argmin(np.abs(zones - constants[-1])))
            places = np.linspace(around - width, around + width, 2 * _ZONES_FITTED + 1)
            tried = zones[np.unique(np.clip(places, 0, len(zones) - 1).astype(int))]
            constants = self._best_of(np.column_stack([np.tile(constants[:-1], (len(tried), 1)), tried]))
            width //= _ZONES_FITTED
        sets = np.stack([constants, [*constants[:-1], zones[0]]])
        cost, without = (self._residuals(sets, np.stack([self._starts] * 2)) ** 2).sum(axis=(1, 2))
        if without <= cost + 1:
            return np.append(constants[:-1], self._guess[-1]), np.nan
        # Any value between the throttles on both sides would do.
        place = int(np.searchsorted(self._throttles, constants[-1]))
        return constants, 0.5 * float(self._throttles[place] - self._throttles[place - 1])

    def _best_of(self, sets: np.ndarray) -> np.ndarray:
        """Return the constants of the best of some fits that begin with sets of constants (P, 6)."""
        begun, fits = self._starts, []
        for constants in sets:
            # A bad value leads the starts astray, from where the next value would not find back.
            self._starts = begun
            fitted, cost = self._fit(constants, evaluations=8)
            fits.append((cost, fitted, self._starts))
        _, best, self._starts = min(fits, key=lambda fit: fit[0])
        return best
