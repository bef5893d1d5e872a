"""The request of a user, and the scenario on which its plans are compared."""

import dataclasses
import math
import os
import re
import warnings
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

from baselines.planning.plans import robots_top_speed
from baselines.planning.rehearse import Episodes
from baselines.policies.as_cars import like_cars
from baselines.similarity import motion_scale
from lissajous_env.episodes.evaluation import refuse_rogue_agents
from lissajous_env.episodes.guarantee import cells
from lissajous_env.parameters import named
from lissajous_env.parameters.assumptions import AssumptionWarning
from lissajous_env.parameters.robot_models import tightest_radius
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, choice, flag, is_whole, number, whole
from lissajous_env.settings.parts import Curve, Faults, Robot
from lissajous_env.settings.task import Targets, Task
from lissajous_env.theory.design import best_design
from lissajous_env.theory.geometry import curve_length, largest_speed
from lissajous_env.wording import few_of, outside, require

_SWEEPS, _FEWEST_SWEEPS = 12, 8
"""Duration of an episode of a rectangle, in the time in which an ideal team would sweep it once, and the least one."""
_MOST_STEPS, _FEWEST_STEPS = 4000, 200
"""Most control steps of such an episode, unless the fewest sweeps have more, and fewest ones."""
_TARGETS = 200
"""Targets that arrive in such an episode."""
_START = 0.5
"""Standard deviation of the robots' places along the curve at the start, in body radii."""
_REACH_STEP = 0.25
"""Largest part of a sensor's radius that a robot moves in a control step."""
_CLEARANCE = 0.1
"""Default of the least distance of two bodies, over the diameter of one."""
_GRID = 36
"""Cells of the coverage grid along the longer side of the rectangle."""
_RANGE = 0.01, 1e4
"""Range of lengths [m] and speeds [m/s]."""
_LONGEST = 1e6
"""Longest time [s]."""
PLANS = 200
"""Default number of plans that are tried: about a minute on two cores for five cars in a hall of 40 m x 25 m."""
_NEEDED = {"width": " [m]", "height": " [m]", "robots": "", "robot_radius": " [m]", "sensor_radius": " [m]",
           "speed": " [m/s]"}  # fmt: skip
"""Units of what must be given if no scenario is named."""


