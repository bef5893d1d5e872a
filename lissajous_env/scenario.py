"""A scenario: what is fixed during an episode, as frozen dataclasses that are checked once, at construction.

Units are SI, angles radians. Fields that are None by default are derived from others; `Scenario.resolve` fills them in.
"""

import dataclasses
import hashlib
import json
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from lissajous_env import theory
from lissajous_env.fields import (
    Checked,
    choice,
    finite,
    flag,
    fraction,
    non_negative,
    odd,
    positive,
    positive_or_infinite,
    rows,
    spread,
    whole,
    within,
)


def _is_fault(entry) -> bool:
    return len(entry) == 3 and float(entry[0]).is_integer() and entry[0] >= 0 and 0 <= entry[1] < entry[2]


def _is_robot_and_number(entry) -> bool:
    return len(entry) == 2 and float(entry[0]).is_integer() and entry[0] >= 0 and math.isfinite(entry[1])


@dataclass(frozen=True)
class Curve(Checked):
    """The Lissajous curve (3), or (10) where `half_depth` is above 0, and with it the rectangle [-A, A] x [-B, B]."""

    half_width: float = positive(1.8, "m")
    """A, half of the rectangle's width [m]."""
    half_height: float = positive(0.8, "m")
    """B, half of the rectangle's height [m]."""
    a: int = odd(3)
    """a, oscillations along x in one lap; odd."""
    b: int = whole(2, at_least=1)
    """b, oscillations along y in one lap; shares no factor with a."""
    half_depth: float = non_negative(0.0, "m")
    """C of (10), half of the curve's extent along z [m]; 0 is the plane curve."""
    c: int = whole(1, at_least=1)
    """c of (10), oscillations along z in one lap."""

    def _check_together(self) -> None:
        # The paper does not ask for it, but without it the formation collides: (3, 6) has a smallest distance of 0.
        self._require(math.gcd(self.a, self.b) == 1, "b", f"must share no factor with a = {self.a}")


@dataclass(frozen=True)
class Formation(Checked):
    """How robots coordinate along the curve: dynamics (1) and its equilibrium (2)."""

    phase_rate: float = positive(0.3, "rad/s")
    """omega of (1), the rate of the robots along the curve's parameter in the equilibrium [rad/s]."""
    coupling: float = non_negative(1.0, "1/s")
    """K, the gain on the sum in (1) [1/s]; the paper prints 1."""
    p: int | None = whole(None, at_least=0)
    """p of the equilibrium (2); None takes the least clustered stable one."""
    alpha: int | None = whole(None, at_least=1)
    """alpha of Lemma 2: gamma = alpha theta; None makes neighbours on the ring neighbours on the ellipse (5)."""
    ring: tuple[int, ...] | None = rows(
        None, "must list robots as whole numbers from 0", lambda robot: isinstance(robot, int) and robot >= 0
    )
    """Order of the robots around the communication ring; None is 0, 1 ... N - 1."""
    start: str = choice("equilibrium", "equilibrium", "rotated", "random")
    """Phases at reset: the equilibrium (2) with theta_0 = 0, the same turned by a random angle, or all random."""
    start_noise: float = non_negative(0.0, "rad")
    """Standard deviation of a random displacement of each robot's phase at reset [rad]."""
    displaced: tuple[tuple[int, float], ...] = rows(
        (), "must hold pairs of a robot and an angle [rad]", _is_robot_and_number
    )
    """Robots displaced along the phase at reset, each as (robot, angle [rad])."""


