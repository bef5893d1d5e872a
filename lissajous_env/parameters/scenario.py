"""The scenario: all constants of an episode, as frozen dataclasses that are checked once, at construction.

Units are SI, angles radians. Fields that are None by default are derived from others; `Scenario.resolve` fills them in.
"""

import dataclasses
import hashlib
import json
import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from lissajous_env.device.locks import with_own_locks
from lissajous_env.parameters.extensions import Extension, TargetMotion, as_extensions
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.parameters.rogues import BringsRogues, rogue_of
from lissajous_env.parameters.spreading import Spreading, spreading_of
from lissajous_env.settings.parts import (
    MOST_TARGETS,
    SPRINT,
    Curve,
    Faults,
    Formation,
    Messages,
    Noise,
    Sensing,
    Targets,
)
from lissajous_env.settings.robot import Robot
from lissajous_env.settings.task import Task
from lissajous_env.theory import closed_forms, geometry

__all__ = [
    "PARTS",
    "Curve",
    "Faults",
    "Formation",
    "Messages",
    "Noise",
    "Robot",
    "Scenario",
    "Sensing",
    "Targets",
    "Task",
]

PARTS = {
    part.__name__.lower(): part for part in (Curve, Formation, Robot, Sensing, Targets, Faults, Noise, Messages, Task)
}
_OUTSIDE = 1.002
"""Factor by which a curve of harmonics may exceed its rectangle; `Curve.through` has an error of up to 0.1 %."""