@dataclass(frozen=True)
class Request(Checked, part=""):
    """Subject and extent of a search for plans: a scenario, a rectangle and robots, or a scenario with changes.

    Raises:
        ValueError: a value is invalid or missing.
    """

    scenario: str | os.PathLike[str] | Scenario | None = None
    """Name of a scenario, .toml file, or module:attribute from which missing options are taken; without it, the
    rectangle and the robots must be given."""
    width: float | None = number(None, *_RANGE, "m")
    """Width of the rectangle [m]."""
    height: float | None = number(None, *_RANGE, "m")
    """Height of the rectangle [m]."""
    open: bool = flag(False)
    """Plan for open ground: bodies may leave the rectangle, and the table has the space outside that a plan needs.
    Without it, a rectangle that is given by its width and height has walls."""
    robots: int | str | None = None
    """Number of robots, or a range such as 3:8."""
    robot_radius: float | None = number(None, *_RANGE, "m")
    """Radius of a robot's body [m]."""
    sensor_radius: float | None = number(None, *_RANGE, "m")
    """Radius of a robot's sensing disc [m]."""
    speed: float | None = number(None, *_RANGE, "m/s")
    """Top speed of the robots [m/s]."""
    turning_radius: float | None = number(None, *_RANGE, "m")
    """Radius of a car's tightest circle [m]; without it and a kind of robots, robots are points that stay on the curve,
    and all plans are formations."""
    robot: Literal["curve", "car", "differential"] | None = choice(None, "curve", "car", "differential")
    """Kind of the robots: points on the curve, cars, or differential drives, which turn on the spot."""
    acceleration: float | None = number(None, *_RANGE, "m/s^2")
    """Largest acceleration of differential drives [m/s^2]."""
    rogue_speed: float | None = number(None, 0, 100, "m/s")
    """Top speed of evading targets that know the robots' future [m/s]; 0 by default."""
    entry: Literal["inside", "boundary", "unseen"] | None = choice(None, "inside", "boundary", "unseen")
    """Place where targets appear: anywhere in the rectangle, on its boundary, or outside all sensing discs."""
    failures: int = 0
    """Number of robots that fail for good, besides those that the scenario removes at random (`faults.lost`): each
    combination of as many in all is removed once, after a quarter of an episode; of more than 64 combinations, 64 are
    drawn at random."""
    guarantee: float | None = number(None, 1e-3, _LONGEST, "s")
    """Time within which every target must be detected [s]; if robots is a range, the search ends at the smallest number
    that achieves it."""
    clearance: float | None = number(None, 0, _RANGE[1], "m")
    """Least distance of two bodies [m]; plans whose bodies come closer are marked and come after the others. It is a
    tenth of a body's diameter by default."""
    plans: int | None = whole(None, 1, 10**9)
    """Number of plans that are tried for each number of robots, 200 by default; a fifth as many of the best ones are
    then simulated to the end. The result does not depend on the speed of the machine."""
    seconds: float | None = number(None, 1, _LONGEST, "s")
    """Duration of the search [s], in place of a number of plans."""
    fixed_start: bool = flag(False)
    """Include only plans whose robots begin where the scenario places them."""
    seed: int = whole(0, 0, 2**31 - 1000)
    """Seed of the simulated episodes and of the search."""

    def _check_together(self) -> None:
        missing = [f"{name}{unit}" for name, unit in _NEEDED.items() if getattr(self, name) is None]
        if self.scenario is None and missing:
            raise ValueError(f"{', '.join(missing)} must be given if no scenario is named")
        if self.base is not None:
            rule = "must be control for a plan: all patrols drive robots by their own controls"
            require(self.base.has_formation, f"task.action of {self.base.name}", rule, self.base.task.action)
            refuse_rogue_agents(self.base)
        self._check_kind()
        self._require(self.plans is None or self.seconds is None, "plans", "must be omitted if seconds is given")
        faults = Faults() if self.base is None else self._with_changes(self.base, self.team_sizes[0]).faults
        most = max(self.team_sizes[0] - 1 - faults.lost - len({robot for robot, _ in faults.removed}), 0)
        fits = is_whole(self.failures) and 0 <= self.failures <= most
        self._require(fits, "failures", f"must be a whole number from 0 to {most}, so that a robot remains")

    def _check_kind(self) -> None:
        """Check that the options of a kind of robots come with that kind."""
        kind = self.robot or (self.base.robot.kind if self.base is not None else "curve")
        kind = "car" if self.robot is None and self.turning_radius is not None else kind
        for name, of in (("turning_radius", "car"), ("acceleration", "differential")):
            value = getattr(self, name)
            if value is not None and kind != of:
                raise ValueError(f"{name} must be omitted unless robots are of kind {of}, got {value:g} with {kind}")
        is_given = self.robot != "car" or self.base is not None or self.turning_radius is not None
        self._require(is_given, "turning_radius", "must be given for robots of kind car [m]")

    @cached_property
    def base(self) -> Scenario | None:
        """Return the scenario from which missing values are taken."""
        base = None if self.scenario is None else named.build(self.scenario)
        if base is not None and base.extensions:
            names = few_of([extension.name for extension in base.extensions])
            words = f"scenario {base.name}: plans are made without its extensions {names}"
            laws = "targets whose law is one of them appear anywhere and do not move"
            warnings.warn(f"{words}; {laws}", AssumptionWarning, stacklevel=outside())
        return base

    @property
    def episodes(self) -> Episodes:
        """Return the episodes of every plan."""
        return Episodes(self.seed, self.failures, clearance=self.required_clearance)

    @property
    def required_clearance(self) -> float:
        """Return the least distance of two bodies [m]."""
        radius = self.robot_radius or (0.0 if self.base is None else self.base.robot.radius)
        return _CLEARANCE * 2 * radius if self.clearance is None else self.clearance

    @cached_property
    def team_sizes(self) -> range:
        """Return the numbers of robots that plans are made for."""
        if self.robots is None:
            assert self.base is not None
            return range(self.base.num_robots, self.base.num_robots + 1)
        ends = re.fullmatch(r"(\d{1,4})(?::(\d{1,4}))?", str(self.robots))
        few, many = (int(ends[1]), int(ends[2] or ends[1])) if ends else (0, 0)
        self._require(2 <= few <= many <= 64, "robots", "must be a number or a range such as 3:8, from 2 to 64")
        return range(few, many + 1)

    def scenario_of(self, num_robots: int) -> Scenario:
        """Return the scenario on which plans for a number of robots are compared.

        Raises:
            ValueError: a value that a field of the scenario forbids.
        """
        changed: dict[str, Any] = {}
        if self.base is None:
            scenario = self._rectangle(num_robots)
            changed = _times(scenario)
            if not self.open:
                # The inset depends on the control step and on the speed along the curve, which the design determines.
                walls: dict[str, Any] = {"task.boundary": "wall"}
                scenario = self._rectangle(num_robots, named.build(scenario, **changed, **walls).inset)
                changed = _times(scenario) | walls | {"curve.inset": None}
        else:
            scenario = self._with_changes(self.base, num_robots)
        if scenario.task.contamination is None:
            changed["task.contamination"] = cells(scenario)
        if scenario.task.grid is None:  # a scenario's file cannot contain it
            changed["task.grid"] = cells(scenario, _GRID, 0.0)
        return named.build(scenario.without_extensions(), **changed)

    def _rectangle(self, num_robots: int, inset: float | None = None) -> Scenario:
        """Return the scenario of a rectangle and robots, which begin in the best design of the paper's formation.

        Args:
            num_robots: Number of robots.
            inset: Width of the strip along the edge in which nothing is driven [m].
        """
        # The wheelbase determines the time scale of points, which have none: it is in scale with their bodies.
        wheelbase, speed = Robot().wheelbase / Robot().radius * (self.robot_radius or 0.0), self.rogue_speed or 0.0
        points = Robot(kind="curve", wheelbase=wheelbase)
        robot = _robot(points, self)
        # The step follows from the motion later; until then it must be short enough for drives that turn fast.
        step = min(Task().step, 1 / robot.top_yaw_rate if robot.kind == "differential" else math.inf)
        given = Scenario(
            name="plan",
            curve=Curve((self.width or 0.0) / 2, (self.height or 0.0) / 2, inset=inset),
            robot=points,
            targets=Targets(count=0, arrival_rate=1.0, wandering=1.0 if speed else 0.0, speed=speed, speed_limit=speed),
            task=Task(duration=10.0, step=step),
        )
        scenario = self._with_changes(given, num_robots)
        # Mean distance along the curve for a radian of the robots' phase [m/rad].
        unit = scenario.alpha * curve_length(scenario.driven) / (2 * math.pi)
        return named.build(scenario, **{"formation.start_noise": _START * robot.radius / unit})

    def _with_changes(self, scenario: Scenario, num_robots: int) -> Scenario:
        """Return a scenario with the changes of the request."""
        robot, curve = _robot(scenario.robot, self), scenario.curve
        given = {"robot": robot, "sensing.radius": self.sensor_radius, "targets.entry": self.entry}
        given |= {"task.boundary": "open" if self.open else None}
        changed: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
        if (limit := self.rogue_speed) is not None and limit != scenario.rogue_speed:
            # A target that moves faster than the limit of the rogues would be one of them.
            speeds = {name: getattr(scenario.targets, name) for name in ("speed", "speed_min", "flee_speed")}
            changed |= {f"targets.{name}": min(value, limit) for name, value in speeds.items() if value is not None}
            changed["targets.speed_limit"] = limit
        halves = (self.width or 2 * curve.half_width) / 2, (self.height or 2 * curve.half_height) / 2
        before = curve.half_width, curve.half_height, scenario.num_robots
        if self.base is None or (*halves, num_robots) != before:
            speed = robot.top_speed if robot.kind != "curve" else self.speed or robots_top_speed(scenario)
            sensor, inset = self.sensor_radius or scenario.sensing_radius, 0.0 if self.open else scenario.inset
            changed |= {"curve.half_width": halves[0], "curve.half_height": halves[1], "sensing.radius": sensor}
            changed |= {"faults.schedule": (), "faults.removed": (), "task.contamination": None, "task.grid": None}
            if num_robots > 1:  # no curve has a + b = 1: one robot drives the given one
                best = best_design(*halves, num_robots, robot, sensor, speed, tightest_radius(robot), inset)
                changed |= best.overrides | {"robot.count": None}
        scenario = named.build(scenario, **changed)
        if self.speed is None or scenario.robot.kind != "curve":
            return scenario
        # At this phase rate, a point has the given speed where the curve is fastest.
        rate = self.speed / (scenario.alpha * largest_speed(scenario.driven))
        return named.build(scenario, **{"robot.phase_rate_max": rate})


