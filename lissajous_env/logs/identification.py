"""Identify the constants of a car (12) or of a differential drive from a log, by least squares on predicted motion.

The log is cut into segments. Each is predicted by the model from a start that is fitted too, so that noise of the first
pose does not matter, and the constants are those of the smallest sum of squared differences in x, y, heading and speed,
each in units of its own deviation. The dead zone, on which a prediction does not depend smoothly, is the best of the
values between the throttles of the log. Fits begin with estimates from the log for some delays of the commands.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import warp as wp
from scipy.optimize import least_squares

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.devices import as_device, compile_quietly
from lissajous_env.device.structs import RobotStruct, to_struct
from lissajous_env.logs.commands import COMMAND_NAMES, named_commands
from lissajous_env.logs.log import Series, Track
from lissajous_env.logs.motion import motion_of, noise_of
from lissajous_env.settings.parts import Robot
from lissajous_env.wording import require
from lissajous_env.world.robots.car import car_step, motor_acceleration
from lissajous_env.world.robots.differential import drive_step, ramp
from lissajous_env.world.state import WORKING

wp.set_module_options(OPTIONS)

State = wp.types.vector(5, wp.float32)
"""x, y [m], heading [rad], speed [m/s], and of differential drives the yaw rate [rad/s]."""

MODELS = {
    "car": {
        "wheelbase": ("m", 1e-4), "drag": ("1/s", 1e-5), "drive": ("m/s^2", 1e-5), "offset": ("m/s^2", 0.0),
        "delay": ("s", 0.0), "dead_zone": ("", 0.0),
    },
    "differential": {
        "speed_factor": ("", 0.05), "yaw_factor": ("", 0.05), "acceleration_max": ("m/s^2", 1e-6),
        "yaw_acceleration_max": ("rad/s^2", 1e-6), "delay": ("s", 0.0),
    },
}  # fmt: skip
"""Constants with their units and least values, by `robot.kind`: of (12), and of speed and yaw rate that follow the
commands with factors and limited changes. They are four of the motion, the delay of the commands, and of cars the dead
zone, on which alone a prediction does not depend smoothly."""
_LIMITS = ("acceleration_max", "yaw_acceleration_max")
"""Constants that are not determined by a log whose commands stay below them."""
_LEAST_UNITS = (1e-3, 1e-2, 1e-2, 1e-1, 0.1)
"""Least units in which the smooth constants are fitted."""
_LONGEST = wp.constant(wp.float64(0.05))
"""Longest integration step [s]."""
_ON_TIME = wp.constant(wp.float64(1e-9))
"""Difference up to which two times are the same [s]."""
_SEGMENT, _POSES = 2.0, 10
"""Least duration of a segment [s], and least number of its poses, of which the start takes about one."""
_GAP, _PERIODS = 0.5, 4
"""Longest time between two poses from which a speed is computed [s], and the same in median times between poses."""
_MOST_SEGMENTS = 120
_ZONES_FITTED = 4
"""Values of the dead zone to each side that are compared together with the best constants of each."""
_DELAYS = np.arange(0.0, 0.5, 0.1)
"""Delays with which fits begin [s]."""
_REACHED = 0.9
"""Quantile of the changes of speed and yaw rate with which their limits begin."""
_UNKNOWN = 0.1
"""Relative standard error above which a log does not determine a limit."""
_START_UNITS = 100.0
"""Units of the fitted starts, in those of the residuals: a derivative is that of a change by half a deviation."""
_ROUNDING = 1e-5
"""Least relative standard error: predictions are computed in single precision."""
_NOISES, _SPREAD = 2.0, 0.05
"""Factors on the noise of the log and on the spread of the motion in a segment, up to which residuals are no misfit."""
_FIRST_SCALE = np.array([0.01, 0.01, 0.02, 0.02])
"""First units of the residuals, which are also those of a start."""
_YAW_RATE_UNIT = 0.1
"""Unit of the yaw rate of a start [rad/s]."""


@wp.func
def advanced(
    robot: RobotStruct, is_car: int, constants: wp.array(dtype=float), now: State, given: wp.vec2, h: float
) -> State:
    """Return the state of a robot with some constants after a time h [s] under a command."""
    pose = wp.vec4(now[0], now[1], now[2], now[3])
    yaw_rate = now[4]
    own = robot
    if is_car == 1:
        own.drag = constants[1]
        own.offset = constants[3]
        own.dead_zone = constants[5]
        push = motor_acceleration(own, constants[2], given[1])
        pose = car_step(own, pose, wp.tan(given[0]) / constants[0], push, h)
    else:
        turning = constants[1] * given[1]
        own.yaw_acceleration_max = constants[3]
        pose = drive_step(own, pose, yaw_rate, constants[0] * given[0], turning, constants[2], h)
        yaw_rate = ramp(yaw_rate, turning, constants[3] * h)
    return State(pose[0], pose[1], pose[2], pose[3], yaw_rate)


@wp.kernel
def roll_out(
    robot: RobotStruct,
    is_car: int,
    constants: wp.array(dtype=float),
    starts: wp.array(dtype=State),
    first_pose: wp.array(dtype=int),
    time: wp.array(dtype=wp.float64),
    command_time: wp.array(dtype=wp.float64),
    command: wp.array(dtype=wp.vec2),
    predicted_out: wp.array(dtype=State),
):
    """Predict the states of a robot at the times of a segment of a log."""
    s = wp.tid()
    delay = wp.float64(constants[4])
    state = starts[s]
    now = time[first_pose[s]]
    predicted_out[first_pose[s]] = state
    for j in range(first_pose[s] + 1, first_pose[s + 1]):
        while now < time[j] - _ON_TIME:
            until = wp.min(time[j], now + _LONGEST)
            following = int(wp.lower_bound(command_time, now - delay + _ON_TIME))  # the last one is never in force
            until = wp.min(until, command_time[following] + delay)
            given = command[wp.max(following - 1, 0)]
            state = advanced(robot, is_car, constants, state, given, float(until - now))
            now = until
        predicted_out[j] = state


@dataclass(frozen=True)
class Identified:
    """Constants of a robot with their standard errors."""

    values: dict[str, float]
    """Value of each constant by name, those of `MODELS`."""
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
        guess: The kind, constants that are not fitted, and those that a log may not determine; by default a car.
        status: Its status; segments in which it did not work are left out.

    Raises:
        ValueError: the log is too short, its speeds or its steering angles (or commanded yaw rates) do not change, the
            commands have other names, or steering angles are not in radians.
    """
    guess, begin = guess or Robot(), track.time[0]
    given = named_commands(commands, COMMAND_NAMES[guess.kind])
    # Times of the epoch would have no room for a nanosecond, nor coordinates of a map for a centimetre.
    track = replace(track, time=track.time - begin, position=track.position - track.position[0])
    status = status and replace(status, time=status.time - begin)
    return _Fit(track, Series(commands.time - begin, given), guess, status).run()


