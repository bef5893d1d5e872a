"""The scenario: all constants of an episode, as frozen dataclasses that are checked once, at construction.

Units are SI, angles radians. Fields that are None by default are derived from others; `Scenario.resolve` fills them in.
"""

import dataclasses
import hashlib
import json
import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from lissajous_env.parameters.extensions import Extension, as_extensions
from lissajous_env.parameters.robot_models import RobotModel, driven_by_velocity, model_of
from lissajous_env.parameters.rogues import BringsRogues
from lissajous_env.parameters.scenario_rules import check_together
from lissajous_env.parameters.spreading import Spreading, spreading_of
from lissajous_env.settings.checks import is_number
from lissajous_env.settings.parts import POINT_RATE_FACTOR, Curve, Faults, Formation, Noise, Robot
from lissajous_env.settings.task import Messages, Sensing, Targets, Task, without_custom_motion
from lissajous_env.theory import closed_forms, geometry
from lissajous_env.wording import require

PARTS = {
    part.__name__.lower(): part for part in (Curve, Formation, Robot, Sensing, Targets, Faults, Noise, Messages, Task)
}


def read_only(array: np.ndarray) -> np.ndarray:
    """Return a view of an array through which nothing can be written."""
    view = array.view()
    view.flags.writeable = False
    return view