@dataclass(frozen=True)
class Robot(Checked):
    """The robots: points on the curve, or kinematic bicycles (12) driven by a motor."""

    kind: str = choice("car", "car", "curve")
    """`car`: action = steering, throttle. `curve`: a point on the curve, action = phase rate."""
    count: int | None = whole(None, at_least=1, at_most=1024)
    """N; None is a + b."""
    radius: float = positive(0.125, "m")
    """r_i, radius of the disc (the ball, in three dimensions) that two robots must keep from sharing [m]."""
    phase_rate_max: float | None = positive(None, "rad/s")
    """Phase rate of a `curve` robot at action 1 [rad/s]; None is what (1) can ask for, omega / alpha + 2 K."""
    wheelbase: float = positive(0.175, "m")
    """l, distance between the axles [m]."""
    steering_max: float = within(math.pi / 9, 0, math.pi / 2, "rad")
    """Largest steering angle to either side [rad]."""
    throttle_min: float = non_negative(0.1)
    """tau at action -1."""
    throttle_max: float = positive(0.25)
    """tau at action 1."""
    drag: float = positive(0.945, "1/s")
    """c, damping of the speed [1/s]."""
    drive: float = positive(36.81, "m/s^2")
    """alpha of the motor, acceleration per throttle [m/s^2]; no relation to alpha of Lemma 2."""
    offset: float = non_negative(3.681, "m/s^2")
    """beta, deceleration of the motor [m/s^2].

    Differs from the paper: it prints 0.94, with which the slowest car does 2.9 m/s and cannot follow the curve.
    """
    dead_zone: float = non_negative(0.1)
    """Throttle up to which the motor does not drive and the car coasts."""
    model_offset: float | None = non_negative(None, "m/s^2")
    """beta as the designer of a controller measured it [m/s^2]; None is `offset`."""
    lateral_acceleration_max: float = positive_or_infinite(math.inf, "m/s^2")
    """Grip: the yaw rate is limited to this over the speed [m/s^2]."""

    def _check_together(self) -> None:
        self._require(self.throttle_max > self.throttle_min, "throttle_max", "must be above throttle_min")
        self._require(self.speed_max > 0, "throttle_max", "must be able to move the car: drive tau > offset")

    @property
    def speed_max(self) -> float:
        """Steady speed of a car at full throttle [m/s]."""
        return (self.drive * self.throttle_max - self.offset) / self.drag


@dataclass(frozen=True)
class Sensing(Checked):
    """What a robot senses around itself: an omnidirectional disc on the ground."""

    radius: float | None = positive(None, "m")
    """r_s, within which targets, cells and other robots are sensed [m]; None is the smallest by (8)."""
    targets_seen: int = whole(4, at_least=0, at_most=32)
    """How many targets in the disc, nearest first, an observation lists."""
    robots_seen: int = whole(2, at_least=0, at_most=32)
    """How many robots in the disc, nearest first, an observation lists."""


@dataclass(frozen=True)
class Targets(Checked):
    """Rogue targets: how many, when and where they appear, how they move. What is not said to move stands still."""

    count: int = whole(20, at_least=0, at_most=1_000_000)
    """Targets present from the start."""
    arrival_rate: float = non_negative(0.0, "1/s")
    """Rate of the Poisson process by which further targets appear [1/s]."""
    entry: str = choice("inside", "inside", "boundary")
    """Where a target appears: anywhere in the rectangle, or on its boundary."""
    drifting: float = fraction(0.0)
    """Share of targets that go straight on and bounce off the boundary."""
    wandering: float = fraction(1.0)
    """Share of targets whose heading walks at random."""
    fleeing: float = fraction(0.0)
    """Share of targets that run from the nearest robot in `flee_radius` and otherwise wander."""
    speed: float = non_negative(0.2, "m/s")
    """Speed of drifting and wandering targets [m/s]."""
    turn_rate: float = non_negative(1.0, "rad/sqrt(s)")
    """Standard deviation of a wandering target's change of heading in one second [rad/sqrt(s)]."""
    flee_radius: float = positive(0.9, "m")
    """Distance to a robot below which a fleeing target runs [m]."""
    flee_speed: float = non_negative(0.6, "m/s")
    """Speed of a running target [m/s]; the boundary can make it slower."""
    leave: bool = flag(True)
    """Whether a target leaves once it was detected."""

    def _check_together(self) -> None:
        total = self.drifting + self.wandering + self.fleeing
        self._require(total < 1 + 1e-9, "fleeing", "must leave drifting + wandering + fleeing at 1 or below")


@dataclass(frozen=True)
class Faults(Checked):
    """Robots that fail. A stuck robot stops, senses nothing and still sends its phase; a removed one is gone."""

    schedule: tuple[tuple[int, float, float], ...] = rows(
        (), "must hold rows of a robot, a start and a later end [s]", _is_fault
    )
    """Robots stuck for a time, each as (robot, start [s], end [s]); an infinite end lasts for good."""
    removed: tuple[tuple[int, float], ...] = rows(
        (), "must hold pairs of a robot and a time of at least 0 [s]", lambda v: _is_robot_and_number(v) and v[1] >= 0
    )
    """Robots removed for good, each as (robot, time [s])."""
    rate: float = non_negative(0.0, "1/s")
    """Rate at which each working robot gets stuck at random [1/s]."""
    mean_duration: float = positive(5.0, "s")
    """Mean of the exponential time that a random fault lasts [s]."""
    lost: int = whole(0, at_least=0)
    """Robots, chosen at random, that are removed at a random time in the middle half of the episode."""


