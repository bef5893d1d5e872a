"""Identify the constants of a differential drive from a log, by least squares on its speeds and headings.

The speed and the yaw rate of a drive follow the commands after a delay, each with a factor and a largest change per
time. The yaw rate is compared by the heading, which is its integral, within segments whose beginnings are fitted too.
"""

import math
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from lissajous_env.logs.drive_input import DRIVE_INPUTS
from lissajous_env.logs.identification import Identified
from lissajous_env.logs.log import Series, Track
from lissajous_env.logs.motion import local_deviations, motion_of
from lissajous_env.settings.robot import Robot
from lissajous_env.wording import few_of
from lissajous_env.world.state import WORKING

DRIVE_CONSTANTS: dict[str, str] = {
    "speed_factor": "",
    "yaw_factor": "",
    "acceleration_max": "m/s^2",
    "yaw_acceleration_max": "rad/s^2",
    "delay": "s",
}
"""Constants with their units: speed and yaw rate over the commanded ones, their largest changes per time, the delay."""

_SEGMENT = 2.0
"""Duration of a segment, and time after the beginning or a fault in which a log is not used [s]."""
_GAP = 0.5
"""Longest time between two poses from which a speed is computed [s]."""
_DELAYS = np.arange(0.0, 0.5, 0.05)
"""Delays with which fits begin [s]."""
_UNKNOWN = 0.5
"""Relative standard error above which a log does not determine a limit."""
_NOISES, _SPREAD, _CALM = 4.0, 0.05, 0.1
"""Factors on the noise of the log and on its spread up to which residuals are no misfit; quantile that is noise."""


def identify_drive(
    track: Track, commands: Series, guess: Robot | None = None, status: Series | None = None
) -> Identified:
    """Fit the model of a differential drive to the log of one robot.

    Args:
        track: Its path.
        commands: Its commands, with the names speed [m/s] and yaw rate [rad/s], or these two numbers without names.
        guess: Limits to start from.
        status: Its status; times in which it did not work are left out.

    Raises:
        ValueError: the log is too short, its commands do not change, or they have other names.
    """
    given = commands.columns(DRIVE_INPUTS)
    if given is None:
        got = few_of(commands.names) or f"{commands.value.shape[1]} numbers without names"
        raise ValueError(f"commands must be speed [m/s] and yaw rate [rad/s], got {got}")
    return _DriveFit(track, Series(commands.time, given), guess or Robot(kind="differential"), status).run()