@dataclass(frozen=True)
class Scenario(BringsRogues):
    """All constants of an episode, in parts. Each part checks its own fields, `scenario_rules` those across parts."""

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
            require(isinstance(getattr(self, name), part), name, f"must be a {part.__name__}", getattr(self, name))
        for name in ("name", "description"):
            require(isinstance(getattr(self, name), str), name, "must be text", getattr(self, name))
        object.__setattr__(self, "extensions", as_extensions(self.extensions))
        check_together(self)

    def __deepcopy__(self, memo: dict) -> "Scenario":
        return self

    def without_extensions(self) -> "Scenario":
        """Return the scenario without its extensions; targets of their laws then appear anywhere, and do not move."""
        targets = dataclasses.replace(self.targets, **without_custom_motion(vars(self.targets)))
        return dataclasses.replace(self, targets=targets, extensions=())

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
        return self.time_unit**-1 if self.formation.coupling is None else self.formation.coupling

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
        """(N, 2) previous and next robot of each one on the ring; -1 for none, and two robots have no next one."""
        ring = np.array(self.ring)
        table = np.full((len(ring), 2), -1, dtype=np.int32)
        if len(ring) > 1:
            table[ring, 0] = np.roll(ring, 1)
        if len(ring) > 2:
            table[ring, 1] = np.roll(ring, -1)
        return read_only(table)

    @cached_property
    def equilibrium(self) -> np.ndarray:
        """(N,) phases of the equilibrium (2) with theta_0 = 0 [rad]."""
        return read_only(closed_forms.equilibrium_phases(self.num_robots, self.p, self.ring))

    @cached_property
    def displacements(self) -> np.ndarray:
        """(N,) angle by which each robot is displaced along the phase at a reset, from `formation.displaced` [rad]."""
        angles = np.zeros(self.num_robots)
        for robot, angle in self.formation.displaced:
            angles[robot] += angle
        return read_only(angles)

    @cached_property
    def speed_unit(self) -> float:
        """Unit of the speeds in the observation [m/s]."""
        return model_of(self.robot.kind).speed_unit(self.driven, self.formation, self.robot)

    @cached_property
    def places(self) -> tuple[int, ...]:
        """Place of each robot; robots of the same place overlap by design, so their collisions are not counted.

        Points on the curve share each place of the equilibrium with kappa - 1 others (Lemma 1). All other robots have a
        place of their own: two cars in one place do collide.
        """
        places = self.num_robots // self.clusters if model_of(self.robot.kind).keeps_to_curve else self.num_robots
        return tuple(self.ring.index(robot) % places for robot in range(self.num_robots))

    @cached_property
    def drive_factors(self) -> np.ndarray:
        """(N,) factor on `robot.drive` of each robot, from `robot.drive_factors`."""
        factors = self.robot.factors
        return read_only(np.array([factors.get(robot, 1.0) for robot in range(self.num_robots)]))

    @cached_property
    def top_speeds(self) -> np.ndarray:
        """(N,) top speed of each robot [m/s]; infinite for points and registered models."""
        if self.robot.kind not in ("car", "differential"):
            return np.full(self.num_robots, np.inf)
        return np.array([self.robot.steady_speed(self.robot.drive * factor) for factor in self.drive_factors])

    @property
    def top_speed_bound(self) -> float:
        """Largest top speed of a car or drive that the factors and the spread of drives permit [m/s]."""
        return self.robot.steady_speed(self.robot.drive * self.noise.drive_range[1] * float(self.drive_factors.max()))

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
        step = self.task.step * min(model.speed_unit(self.curve, self.formation, self.robot), self._fastest)
        return min(step**2 / (2 * self.turning_radius), step)

    @cached_property
    def _fastest(self) -> float:
        """Largest speed of the formation [m/s]."""
        return self.formation.phase_rate * geometry.largest_speed(self.curve)

    @cached_property
    def turning_radius(self) -> float:
        """Radius of the tightest turn of the robots, or of the cars that they move like [m].

        Of robots with `AsCar.has_yaw_limit` it is the one at twice the largest speed of the formation, but at their top
        speed at most, and at half of that at least.
        """
        model = model_of(self.robot.kind)
        if model.as_car is None:
            return geometry.turning_radius(self.robot.wheelbase, self.robot.steering_max)
        radius = model.as_car.turning_radius(self.robot)
        if not model.as_car.has_yaw_limit:
            return radius
        share = 2 * self._fastest / model.speed_unit(self.curve, self.formation, self.robot)
        return radius * min(max(share, 0.5), 1.0)

    @cached_property
    def start_turning(self) -> float:
        """Radius of the turn for which every car or drive has room at the start [m]; 0 without walls.

        It is a tenth above that of the tightest turn of a car of the longest wheelbase; robots turn away from a wall
        where they lack this room (`lissajous_env.world.robots.placing.turn_from_walls`).
        """
        if self.task.boundary != "wall" or self.robot.kind not in ("car", "differential"):
            return 0.0
        return 1.1 * self.noise.wheelbase_range[1] * self.turning_radius

    @cached_property
    def _unrounded(self) -> Curve:
        """The Lissajous curve of the rectangle without the inset; (6) to (8) apply to it, not to a rounded one."""
        curve = closed_forms.unrounded(self.curve)
        return dataclasses.replace(curve, inset=self.inset).driven if self.inset else curve

    @cached_property
    def _rounded(self) -> Curve:
        """The curve with its inset, rounded where walls leave cars no way round its bends.

        These are bends of less than half of `start_turning`. Of some curves there is no rounded form, and cars whose
        actions are velocities do not follow it.
        """
        curve = dataclasses.replace(self.curve, inset=self.inset)
        if self.start_turning == 0 or curve.harmonics or not self.has_formation:
            return curve
        is_tight = 2 * geometry.along_lap(self._unrounded)[1].min() < self.start_turning
        return closed_forms.rounded(curve) if is_tight else curve

    @cached_property
    def driven(self) -> Curve:
        """The curve that is driven: in the rectangle without the inset, and rounded where cars need it within walls."""
        return self._rounded.driven

    @cached_property
    def robot_radius_bound(self) -> float:
        """r_max of (6) [m], for the Lissajous curve, also where it is rounded."""
        return closed_forms.robot_radius_bound(self._unrounded, self.num_robots)

    @cached_property
    def coverage_radius(self) -> float:
        """Sensing radius of (7) [m], with sqrt(2) `inset` added.

        No point of the rectangle is farther than that from the rectangle of the curve that is driven.
        """
        return closed_forms.coverage_radius(self._unrounded) + math.sqrt(2) * self.inset

    @cached_property
    def neighbour_distance(self) -> float:
        """Largest distance of ring neighbours in the undisturbed formation, twice (8) of the driven curve [m]."""
        return 2 * closed_forms.detection_radius(self.driven, self.num_robots, self.clusters)

    @cached_property
    def detection_radius(self) -> float:
        """Sensing radius of (8) [m], with sqrt(2) `inset` added as for `coverage_radius`."""
        reach = closed_forms.detection_radius(self._unrounded, self.num_robots, self.clusters)
        return reach + math.sqrt(2) * self.inset

    @property
    def sensing_radius(self) -> float:
        """r_s [m]: `sensing.radius`, or the smallest that satisfies (8) by default."""
        return self.detection_radius if self.sensing.radius is None else self.sensing.radius

    @property
    def sight(self) -> float:
        """Radius within which targets and robots are observed [m]: `sensing.sight`, or r_s by default."""
        return self.sensing_radius if self.sensing.sight is None else self.sensing.sight

    @cached_property
    def detection_time_bound(self) -> float:
        """Detection-time bound T_max [s]; it holds only where `detection_time_is_bounded`."""
        return closed_forms.detection_time_bound(self.formation.phase_rate, self.num_robots, self.clusters)

    @property
    def detection_time_is_bounded(self) -> bool:
        """True if T_max bounds the detection time in the undisturbed formation: its equilibrium (2) must be stable."""
        is_stable = self.p in closed_forms.stable_equilibria(self.num_robots)
        return is_stable and self.has_places and self.senses_neighbours

    @property
    def has_places(self) -> bool:
        """True if the robots have the a + b places of a Lissajous curve, for which the paper derives its bounds."""
        return not self.driven.harmonics and self.num_robots == self.clusters * (self.curve.a + self.curve.b)

    @property
    def senses_neighbours(self) -> bool:
        """True if the sensing radius satisfies (8), so that the discs of neighbours on the ellipse (5) overlap."""
        return self.sensing_radius >= self.detection_radius * (1 - 1e-9)

    @property
    def detection_time_label(self) -> str:
        """Label of `detection_time_bound` in tables and pictures: "T_max", or "T_max (no bound)"."""
        return "T_max" if self.detection_time_is_bounded else "T_max (no bound)"

    @property
    def rogue_speed(self) -> float:
        """Speed limit of evading targets [m/s]: `targets.speed_limit`, or by default that of the fastest target."""
        return self.targets.speed_max if self.targets.speed_limit is None else self.targets.speed_limit

    @cached_property
    def spreading(self) -> Spreading:
        """Constants of the spreading of contamination on its grid."""
        return spreading_of(self.curve, self.task, self.sensing_radius, self.rogue_speed)

    @cached_property
    def target_capacity(self) -> int:
        """Limit on the targets of an episode: those of the start, and arrivals up to six deviations above the mean."""
        mean = self.targets.arrival_rate * self.task.duration
        return self.targets.count + math.ceil(mean + 6 * math.sqrt(mean))

    @property
    def delay_steps(self) -> int:
        """Delay of a message [control step]."""
        return round(self.noise.message_delay / self.task.step)

    @property
    def model(self) -> RobotModel:
        """Model of the robots, with the actions of the task."""
        model = model_of(self.robot.kind)
        return model if self.has_formation else driven_by_velocity(model)

    @property
    def actuation(self) -> str:
        """Kind of the robots that policies drive, or `velocity` where an action is a velocity of a car."""
        return self.robot.kind if self.has_formation else "velocity"

    @property
    def has_formation(self) -> bool:
        """True if actions are those of robots on a curve; where they are velocities, no policy follows the curve."""
        return self.task.action != "velocity"

    @property
    def action_size(self) -> int:
        """Number of components of a robot's action: those that move it, then those of its message."""
        return len(self.action_names)

    @property
    def action_names(self) -> tuple[str, ...]:
        """Names of the components of a robot's action, such as steering, throttle and message_0."""
        return (*self.model.actions, *(f"message_{m}" for m in range(self.messages.size)))

    def resolve(self) -> "Scenario":
        """Return the same scenario, all derived fields but `sensing.sight` and `targets.speed_min` filled in."""
        robot, rate = self.robot, POINT_RATE_FACTOR * self.formation.phase_rate / self.alpha
        shares = {"drifting": 0.0, "wandering": 0.0, "fleeing": 0.0, "custom": 1.0} if self.targets.rogues else {}
        filled: dict[str, dict[str, Any]] = {
            "curve": {"inset": self.inset, "harmonics": self._rounded.harmonics},
            "robot": {
                "count": self.num_robots,
                "phase_rate_max": rate if robot.phase_rate_max is None else robot.phase_rate_max,
                "model_offset": robot.offset if robot.model_offset is None else robot.model_offset,
                "throttle_max": robot.full_throttle,
                "speed_max": robot.top_speed,
                "speed_min": robot.lowest_speed,
                "yaw_rate_max": robot.top_yaw_rate,
                "acceleration_max": robot.top_acceleration,
                "yaw_acceleration_max": robot.top_yaw_acceleration,
            },
            "formation": {"coupling": self.coupling, "p": self.p, "alpha": self.alpha, "ring": self.ring},
            "sensing": {"radius": self.sensing_radius},
            "targets": {"speed_limit": self.rogue_speed} | shares,
        }
        parts = {name: dataclasses.replace(getattr(self, name), **fields) for name, fields in filled.items()}
        return dataclasses.replace(self, **parts)

    def scaled(self, length: float = 1.0, time: float = 1.0) -> "Scenario":
        """Return the similar scenario with all lengths multiplied by `length` and all times by `time`.

        Speeds, rates, accelerations and reward weights are scaled too, so the task is the same in scaled units.
        Extensions do not change.

        Raises:
            ValueError: a factor is not a positive number, or a scaled field is out of its range.
        """
        for name, factor in (("length", length), ("time", time)):
            require(is_number(factor) and factor > 0, name, "must be a positive number", factor)
        parts = {name: getattr(self, name).scaled(float(length), float(time)) for name in PARTS}
        return dataclasses.replace(self, **parts)

    def to_dict(self) -> dict:
        """Return nested plain values, as written beside results."""
        plain = {entry.name: getattr(self, entry.name) for entry in dataclasses.fields(self)}
        plain |= {name: dataclasses.asdict(plain[name]) for name in PARTS}
        return plain | {"extensions": [extension.to_dict() for extension in self.extensions]}

    def digest(self) -> str:
        """Return a hash of the scenario without its name and description."""
        plain = self.to_dict()
        hashed = {name: plain[name] for name in (*PARTS, "extensions")}
        return hashlib.sha256(json.dumps(hashed, sort_keys=True).encode()).hexdigest()[:16]