@with_own_locks
@dataclass(frozen=True)
class Scenario(BringsRogues):
    """All constants of an episode, in parts. Each part checks its own fields; this class checks rules across parts."""

    name: str = "custom"
    description: str = ""
    curve: Curve = field(default_factory=Curve)
    formation: Formation = field(default_factory=Formation)
    robot: Robot = field(default_factory=Robot)
    sensing: Sensing = field(default_factory=Sensing)
    targets: Targets = field(default_factory=Targets)
    faults: Faults = field(default_factory=Faults)
    noise: Noise = field(default_factory=Noise)
    task: Task = field(default_factory=Task)
    extensions: tuple[Extension, ...] = ()
    """Extensions, as objects, `module:name` or tables; see `lissajous_env.parameters.extensions`."""
    messages: Messages = field(default_factory=Messages)

    def __post_init__(self) -> None:
        for name, part in PARTS.items():
            if not isinstance(getattr(self, name), part):
                raise ValueError(f"{name} must be a {part.__name__}, got {getattr(self, name)!r}")
        for name in ("name", "description"):
            if not isinstance(getattr(self, name), str):
                raise ValueError(f"{name} must be text, got {getattr(self, name)!r}")
        object.__setattr__(self, "extensions", as_extensions(self.extensions))
        self._check_harmonics()
        self._check_robots()
        self._check_inset()
        self._check_times()
        model_of(self.robot.kind).check(self.curve, self.formation, self.robot, self.noise, self.task)
        self._check_contamination()
        self._check_rogues()
        if self.target_capacity > MOST_TARGETS:
            rule = f"must bring at most {MOST_TARGETS} targets per episode, with those of the start and six deviations"
            raise ValueError(f"targets.arrival_rate {rule} [1/s], got {self.targets.arrival_rate}")

    def _check_harmonics(self) -> None:
        if not self.curve.harmonics:
            return
        gamma = np.linspace(0, 2 * np.pi, 32 * len(self.curve.harmonics) + 64, endpoint=False)
        extent = np.abs(closed_forms.curve_point(self.curve, gamma)).max(axis=0)
        if (extent > _OUTSIDE * np.array([self.curve.half_width, self.curve.half_height])).any():
            rule = (
                f"must stay in the rectangle, {self.curve.half_width:g} m x {self.curve.half_height:g} m to each side"
            )
            raise ValueError(f"curve.harmonics {rule}, got a curve that reaches {extent[0]:.6g} m x {extent[1]:.6g} m")

    def _check_robots(self) -> None:
        if self.curve.harmonics:
            for name, value in (("robot.count", self.robot.count), ("sensing.radius", self.sensing.radius)):
                if value is None:
                    raise ValueError(
                        f"{name} must be given for a curve of harmonics, because the paper's formulas do not apply"
                    )
        n = self.num_robots
        if n > 1024:
            raise ValueError(f"robot.count must be given, from 1 to 1024, because a + b is {n}, got None")
        named = [
            ("formation.ring", self.formation.ring or ()),
            ("formation.displaced", [robot for robot, _ in self.formation.displaced]),
            ("robot.drive_factors", [robot for robot, _ in self.robot.drive_factors]),
            ("faults.schedule", [robot for robot, _, _ in self.faults.schedule]),
            ("faults.removed", [robot for robot, _ in self.faults.removed]),
        ]
        for name, robots in named:
            if any(robot >= n for robot in robots):
                raise ValueError(f"{name} must name robots 0 to {n - 1}, got {tuple(robots)}")
        ring = self.formation.ring
        if ring is not None and sorted(ring) != list(range(n)):
            raise ValueError(f"formation.ring must contain each of the {n} robots once, got {ring}")
        if self.faults.lost > n:
            raise ValueError(f"faults.lost must be at most the {n} robots, got {self.faults.lost}")
        if self.faults.stop == "coast" and self.robot.kind != "car":
            raise ValueError(f"faults.stop must be dead for robots of kind {self.robot.kind}, got coast")

    def _check_inset(self) -> None:
        half, radius = min(self.curve.half_width, self.curve.half_height), self.robot.radius
        if self.task.boundary == "wall" and radius >= half:
            raise ValueError(
                f"robot.radius must be below {half:g}, half of the distance of the walls [m], got {radius}"
            )
        if self.inset >= half:
            raise ValueError(
                f"curve.inset must be below {half:g}, half of the rectangle's side [m], got {self.inset:g}"
            )
        if self.sensing.radius is not None and self.sensing.radius < self.inset:
            rule = f"must be at least the inset of {self.inset:g}, or robots do not sense the edge [m]"
            raise ValueError(f"sensing.radius {rule}, got {self.sensing.radius}")

    def _check_contamination(self) -> None:
        if self.task.contamination is not None and self.targets.custom > 0 and self.targets.speed_limit is None:
            rule = "must be given if targets have a custom motion and task.contamination is set"
            raise ValueError(f"targets.speed_limit {rule} [m/s], got None")
        _ = self.spreading

    def _check_rogues(self) -> None:
        name = self.targets.rogues
        if name is None:
            return
        rogue = rogue_of(name)
        if self.rogue_speed <= 0:
            raise ValueError(
                f"targets.speed_limit must be above 0 if rogues move the targets [m/s], got {self.rogue_speed}"
            )
        if rogue is not None and rogue.needs_contamination and self.task.contamination is None:
            raise ValueError(f"task.contamination must be given for the rogue {name}, got None")
        for each in self.extensions:
            if isinstance(each, TargetMotion):
                raise ValueError(f"targets.rogues must be None with the target motion {each.name}, got {name}")

    def _check_times(self) -> None:
        """Check that times do not round to zero steps."""
        step = self.task.step
        for fault in self.faults.schedule:
            if fault[2] < math.inf and round(fault[2] / step) == round(fault[1] / step):
                rule = (
                    f"must contain faults of at least one step of {step:g} s, after both ends are rounded to steps [s]"
                )
                raise ValueError(f"faults.schedule {rule}, got {fault}")
        delay = self.noise.message_delay
        if delay > 0 and not 1 <= round(delay / step) <= 1000:
            raise ValueError(f"noise.message_delay must be 0 or from 1 to 1000 steps of {step:g} s [s], got {delay}")

    @cached_property
    def num_robots(self) -> int:
        """N: `robot.count`, or a + b by default."""
        return self.curve.a + self.curve.b if self.robot.count is None else int(self.robot.count)

    @cached_property
    def p(self) -> int:
        """p of the equilibrium (2)."""
        return closed_forms.default_p(self.num_robots) if self.formation.p is None else self.formation.p

    @property
    def coupling(self) -> float:
        """K of (1) [1/s]: `formation.coupling`, or omega / (0.3 rad) by default."""
        given = self.formation.coupling
        return self.time_unit**-1 if given is None else given

    @property
    def time_unit(self) -> float:
        """Unit of time of the coordination [s], in which the formation advances by 0.3 rad; 1 s in the experiment."""
        return 0.3 / self.formation.phase_rate

    @cached_property
    def alpha(self) -> int:
        """alpha of Lemma 2, in gamma = alpha theta."""
        if self.formation.alpha is not None:
            return self.formation.alpha
        return closed_forms.default_alpha(self.curve, self.num_robots, self.p)

    @cached_property
    def clusters(self) -> int:
        """kappa: number of robots that share a place on the curve in the equilibrium (Lemma 1)."""
        return closed_forms.cluster_size(self.num_robots, self.p, self.alpha)

    @cached_property
    def ring(self) -> tuple[int, ...]:
        """Robots in the order of the communication ring."""
        return self.formation.ring or tuple(range(self.num_robots))

    @cached_property
    def neighbours(self) -> np.ndarray:
        """(N, 2) previous and next robot of each one on the ring; -1 for none (N < 3)."""
        n, ring = self.num_robots, self.ring
        table = np.full((n, 2), -1, dtype=np.int32)
        for place, robot in enumerate(ring):
            if n > 2:
                table[robot] = ring[place - 1], ring[(place + 1) % n]
            elif n == 2:
                table[robot, 0] = ring[1 - place]
        table.flags.writeable = False
        return table

    @cached_property
    def equilibrium(self) -> np.ndarray:
        """(N,) phases of the equilibrium (2) with theta_0 = 0 [rad]."""
        phases = closed_forms.equilibrium_phases(self.num_robots, self.p, self.ring)
        phases.flags.writeable = False
        return phases

    @cached_property
    def places(self) -> tuple[int, ...]:
        """Place of each robot; robots of the same place overlap by design, so their collisions are not counted.

        Points on the curve share each place of the equilibrium with kappa - 1 others (Lemma 1). All other robots have a
        place of their own: two cars in one place do collide.
        """
        shared = self.num_robots // self.clusters if model_of(self.robot.kind).keeps_to_curve else self.num_robots
        return tuple(self.ring.index(robot) % shared for robot in range(self.num_robots))

    @cached_property
    def drive_factors(self) -> np.ndarray:
        """(N,) factor on `robot.drive` of each robot, from `robot.drive_factors`."""
        factors = np.ones(self.num_robots)
        for robot, factor in self.robot.drive_factors:
            factors[robot] *= factor
        factors.flags.writeable = False
        return factors

    @cached_property
    def top_speeds(self) -> np.ndarray:
        """(N,) top speed of each robot [m/s]; infinite for points and registered models."""
        if self.robot.kind not in ("car", "differential"):
            return np.full(self.num_robots, np.inf)
        return np.array([self.robot.steady_speed(self.robot.drive * factor) for factor in self.drive_factors])

    @property
    def top_speed_bound(self) -> float:
        """Largest top speed of a car or drive that the factors and the spread of drives permit [m/s]."""
        return self.robot.steady_speed(self.robot.drive * self.noise.most_drive * float(self.drive_factors.max()))

    @cached_property
    def inset(self) -> float:
        """Width of the strip along the edge of the rectangle in which nothing is driven [m].

        This is `curve.inset`. By default it is 0, or with walls the radius of a body, the way by which a car that turns
        one step late comes closer to a wall, and three standard deviations of a measured coordinate.
        """
        if self.curve.inset is not None:
            return self.curve.inset
        if self.task.boundary != "wall":
            return 0.0
        return self.robot.radius + self._late_turn() + 3 * self.noise.position

    def _late_turn(self) -> float:
        """Return the way towards a wall during a step in which a car should have turned already [m]."""
        model = model_of(self.robot.kind)
        if model.keeps_to_curve:
            return 0.0
        fastest = self.formation.phase_rate * geometry.largest_speed(self.curve)
        step = self.task.step * min(model.speed_unit(self.curve, self.formation, self.robot), fastest)
        return min(step**2 / (2 * self._turning_radius()), step)

    def _turning_radius(self) -> float:
        """Return the radius of a robot's tightest turn [m]."""
        model = model_of(self.robot.kind)
        if model.as_car is not None:
            return model.as_car.turning_radius(self.robot)
        return geometry.turning_radius(self.robot.wheelbase, self.robot.steering_max)

    @cached_property
    def start_turning(self) -> float:
        """Radius of the turn for which every car has room at the start [m]; 0 without walls, or if cars can reverse.

        It is a tenth above that of the tightest turn of a car of the longest wheelbase (`world.robots.facing`).
        """
        if self.task.boundary != "wall" or self.robot.kind != "car" or self.robot.reverses:
            return 0.0
        return 1.1 * (1 + 3 * self.noise.wheelbase_spread) * self._turning_radius()

    @cached_property
    def driven(self) -> Curve:
        """The curve that is driven: that of the rectangle without the inset."""
        return dataclasses.replace(self.curve, inset=self.inset).driven if self.inset else self.curve

    @cached_property
    def robot_radius_bound(self) -> float:
        """r_max of (6) [m]."""
        return closed_forms.robot_radius_bound(self.driven, self.num_robots)

    @cached_property
    def coverage_radius(self) -> float:
        """Sensing radius of (7) [m], with sqrt(2) `inset` added.

        No point of the rectangle is farther than that from the rectangle of the curve that is driven.
        """
        return closed_forms.coverage_radius(self.driven) + math.sqrt(2) * self.inset

    @cached_property
    def neighbour_distance(self) -> float:
        """Largest distance of ring neighbours in the undisturbed formation, twice (8) of the driven curve [m]."""
        return 2 * closed_forms.detection_radius(self.driven, self.num_robots, self.clusters)

    @cached_property
    def detection_radius(self) -> float:
        """Sensing radius of (8) [m], with sqrt(2) `inset` added as for `coverage_radius`."""
        return self.neighbour_distance / 2 + math.sqrt(2) * self.inset

    @property
    def sensing_radius(self) -> float:
        """r_s [m]: `sensing.radius`, or the smallest that satisfies (8) by default."""
        return self.detection_radius if self.sensing.radius is None else self.sensing.radius

    @cached_property
    def detection_time_bound(self) -> float:
        """Detection-time bound T_max [s]; it holds only where `detection_time_is_bounded`."""
        return closed_forms.detection_time_bound(self.formation.phase_rate, self.num_robots, self.clusters)

    @property
    def detection_time_is_bounded(self) -> bool:
        """True if T_max bounds the detection time in the undisturbed formation.

        This requires that the equilibrium (2) is stable, that the robots have a + b places, and that the sensing radius
        satisfies (8), so that the discs of neighbours on the ellipse (5) always overlap.
        """
        n, curve = self.num_robots, self.curve
        if curve.harmonics or n != self.clusters * (curve.a + curve.b):
            return False
        stable = self.p in closed_forms.stable_equilibria(n)
        return stable and self.sensing_radius >= self.detection_radius * (1 - 1e-9)

    @property
    def detection_time_label(self) -> str:
        """Label of `detection_time_bound` in tables and pictures: "T_max", or "T_max (no bound)"."""
        return "T_max" if self.detection_time_is_bounded else "T_max (no bound)"

    @property
    def rogue_speed(self) -> float:
        """Speed limit of evading targets [m/s]: `targets.speed_limit`, or by default that of the fastest target."""
        limit = self.targets.speed_limit
        return self.targets.speed_max if limit is None else limit

    @cached_property
    def spreading(self) -> Spreading:
        """Constants of the spreading of contamination on its grid."""
        return spreading_of(self.curve, self.task, self.sensing_radius, self.rogue_speed)

    @cached_property
    def target_capacity(self) -> int:
        """Limit on the targets of an episode: those of the start, and arrivals up to six deviations above the mean."""
        mean = self.targets.arrival_rate * self.task.duration
        arrivals = math.ceil(mean + 6 * math.sqrt(mean))
        return self.targets.count + arrivals

    @property
    def action_size(self) -> int:
        """Number of components of a robot's action: those that move it, then those of its message."""
        return model_of(self.robot.kind).action_size + self.messages.size

    @property
    def action_names(self) -> tuple[str, ...]:
        """Names of the components of a robot's action, such as steering, throttle and message_0."""
        return (*model_of(self.robot.kind).actions, *(f"message_{m}" for m in range(self.messages.size)))

    def resolve(self) -> "Scenario":
        """Return the same scenario with every derived field filled in; it runs identically."""
        rate_max = self.robot.phase_rate_max
        if rate_max is None:
            rate_max = SPRINT * self.formation.phase_rate / self.alpha
        offset = self.robot.offset if self.robot.model_offset is None else self.robot.model_offset
        robot = dataclasses.replace(
            self.robot,
            count=self.num_robots,
            phase_rate_max=rate_max,
            model_offset=offset,
            throttle_max=self.robot.full_throttle,
            speed_max=self.robot.top_speed,
            speed_min=self.robot.lowest_speed,
            yaw_rate_max=self.robot.top_yaw_rate,
            acceleration_max=self.robot.top_acceleration,
            yaw_acceleration_max=self.robot.top_yaw_acceleration,
        )
        formation = dataclasses.replace(
            self.formation, coupling=self.coupling, p=self.p, alpha=self.alpha, ring=self.ring
        )
        sensing = dataclasses.replace(self.sensing, radius=self.sensing_radius)
        targets = dataclasses.replace(self.targets, speed_limit=self.rogue_speed)
        if targets.rogues is not None:
            targets = dataclasses.replace(targets, drifting=0.0, wandering=0.0, fleeing=0.0, custom=1.0)
        curve = dataclasses.replace(self.curve, inset=self.inset)
        return dataclasses.replace(
            self, curve=curve, robot=robot, formation=formation, sensing=sensing, targets=targets
        )

    def scaled(self, length: float = 1.0, time: float = 1.0) -> "Scenario":
        """Return the similar scenario with all lengths multiplied by `length` and all times by `time`.

        Speeds, rates, accelerations and reward weights are scaled too, so the task is the same in scaled units.
        Extensions do not change.

        Raises:
            ValueError: a factor is not a positive number, or a scaled field is out of its range.
        """
        for name, factor in (("length", length), ("time", time)):
            if not (isinstance(factor, (int, float)) and 0 < factor < math.inf):
                raise ValueError(f"{name} must be a positive number, got {factor!r}")
        return dataclasses.replace(self, **{name: getattr(self, name).scaled(length, time) for name in PARTS})

    def to_dict(self) -> dict:
        """Return nested plain values, as written beside results."""
        plain = {each.name: getattr(self, each.name) for each in dataclasses.fields(self)}
        plain |= {name: dataclasses.asdict(plain[name]) for name in PARTS}
        return plain | {"extensions": [each.to_dict() for each in self.extensions]}

    def digest(self) -> str:
        """Return a hash of the scenario without its name and description."""
        plain = self.to_dict()
        hashed = {name: plain[name] for name in (*PARTS, "extensions")}
        return hashlib.sha256(json.dumps(hashed, sort_keys=True).encode()).hexdigest()[:16]