def _robot(robot: Robot, request: Request) -> Robot:
    """Return a robot with the changes of the request; the speed of points follows from their curve later."""
    given = {"radius": request.robot_radius, "kind": request.robot, "acceleration_max": request.acceleration}
    changed: dict[str, Any] = {name: value for name, value in given.items() if value is not None}
    if request.turning_radius is not None:
        changed |= {"kind": "car", "wheelbase": request.turning_radius * math.tan(robot.steering_max)}
    if request.speed is not None and changed.get("kind", robot.kind) != "curve":
        changed |= {"speed_max": request.speed, "throttle_max": None, "phase_rate_max": None}
    return dataclasses.replace(robot, **changed)


def _times(scenario: Scenario) -> dict[str, Any]:
    """Return control step, duration and arrival rate of targets for a rectangle's scenario, in scale with its motion.

    The step is that of the paper's experiment in the time scale of the robots' motion. An episode lasts as long as
    some sweeps of the rectangle by a team that never covers a place twice.
    """
    width, height, robots = 2 * scenario.curve.half_width, 2 * scenario.curve.half_height, scenario.num_robots
    radius, speed, like = scenario.sensing_radius, robots_top_speed(scenario), like_cars(scenario) or scenario
    limits = [0.1 * motion_scale(like).time, _REACH_STEP * radius / speed]
    step = float(f"{min(limits + ([1 / like.robot.drag] if like.robot.kind == 'car' else [])):.3g}")
    sweep = (width * height / (2 * radius) + width + height) / (robots * speed)
    usual, least = (math.ceil(sweeps * sweep / step) for sweeps in (_SWEEPS, _FEWEST_SWEEPS))
    steps = min(max(usual, _FEWEST_STEPS), max(least, _MOST_STEPS))
    duration = float(f"{steps * step:.9g}")
    return {
        "task.step": step,
        "task.duration": duration,
        "targets.arrival_rate": float(f"{_TARGETS / duration:.6g}"),
    }
