"""The sensors and messages of a scenario, its targets and its task; the other parts are in `parts.py`."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from lissajous_env.settings.checks import Checked, choice, columns_and_rows, flag, number, whole, word

MOST_STEPS = 2**20
"""Limit on the steps of an episode."""
MOST_TARGETS = 2**21
"""Limit on the targets of an episode."""


@dataclass(frozen=True)
class Sensing(Checked):
    """The sensor of a robot: an omnidirectional disc on the ground."""

    radius: float | None = number(None, 1e-6, 1e5, "m")
    """Radius within which targets are detected, and cells and robots sensed, r_s [m]; None means the smallest that
    satisfies (8)."""
    sight: float | None = number(None, 1e-6, 1e5, "m")
    """Radius within which targets and robots are observed [m], at least `radius`; None means `radius`."""
    targets_seen: int = whole(4, 0, 32)
    """Number of targets in sight in an observation, nearest first."""
    robots_seen: int = whole(2, 0, 32)
    """Number of robots in sight in an observation, nearest first."""
    tracks_seen: int = whole(0, 0, 64)
    """Number of tracks in an observation, nearest first: targets that the robot remembers or was told of."""
    teammates_seen: int = whole(0, 0, 64)
    """Number of teammates in an observation, nearest first, at the places that their last messages contained."""
    cells_seen: tuple[int, int] | None = columns_and_rows(None, 64)
    """Columns and rows of the cells in an observation, each with the time since the robot knows it covered; None for
    none."""
    memory: float = number(10.0, 1e-3, 1e6, "s")
    """Time for which a robot remembers a track, a teammate's place, and that a cell was covered [s]."""
    shared: str = choice("none", "none", "ring", "team")
    """Robots whose sightings, places and covered cells a robot receives: none, its two ring neighbours, or the whole
    team; see `lissajous_env.world.tracks`."""

    @property
    def most_seen(self) -> int:
        """Largest number of entries in a list of an observation."""
        return max(self.robots_seen, self.targets_seen, self.tracks_seen, self.teammates_seen)

    @property
    def has_tracks(self) -> bool:
        """True if the observation contains tracks or teammates."""
        return self.tracks_seen + self.teammates_seen > 0


@dataclass(frozen=True)
class Messages(Checked):
    """Messages of a policy: numbers that a robot sends to its ring neighbours beside its phase and position."""

    size: int = whole(0, 0, 32)
    """Number of components that an action has besides those that move the robot. Both ring neighbours observe them,
    with the delay and loss of the phase message. They have no actuator noise, and do not count as effort."""