@dataclass(frozen=True)
class Noise(Checked):
    """Disturbances. Standard deviations are of independent normal draws in each step, spreads of one in an episode."""

    actuator: float = non_negative(0.0)
    """Standard deviation added to each component of the action, in units of the action's range [-1, 1]."""
    position: float = non_negative(0.0, "m")
    """Standard deviation of a measured coordinate [m]."""
    heading: float = non_negative(0.0, "rad")
    """Standard deviation of a measured heading [rad]."""
    speed: float = non_negative(0.0, "m/s")
    """Standard deviation of a measured speed [m/s]."""
    wheelbase_spread: float = spread(0.0, below=0.3)
    """Relative standard deviation of the wheelbase between robots."""
    drive_spread: float = spread(0.0, below=0.3)
    """Relative standard deviation of the motor's drive between robots."""
    message_loss: float = fraction(0.0)
    """Probability that a message to a ring neighbour is lost."""
    message_delay: float = non_negative(0.0, "s")
    """Time that a message is on its way, rounded to whole steps [s]."""


@dataclass(frozen=True)
class Task(Checked):
    """Time, grid, what a collision does, and the weights of the reward."""

    duration: float = positive(60.0, "s")
    """Time after which an episode is truncated [s]."""
    step: float = positive(0.1, "s")
    """Control step [s]."""
    substeps: int = whole(2, at_least=1, at_most=64)
    """Integration steps in a control step."""
    grid: tuple[int, int] | None = rows(
        (36, 16),
        "must be (columns, rows), each from 1 to 4096, or None",
        lambda n: isinstance(n, int) and 1 <= n <= 4096,
        optional=True,
    )
    """Columns and rows of the coverage grid; None leaves coverage and idleness out."""
    on_collision: str = choice("count", "count", "stop", "remove")
    """What a collision does to the two robots: nothing but count, stops them for good, or removes (terminates) them."""
    reward_detection: float = finite(1.0)
    """Reward of a robot for each target that it is the first to detect."""
    reward_waiting: float = finite(-0.05, "1/s")
    """Reward of every robot per second and undetected target present: the time of detection, as it passes."""
    reward_collision: float = finite(-1.0)
    """Reward of a robot for each collision that it is in."""
    reward_idleness: float = finite(0.0, "1/s")
    """Reward of every robot per second of idleness that it ends, averaged over the cells of the grid."""
    reward_effort: float = finite(0.0)
    """Reward of a robot per step and mean square of its action."""
    reward_formation: float = finite(0.0, "1/s")
    """Reward of every robot per second and radian of phase error: the largest deviation from the equilibrium (2)."""

    def _check_together(self) -> None:
        self._require(self.duration >= self.step, "duration", f"must be at least one step of {self.step} s")
        self._require(self.grid is None or len(self.grid) == 2, "grid", "must be (columns, rows) or None")
        self._require(self.duration <= self.step * 2**20, "duration", f"must be at most {2**20} steps")

    @property
    def steps(self) -> int:
        """Control steps in an episode."""
        return round(self.duration / self.step)


PARTS = {part.__name__.lower(): part for part in (Curve, Formation, Robot, Sensing, Targets, Faults, Noise, Task)}


