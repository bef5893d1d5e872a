"""Parameters of the model predictive contouring controller, besides the curve."""

import math
from dataclasses import dataclass
from typing import Any

from baselines.similarity import EXPERIMENT, motion_scale
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, number, whole


@dataclass(frozen=True)
class MpccParameters(Checked):
    """Parameters of problem (11)-(15) besides the curve, and of the solver.

    The weights are those of the paper's experiment; `MpccParameters.of` scales them to another scenario.
    """

    stages: int = whole(15, 1, 200)
    """M, stages of the horizon."""
    step: float = number(0.1, 1e-4, 100, "s")
    """Length of a stage [s]. The paper does not print it, but it matters: see `lissajous reproduce printed`."""
    weight_lateral: float = number(0.01, 0, 1e6, "1/(m s)^2")
    """Weight on the squared lateral error [1/(m s)^2].

    Differs from the paper: it prints the lateral and the lag weight in the reverse order, with which cars come far
    nearer to one another than it reports: `lissajous reproduce printed`.
    """
    weight_lag: float = number(0.025, 0, 1e6, "1/(m s)^2")
    """Weight on the squared lag error [1/(m s)^2]."""
    weight_steering: float = number(0.01, 1e-20, 1e6, "1/s^2")
    """q_3, weight on the squared steering angle [1/s^2]."""
    weight_throttle: float = number(0.01, 1e-20, 1e6, "1/s^2")
    """q_4, weight on the squared throttle [1/s^2]."""
    drag: float = number(0.945, 1e-3, 1e3, "1/s")
    """c, damping of the speed [1/s]; printed as 0.94."""
    drive: float = number(36.81, 1e-6, 1e6, "m/s^2")
    """alpha of the motor, acceleration per throttle [m/s^2]; printed as 36.8."""
    offset: float = number(3.804, 0, 1e6, "m/s^2")
    """beta of the model, a linear fit around 1 m/s; the plant's is 3.681 with a dead zone [m/s^2]."""
    wheelbase: float = number(0.175, 1e-6, 1e3, "m")
    """l, distance between the axles [m]."""
    steering_max: float = number(math.pi / 9, 1e-3, 1.57, "rad")
    """Largest steering angle to either side [rad]."""
    throttle_min: float = number(0.1, -1e3, 1e3)
    """Smallest throttle."""
    throttle_max: float = number(0.25, -1e3, 1e3)
    """Largest throttle."""
    max_iterations: int = whole(100, 1, 10_000)
    """Largest number of iterations from one start."""
    tolerance: float = number(1e-4, 1e-12, 1)
    """Relative decrease of the cost in an iteration below which a start has converged."""
    poor: float = number(0.05, 0, 1e6)
    """Fraction of (M + 1) phase_rate^2, the cost of standing still, above which another start is tried too.

    Only such problems have several optima: those before tight turns, where a car can slow down early or late.
    """
    shift: float = number(1.0, 0, 1)
    """Share of a stage that passes between two solves, by which the last solution is shifted as a new start."""

    def _check_together(self) -> None:
        self._require(self.throttle_max > self.throttle_min, "throttle_max", "must be above throttle_min")

    @classmethod
    def of(cls, scenario: Scenario, **overrides: Any) -> "MpccParameters":
        """Return the parameters for the cars of a scenario, scaled from those of the paper's experiment.

        The error of the phase rate is relative to omega, the position errors are relative to the scale of the motion,
        and the inputs are relative to their largest values. A stage lasts as long as a control step, or longer where
        slow cars need more time for a turn. The car's constants are those of the scenario, with the offset of the model
        as its designer measured it.
        """
        robot, tuned = scenario.robot, EXPERIMENT.robot
        rate, scale = scenario.formation.phase_rate / EXPERIMENT.formation.phase_rate, motion_scale(scenario)
        steering = tuned.steering_max / robot.steering_max
        throttle = tuned.full_throttle / robot.full_throttle
        step = max(min(cls.step * scale.time, 1 / robot.drag), scenario.task.step)
        found = {
            "step": step,
            "shift": scenario.task.step / step,
            "weight_lateral": cls.weight_lateral * (rate / scale.length) ** 2,
            "weight_lag": cls.weight_lag * (rate / scale.length) ** 2,
            "weight_steering": cls.weight_steering * (rate * steering) ** 2,
            "weight_throttle": cls.weight_throttle * (rate * throttle) ** 2,
            "throttle_max": robot.full_throttle,
            "offset": robot.offset if robot.model_offset is None else robot.model_offset,
        }
        shared = ("wheelbase", "steering_max", "throttle_min", "drag", "drive")
        return cls(**{**{name: getattr(robot, name) for name in shared}, **found, **overrides})
