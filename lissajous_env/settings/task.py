"""The task of a scenario: time, grids and the reward; the other parts are in `parts.py`."""

from dataclasses import dataclass
from typing import Any

from lissajous_env.settings.checks import Checked, choice, flag, is_whole, number, rows, whole

MOST_STEPS = 2**20
"""Limit on the steps of an episode."""


def _as_lines(entry: Any) -> int | None:
    return entry if is_whole(entry) and 1 <= entry <= 4096 else None


@dataclass(frozen=True)
class Task(Checked):
    """Time, grids, the effects of collisions and of the boundary, and the weights of the reward."""

    duration: float = number(60.0, 1e-3, 1e8, "s")
    """Time after which an episode is truncated [s]."""
    step: float = number(0.1, 1e-4, 100, "s")
    """Control step [s]."""
    substeps: int = whole(2, 1, 64)
    """Integration steps in a control step."""
    action: str = choice("control", "control", "velocity")
    """Meaning of an action: the robot's controls, such as steering and throttle; or, for cars, a velocity in the world
    frame, in units of the top speed, which the driver of `lissajous_env.world.robots.car` turns into controls."""
    grid: tuple[int, int] | None = rows(
        (36, 16),
        "must be (columns, rows), each from 1 to 4096, or None",
        _as_lines,
        optional=True,
    )
    """Columns and rows of the coverage grid; None disables coverage and idleness."""
    contamination: tuple[int, int] | None = rows(
        None,
        "must be (columns, rows), each from 1 to 4096, or None",
        _as_lines,
        optional=True,
    )
    """Columns and rows of the contamination grid: the cells where an undetected target may be, for the worst-case
    undetected time. None disables it. Positions are resolved to about half a cell: smaller cells reduce the error."""
    conservative: bool = flag(False)
    """True to round in favour of the evading target, which may then be anywhere in its cell and move anyhow up to the
    speed limit, while a sensor clears only cells that it covers completely at the end of a step. No target stays
    undetected longer than the result; `lissajous_env.world.contamination.conservative` proves it."""
    on_collision: str = choice("count", "count", "stop", "remove")
    """Effect of a collision on the two robots: counted only, both fail for good, or both are removed (terminated)."""
    boundary: str = choice("open", "open", "wall", "remove")
    """Effect of the boundary on cars: none; a wall that stops their bodies and cancels the velocity into it; or removal
    (termination) once the whole body is outside."""
    blocked_after: float = number(2.0, 1e-4, 1e8, "s")
    """Time after which a robot that its policy drives counts as blocked if it has not moved by its radius [s]."""
    reward_detection: float = number(1.0, -1e6, 1e6)
    """Reward of a robot for each target that it is the first to detect."""
    reward_waiting: float = number(-0.05, -1e6, 1e6, "1/s")
    """Reward of every robot per second and undetected target present; its sum is the total detection time."""
    reward_collision: float = number(-1.0, -1e6, 1e6)
    """Reward of a robot for each of its collisions."""
    reward_idleness: float = number(0.0, -1e6, 1e6, "1/s")
    """Reward of every robot per second of idleness that ends, averaged over the cells of the grid."""
    reward_effort: float = number(0.0, -1e6, 1e6)
    """Reward of a robot per step, times the mean square of its action."""
    reward_formation: float = number(0.0, -1e6, 1e6, "1/s")
    """Reward of every robot per second and radian of phase error, the largest deviation from the equilibrium (2)."""
    reward_outside: float = number(0.0, -1e6, 1e6, "1/s")
    """Reward of a robot per second during which its whole body is outside the rectangle."""
    reward_contamination: float = number(0.0, -1e6, 1e6, "1/s")
    """Reward of every robot per second of decrease of the mean age of contamination."""

    reward_observation: float = number(0.0, -1e6, 1e6, "1/s")
    """Reward of every robot per second and target that is in sight of a working robot."""

    def _check_together(self) -> None:
        self._require(self.duration >= self.step, "duration", f"must be at least one step of {self.step} s")
        self._require(self.grid is None or len(self.grid) == 2, "grid", "must be (columns, rows) or None")
        fits = self.contamination is None or len(self.contamination) == 2
        self._require(fits, "contamination", "must be (columns, rows) or None")
        self._require(self.duration <= self.step * MOST_STEPS, "duration", f"must be at most {MOST_STEPS} steps")

    @property
    def steps(self) -> int:
        """Number of control steps in an episode."""
        return round(self.duration / self.step)