@dataclass(frozen=True)
class Scenario:
    """Everything that is fixed during an episode. The parts are checked on their own, then together here."""

    name: str = "custom"
    description: str = ""
    curve: Curve = Curve()
    formation: Formation = Formation()
    robot: Robot = Robot()
    sensing: Sensing = Sensing()
    targets: Targets = Targets()
    faults: Faults = Faults()
    noise: Noise = Noise()
    task: Task = Task()

    def __post_init__(self) -> None:
        for name, part in PARTS.items():
            if not isinstance(getattr(self, name), part):
                raise ValueError(f"{name} must be a {part.__name__}, got {getattr(self, name)!r}")
        n = self.num_robots
        named = [
            ("formation.ring", self.formation.ring or ()),
            ("formation.displaced", [robot for robot, _ in self.formation.displaced]),
            ("faults.schedule", [robot for robot, _, _ in self.faults.schedule]),
            ("faults.removed", [robot for robot, _ in self.faults.removed]),
        ]
        for name, robots in named:
            if any(robot >= n for robot in robots):
                raise ValueError(f"{name} must name robots 0 to {n - 1}, got {tuple(robots)}")
        ring = self.formation.ring
        if ring is not None and sorted(ring) != list(range(n)):
            raise ValueError(f"formation.ring must hold each of the {n} robots once, got {ring}")
        if self.faults.lost > n:
            raise ValueError(f"faults.lost must be at most the {n} robots, got {self.faults.lost}")
        if self.curve.half_depth > 0 and self.robot.kind == "car":
            raise ValueError(f"curve.half_depth must be 0 for cars [m], got {self.curve.half_depth}")
        if self.targets.arrival_rate * self.task.duration > 1_000_000:
            rate = self.targets.arrival_rate
            raise ValueError(f"targets.arrival_rate must bring at most 1,000,000 targets an episode [1/s], got {rate}")

    @cached_property
    def num_robots(self) -> int:
        """N, a + b where `robot.count` does not say."""
        return self.curve.a + self.curve.b if self.robot.count is None else int(self.robot.count)

    @cached_property
    def p(self) -> int:
        """p of the equilibrium (2)."""
        return theory.default_p(self.num_robots) if self.formation.p is None else self.formation.p

    @cached_property
    def alpha(self) -> int:
        """alpha of Lemma 2, in gamma = alpha theta."""
        if self.formation.alpha is not None:
            return self.formation.alpha
        return theory.default_alpha(self.curve, self.num_robots, self.p)

    @cached_property
    def clusters(self) -> int:
        """kappa, how many robots share a place on the curve in the equilibrium (Lemma 1)."""
        return theory.cluster_size(self.num_robots, self.p, self.alpha)

    @cached_property
    def ring(self) -> tuple[int, ...]:
        """Robots in the order of the communication ring."""
        return self.formation.ring or tuple(range(self.num_robots))

    @cached_property
    def neighbours(self) -> np.ndarray:
        """(N, 2) the robots before and after each one on the ring, -1 for none (N < 3)."""
        n, ring = self.num_robots, self.ring
        table = np.full((n, 2), -1, dtype=np.int32)
        for place, robot in enumerate(ring):
            if n > 2:
                table[robot] = ring[place - 1], ring[(place + 1) % n]
            elif n == 2:
                table[robot, 0] = ring[1 - place]
        return table

    @cached_property
    def equilibrium(self) -> np.ndarray:
        """(N,) phases of the equilibrium (2) with theta_0 = 0 [rad]."""
        return theory.equilibrium_phases(self.num_robots, self.p, self.ring)

    @cached_property
    def robot_radius_bound(self) -> float:
        """r_max of (6) [m]."""
        return theory.robot_radius_bound(self.curve, self.num_robots)

    @cached_property
    def coverage_radius(self) -> float:
        """Sensing radius of (7) [m]."""
        return theory.coverage_radius(self.curve)

    @cached_property
    def detection_radius(self) -> float:
        """Sensing radius of (8) [m]."""
        return theory.detection_radius(self.curve, self.num_robots, self.clusters)

    @property
    def sensing_radius(self) -> float:
        """r_s, the smallest by (8) where `sensing.radius` does not say [m]."""
        return self.detection_radius if self.sensing.radius is None else self.sensing.radius

    @cached_property
    def detection_time_bound(self) -> float:
        """T_max [s]."""
        return theory.detection_time_bound(self.formation.phase_rate, self.num_robots, self.clusters)

    @cached_property
    def target_capacity(self) -> int:
        """Most targets of one episode: those of the start, and arrivals up to six deviations above the mean."""
        mean = self.targets.arrival_rate * self.task.duration
        arrivals = math.ceil(mean + 6 * math.sqrt(mean))
        return self.targets.count + arrivals

    @property
    def action_size(self) -> int:
        """Components of a robot's action: phase rate, or steering and throttle."""
        return 1 if self.robot.kind == "curve" else 2

    def resolve(self) -> "Scenario":
        """Return the same scenario with every derived field filled in; changes nothing in how it runs."""
        rate_max = self.robot.phase_rate_max
        if rate_max is None:
            rate_max = self.formation.phase_rate / self.alpha + 2 * self.formation.coupling
        offset = self.robot.offset if self.robot.model_offset is None else self.robot.model_offset
        robot = dataclasses.replace(self.robot, count=self.num_robots, phase_rate_max=rate_max, model_offset=offset)
        formation = dataclasses.replace(self.formation, p=self.p, alpha=self.alpha, ring=self.ring)
        sensing = dataclasses.replace(self.sensing, radius=self.sensing_radius)
        return dataclasses.replace(self, robot=robot, formation=formation, sensing=sensing)

    def to_dict(self) -> dict:
        """Nested plain values, as written beside results."""
        return dataclasses.asdict(self)

    def digest(self) -> str:
        """Hash of all numbers of the scenario, name and description left out."""
        numbers = {name: value for name, value in self.to_dict().items() if name in PARTS}
        return hashlib.sha256(json.dumps(numbers, sort_keys=True).encode()).hexdigest()[:16]