@dataclass(frozen=True)
class Targets(Checked):
    """The targets: number, arrival and motion. Targets outside the four shares of motion do not move."""

    count: int = whole(20, 0, MOST_TARGETS)
    """Targets present from the start."""
    arrival_rate: float = number(0.0, 1e-9, 1e6, "1/s", or_zero=True)
    """Rate of the Poisson process by which further targets appear [1/s]."""
    entry: str = choice("inside", "inside", "boundary", "unseen", "hotspots", "custom")
    """Place where targets appear: anywhere in the rectangle, on its boundary, where no working robot senses, mostly
    around a few places, which are drawn for each episode and unknown to the robots, or where the scenario's own
    `target_entry` says. For `unseen`, if 64 random places are all sensed, the last one is used, and the target is
    detected at once."""
    hotspots: int = whole(3, 1, 64)
    """Number of the places of `hotspots`: each uniform in the middle 85 % of the width and of the height, with weights
    that are gamma variates of shape 2."""
    hotspot_spread: float = number(0.2, 0, 1e4, "m")
    """Standard deviation of the distance between a target's entry and its hotspot, along x and y [m]; entries beyond
    the boundary are moved onto it."""
    hotspot_uniform: float = number(0.1, 0, 1)
    """Share of targets that appear anywhere in the rectangle with `hotspots`."""
    respawn: bool = flag(False)
    """True if a detected target appears anew in the next step, where `entry` says, with the motion and speed that it
    had."""
    drifting: float = number(0.0, 0, 1)
    """Share of targets that move straight and bounce off the boundary."""
    wandering: float = number(1.0, 0, 1)
    """Share of targets whose heading follows a random walk."""
    fleeing: float = number(0.0, 0, 1)
    """Share of targets that flee from the nearest working robot within `flee_radius` and otherwise wander."""
    custom: float = number(0.0, 0, 1)
    """Share of targets that move by the scenario's own `target_motion`."""
    speed: float = number(0.2, 0, 1e4, "m/s")
    """Speed of drifting and wandering targets [m/s]; the highest one if `speed_min` is given."""
    speed_min: float | None = number(None, 0, 1e4, "m/s")
    """Lowest speed of drifting and wandering targets [m/s], each of which draws its own from here to `speed`; None
    means `speed`."""
    turn_rate: float = number(1.0, 0, 1e3, "rad/sqrt(s)")
    """Standard deviation of a wandering target's change of heading in one second [rad/sqrt(s)]."""
    flee_radius: float = number(0.9, 1e-6, 1e5, "m")
    """Distance to a working robot below which a fleeing target flees [m]."""
    flee_speed: float = number(0.6, 0, 1e4, "m/s")
    """Speed of a target while it flees [m/s]; lower along the boundary."""
    flight: str = choice("nearest", "nearest", "all")
    """Direction of flight: away from the nearest working robot; or from all of these within `flee_radius` and from the
    walls, each robot with a weight of one over its distance, and each wall with half of that."""
    speed_limit: float | None = number(None, 0, 1e4, "m/s")
    """Speed limit of evading targets, for the worst-case undetected time [m/s]; None means the highest speed of these
    targets. Required where targets move by the scenario's own motion."""
    leave: bool = flag(True)
    """True if a target leaves once it is detected."""
    rogues: str | None = word(None, "must be agents, the name of a rogue, or the folder of one")
    """Adversary that moves all targets within `speed_limit`, instead of the motions above: `agents`, the name of a
    rogue, or the folder of a learned one; see `lissajous_env.world.rogues`."""
    sight: float | None = number(None, 1e-6, 1e5, "m")
    """Distance within which a rogue observes robots [m]; None means that it observes all of them."""

    def _check_together(self) -> None:
        total = self.drifting + self.wandering + self.fleeing + self.custom
        self._require(total < 1 + 1e-9, "fleeing", "must not make drifting + wandering + fleeing + custom exceed 1")
        is_lower = self.speed_min is None or self.speed_min <= self.speed
        self._require(is_lower, "speed_min", f"must be at most speed = {self.speed:g} [m/s]")
        self._require(self.leave or not self.respawn, "respawn", "must be False if targets do not leave")
        self._require(self.rogues is None or not self.respawn, "respawn", "must be False with rogues")
        is_free = self.speed_limit is None or self.rogues is not None or self.speed_limit >= self.speed_max
        rule = f"must be None or at least the speed of these targets, {self.speed_max:g} m/s"
        self._require(is_free, "speed_limit", rule)

    @property
    def speed_max(self) -> float:
        """Highest speed of drifting, wandering and fleeing targets [m/s]."""
        roaming = self.drifting + self.wandering + self.fleeing > 0
        return max(self.speed if roaming else 0.0, self.flee_speed if self.fleeing > 0 else 0.0)


def without_custom_motion(fields: Mapping[str, Any]) -> dict[str, Any]:
    """Return fields of targets without those of extensions: their targets then appear anywhere, and do not move."""
    entry = {"entry": "inside"} if fields.get("entry") == "custom" else {}
    return {**fields, **entry} | ({"custom": 0.0} if fields.get("rogues") is None else {})


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
    grid: tuple[int, int] | None = columns_and_rows((36, 16), 4096)
    """Columns and rows of the coverage grid; None disables coverage and idleness."""
    contamination: tuple[int, int] | None = columns_and_rows(None, 4096)
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
    """Reward of a working robot per step, times the mean square of its action."""
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
        self._require(self.duration <= self.step * MOST_STEPS, "duration", f"must be at most {MOST_STEPS} steps")

    @property
    def steps(self) -> int:
        """Number of control steps in an episode."""
        return round(self.duration / self.step)