def follow(
    times: np.ndarray, commands: Series, column: int, rate: float, delay: float, begin: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return a quantity that follows one column of the commands at a rate, and its integral, at some times.

    It begins with a value at the first of the times and commands.
    """
    begins = commands.time + delay
    events = np.union1d(times, begins[begins <= times[-1]])
    wanted = commands.value[np.maximum(np.searchsorted(begins, events, side="right") - 1, 0), column]
    value, total = begin, 0.0
    values, totals = [value], [total]
    for wait, aim in zip(np.diff(events).tolist(), wanted[:-1].tolist(), strict=True):
        change = min(max(aim - value, -rate * wait), rate * wait)
        total += (value + change) * wait - change * abs(change) / (2 * rate)
        value += change
        values.append(value)
        totals.append(total)
    at = np.searchsorted(events, times)
    return np.array(values)[at], np.array(totals)[at]


class _DriveFit:
    """A fit in progress."""

    def __init__(self, track: Track, commands: Series, guess: Robot, status: Series | None):
        first, last = max(track.time[0], commands.time[0]), track.time[-1]
        motion = motion_of(track, _GAP).track
        used = (track.time >= first + _SEGMENT) & (track.time <= last)  # what it did before the log is unknown
        if status is not None:
            broken = track.time[status.before(track.time) != int(WORKING)]
            after = (
                track.time - np.concatenate([[-math.inf], broken])[np.searchsorted(broken, track.time, side="right")]
            )
            used &= after > _SEGMENT
        if used.sum() < 20 or last - first < 2 * _SEGMENT:
            rule = f"log must contain at least 20 poses over {2 * _SEGMENT:g} s with commands"
            raise ValueError(f"{rule}, got {int(used.sum())} over {max(last - first, 0.0):.3g} s")
        if (np.ptp(commands.value, axis=0) < 1e-3).any():
            raise ValueError("log must be of a drive whose commanded speed and yaw rate change")
        self._time, self._commands = track.time[used], commands
        self._measured = np.stack([motion.speed, motion.heading], axis=1)[used]
        near = int(np.searchsorted(track.time, first))
        turned = np.diff(motion.heading[near : near + 2]) / np.diff(track.time[near : near + 2])
        self._first, self._begun = float(track.time[near]), (float(motion.speed[near]), float(turned[0]))
        self._segment = ((self._time - self._time[0]) / _SEGMENT).astype(int)
        self._guess = np.array([1.0, 1.0, guess.top_acceleration, guess.top_yaw_acceleration, 0.0])
        self._scale = np.array([0.02, 0.02])

    def run(self) -> Identified:
        """Fit from several delays, then again in units of the residuals of the best fit."""
        begins = [np.append(self._guess[:4], delay) for delay in _DELAYS]
        best = min((self._fit(begin, 6) for begin in begins), key=lambda solution: solution.cost)
        for _ in range(2):
            self._scale = np.maximum(self._away(best.x * self._unit).std(axis=0), 1e-6)
            best = self._fit(best.x * self._unit, 60)
        constants = best.x * self._unit
        free = max(2 * len(self._time) - len(constants), 1)
        variance = np.diag(np.linalg.pinv(best.jac.T @ best.jac)) * (2 * best.cost / free)
        errors = np.sqrt(np.maximum(variance, 0.0)) * self._unit
        still = np.abs(best.jac).max(axis=0) < 1e-9
        unknown = still | (np.array([0, 0, 1, 1, 0], bool) & (errors > _UNKNOWN * constants))
        constants, errors = np.where(unknown, self._guess, constants), np.where(unknown, np.nan, errors)
        away = self._away(constants)
        residual = {"speed": float(away[:, 0].std()), "heading": float(away[:, 1].std())}
        values, deviations = (dict(zip(DRIVE_CONSTANTS, map(float, row), strict=True)) for row in (constants, errors))
        return Identified(values, deviations, residual, len(self._time), self._misfits(away))

    def _away(self, constants: np.ndarray) -> np.ndarray:
        """Return the differences (K, 2) of speeds [m/s] and headings [rad], those of headings less a segment's mean."""
        speed_factor, yaw_factor, push, twist, delay = constants
        times = np.insert(self._time, 0, self._first)
        speeds, _ = follow(times, self._scaled(0, speed_factor), 0, push, delay, self._begun[0])
        _, headings = follow(times, self._scaled(1, yaw_factor), 1, twist, delay, self._begun[1])
        away = np.stack([speeds, headings], axis=1)[1:] - self._measured
        counts = np.maximum(np.bincount(self._segment), 1)
        away[:, 1] -= (np.bincount(self._segment, away[:, 1]) / counts)[self._segment]
        return away

    def _scaled(self, column: int, factor: float) -> Series:
        return Series(self._commands.time, self._commands.value * np.where(np.arange(2) == column, factor, 1.0))

    def _fit(self, begin: np.ndarray, evaluations: int) -> Any:
        """Return the solution of a fit, in units of `_unit`."""
        self._unit = np.maximum(self._guess, 0.1)
        low = np.array([0.05, 0.05, 1e-6, 1e-6, 0.0]) / self._unit

        def residuals(x: np.ndarray) -> np.ndarray:
            return (self._away(x * self._unit) / self._scale).ravel()

        start = np.maximum(begin / self._unit, low)
        return least_squares(residuals, start, bounds=(low, np.inf), diff_step=1e-3, max_nfev=evaluations)

    def _misfits(self, away: np.ndarray) -> tuple[str, ...]:
        """Return the names of the residuals that the noise of the log does not explain."""
        names = []
        for k, name in enumerate(("speed", "heading")):
            noise = float(np.quantile(local_deviations(self._time, self._measured[:, [k]]), _CALM))
            if away[:, k].std() > max(_NOISES * noise, _SPREAD * self._measured[:, k].std()):
                names.append(name)
        return tuple(names)