class _Fit:
    """A fit in progress."""

    def __init__(self, track: Track, commands: Series, guess: Robot, status: Series | None):
        model, is_car = MODELS[guess.kind], guess.kind == "car"
        self._names, self._least = tuple(model), np.array([least for _, least in model.values()][:5])
        self._is_car = is_car
        self._free = 4 if is_car else 5  # number of entries of a state that the motion depends on
        track = track.without_repeats(_GAP)
        # The last command counts for as long as any other one: later, the robot may have stopped without commands.
        until = commands.time[-1] + np.diff(commands.time).max(initial=0.0)
        first, last = max(track.time[0], commands.time[0]), min(track.time[-1], until)
        inside = (track.time >= first - 1e-9) & (track.time <= last + 1e-9)
        time, count = track.time[inside], int(inside.sum())
        if count < 20 or last - first < 2 * _SEGMENT:
            rule = f"log must contain at least 20 poses over {2 * _SEGMENT:g} s with commands"
            raise ValueError(f"{rule}, got {count} over {max(last - first, 0.0):.3g} s")
        period = float(np.median(np.diff(time)))
        motion = motion_of(track, max(_GAP, _PERIODS * period))
        duration = max(_SEGMENT, _POSES * period)
        measured = np.stack([*track.position.T[:2], motion.track.heading, motion.track.speed], axis=1)[inside]
        turning = 0 if is_car else 1
        changes = np.ptp(measured[:, 3]), np.ptp(commands.value[:, turning])
        rule = f"must be of a robot whose speed and {COMMAND_NAMES[guess.kind][turning]} change"
        require(min(changes) >= 1e-3, "log", rule, "changes of {:.3g} and {:.3g}".format(*changes))
        segment = ((time - time[0]) / duration).astype(int)
        failed = np.zeros(count, bool) if status is None else status.in_force(time, before=WORKING) != WORKING
        used = np.setdiff1d(segment, segment[failed])
        require(len(used), "log", f"must have {duration:.3g} s in which the robot works", "none")
        if len(used) > _MOST_SEGMENTS:
            used = used[np.linspace(0, len(used) - 1, _MOST_SEGMENTS).astype(int)]
        chosen = np.isin(segment, used)
        self._time, self._measured = time[chosen], measured[chosen]
        self._segment = np.searchsorted(used, segment[chosen])
        # A speed that was computed from positions is no second measurement, and lags behind the robot's.
        self._is_known = np.array([True, True, True, not motion.why_derived])
        self._commands = commands
        self._first_pose = np.append(np.flatnonzero(np.diff(self._segment, prepend=-1)), len(self._segment))
        self._scale, rows = _FIRST_SCALE, self._first_pose[:-1]
        self._starts = np.column_stack([self._measured[rows], 0 * rows])
        limits = {"acceleration_max": guess.top_acceleration, "yaw_acceleration_max": guess.top_yaw_acceleration}
        given = limits | {"speed_factor": 1.0, "yaw_factor": 1.0, "delay": 0.0}
        self._guess = np.array([given[name] if name in given else getattr(guess, name) for name in model])
        arrays = self._first_pose, self._time, np.append(commands.time, np.inf), commands.value
        kinds = zip(arrays, (wp.int32, wp.float64, wp.float64, wp.vec2), strict=True)
        self._data = [wp.array(values, dtype=kind, device=as_device("cpu")) for values, kind in kinds]
        self._robot = to_struct(RobotStruct, guess), int(is_car)

    def run(self) -> Identified:
        """Fit the constants, first with the dead zone, then in turns with the scale of the residuals."""
        limits = np.isin(self._names, _LIMITS)
        constants, zone_error = self._best_of(map(self._estimate, _DELAYS)), ()
        if self._is_car:
            constants, *zone_error = self._with_dead_zone(constants)
        for _ in range(2):
            constants, _ = self._fit(constants)
            self._scale = self._deviations(constants)
        constants, _ = self._fit(constants)
        errors = np.append(self._errors(constants), zone_error)
        unknown = np.isnan(errors) | (limits & (errors > _UNKNOWN * constants))
        constants, errors = np.where(unknown, self._guess, constants), np.where(unknown, np.nan, errors)
        place, _, heading, speed = map(float, self._deviations(constants))
        residual = {"position": place, "heading": heading, "speed": speed if self._is_known[3] else math.nan}
        values, deviations = (dict(zip(self._names, map(float, row), strict=True)) for row in (constants, errors))
        return Identified(values, deviations, residual, len(self._time), self._misfits(residual))

    def _estimate(self, delay: float) -> np.ndarray:
        """Return constants with a delay [s] by the changes between two poses, of a car by linear regression."""
        same = (np.diff(self._segment) == 0) & (np.diff(self._time) > 0)
        time, width = self._time[:-1][same], np.diff(self._time)[same]
        yaw_rate, acceleration = (np.diff(self._measured[:, k])[same] / width for k in (2, 3))
        if not self._is_car:
            changes = np.abs(acceleration[1:]), np.abs(np.diff(yaw_rate) / width[1:])
            return np.array([1.0, 1.0, *np.quantile(changes, _REACHED, axis=1), delay])
        steering, throttle = self._commands.in_force(time - delay).T
        driven = 0.5 * (self._measured[1:, 3] + self._measured[:-1, 3])[same]
        turning = driven * np.tan(steering)
        on = throttle > self._guess[5]
        rows = np.stack([throttle, -np.ones_like(throttle), -driven], axis=1)[on]
        drive, offset, drag = np.linalg.lstsq(rows, acceleration[on], rcond=None)[0]
        wheelbase = (turning**2).sum() / max((turning * yaw_rate).sum(), 1e-9)
        return np.array([*np.maximum([wheelbase, drag, drive, offset], 1e-3), delay, self._guess[5]])

    def _misfits(self, residual: dict[str, float]) -> tuple[str, ...]:
        """Return the names of the residuals that the noise of the log does not explain."""
        names, counts = [], np.diff(self._first_pose)
        for name, columns in (("position", [0, 1]), ("heading", [2]), ("speed", [3])):
            values = self._measured[:, columns]
            noise = noise_of(self._time, values)
            middle = np.add.reduceat(values, self._first_pose[:-1]) / counts[:, None]
            spread = float((values - middle[self._segment]).std())
            if residual[name] > max(_NOISES * noise, _SPREAD * spread):
                names.append(name)
        return tuple(names)

    def _residuals(self, constants: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """Return the differences (K, 4) in units of their deviations, of constants and of starts (S, 5).

        They are of single precision, as the predictions are, by which `least_squares` chooses changes for derivatives.
        """
        predicted: Any = wp.zeros(len(self._time), dtype=State, device="cpu")
        given = [wp.array(constants, dtype=wp.float32, device="cpu"), wp.array(starts, dtype=State, device="cpu")]
        with compile_quietly():
            wp.launch(roll_out, len(starts), [*self._robot, *given, *self._data], [predicted], device="cpu")
        away = predicted.numpy()[..., :4] - self._measured
        away[..., 2] = (away[..., 2] + np.pi) % (2 * np.pi) - np.pi
        return np.where(self._is_known, away / self._scale, 0.0).astype(np.float32)

    def _deviations(self, constants: np.ndarray) -> np.ndarray:
        """Return the standard deviations (4,) of the log from the prediction; the scale where nothing is measured."""
        away = self._residuals(constants, self._starts) * self._scale
        # A segment's start is fitted too, which costs one degree of freedom for each.
        square = np.maximum((away**2).sum(axis=0) / max(len(away) - len(self._starts), 1), 1e-12)
        square[:2] = square[:2].mean()
        return np.where(self._is_known, np.sqrt(square), self._scale)

    def _fit(self, constants: np.ndarray, evaluations: int = 40) -> tuple[np.ndarray, float]:
        """Fit the smooth constants and the starts together; return the constants and the cost."""
        self._unit = unit = np.maximum(np.abs(constants[:5]), _LEAST_UNITS)
        free, before = self._free, self._starts
        start_unit = _START_UNITS * np.append(self._scale, _YAW_RATE_UNIT)[:free]

        def parts(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            starts = before.copy()
            starts[:, :free] += x[5:].reshape(-1, free) * start_unit
            return np.append(x[:5] * unit, constants[5:]), starts

        least = self._least / unit
        low = np.append(least, np.full(len(before) * free, -np.inf))
        initial = np.append(np.maximum(constants[:5] / unit, least), np.zeros(len(before) * free))
        # A start changes the residuals of its own segment only.
        own = np.repeat(self._segment, 4)[:, None] == np.repeat(np.arange(len(before)), free)
        solution = least_squares(
            lambda x: self._residuals(*parts(x)).ravel(),
            initial,
            "3-point",
            (low, np.inf),
            tr_solver="lsmr",
            jac_sparsity=np.column_stack([np.ones((len(own), 5), bool), own]),
            max_nfev=evaluations,
        )
        fitted, self._starts = parts(solution.x)
        self._slopes = solution.jac.toarray()
        return fitted, float(solution.cost)

    def _errors(self, constants: np.ndarray) -> np.ndarray:
        """Return the standard errors (5,) of the smooth constants; NaN for those that change nothing."""
        square = self._slopes.T @ self._slopes
        cost = float((self._residuals(constants, self._starts) ** 2).sum())
        degrees = max(len(self._time) * int(self._is_known.sum()) - len(square), 1)
        variance = np.diag(np.linalg.pinv(square))[:5] * cost / degrees
        # Rounding can make a variance that is not determined negative.
        errors = np.sqrt(np.where((np.diag(square)[:5] < 1e-16) | (variance < 0), np.nan, variance)) * self._unit
        return np.maximum(errors, _ROUNDING * np.abs(constants[:5]))

    def _with_dead_zone(self, constants: np.ndarray) -> tuple[np.ndarray, float]:
        """Return constants with the best dead zone, and its error; the given one and NaN if no throttle shows it.

        The other constants depend on it, so that they are fitted with each of some values, ever closer around the best.
        """
        # Between two throttles of the log, of either direction, every value is as good. One alone shows no dead zone.
        throttles = np.unique(np.abs(self._commands.value[:, 1]).round(7))
        zones = np.append(throttles[0] - 1e-3, 0.5 * (throttles[1:] + throttles[:-1]))
        width = len(zones)
        while width > 1:
            around = int(np.argmin(np.abs(zones - constants[-1])))
            places = np.linspace(around - width, around + width, 2 * _ZONES_FITTED + 1)
            tried = zones[np.unique(np.clip(places, 0, len(zones) - 1).astype(int))]
            constants = self._best_of(np.column_stack([np.tile(constants[:-1], (len(tried), 1)), tried]))
            width //= _ZONES_FITTED
        sets = constants, np.append(constants[:-1], zones[0])
        cost, without = ((self._residuals(given, self._starts) ** 2).sum() for given in sets)
        if len(zones) == 1 or without <= cost + 1:
            return np.append(constants[:-1], self._guess[-1]), np.nan
        place = int(np.searchsorted(throttles, constants[-1]))
        return constants, 0.5 * float(throttles[place] - throttles[place - 1])

    def _best_of(self, sets: Iterable[np.ndarray]) -> np.ndarray:
        """Return the constants of the best of some fits that begin with sets of constants."""
        before, fits = self._starts, []
        for constants in sets:
            # A bad value leads the starts astray, from where the next value would not find back.
            self._starts = before
            fitted, cost = self._fit(constants, evaluations=8)
            fits.append((cost, fitted, self._starts))
        _, best, self._starts = min(fits, key=lambda fit: fit[0])
        return best
