"""What the model predictive contouring controller is given besides the curve."""

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

from lissajous_env.fields import Checked, finite, non_negative, positive, whole, within
from lissajous_env.scenario import Robot


@dataclass(frozen=True)
class MpccParameters(Checked):
    """What problem (11)-(15) holds besides the curve, and when the solver stops."""

    stages: int = whole(15, at_least=1, at_most=200)
    """M, stages of the horizon."""
    step: float = positive(0.1, "s")
    """Length of a stage [s]."""
    weight_lateral: float = non_negative(0.01, "1/(m s)^2")
    """Weight on the squared lateral error [1/(m s)^2].

    Differs from the paper: it prints the lateral and the lag weight in the reverse order, with which cars leave the
    curve: on the experiment they touch 22 times a minute instead of once.
    """
    weight_lag: float = non_negative(0.025, "1/(m s)^2")
    """Weight on the squared lag error [1/(m s)^2]."""
    weight_steering: float = positive(0.01, "1/s^2")
    """q_4, weight on the squared steering angle [1/s^2]."""
    weight_throttle: float = positive(0.01, "1/s^2")
    """q_3, weight on the squared throttle [1/s^2]."""
    drag: float = positive(0.945, "1/s")
    """c, damping of the speed [1/s]."""
    drive: float = positive(36.81, "m/s^2")
    """alpha of the motor, acceleration per throttle [m/s^2]."""
    offset: float = non_negative(3.804, "m/s^2")
    """beta of the model, a linear fit around 1 m/s; the plant's is 3.681 with a dead zone [m/s^2]."""
    wheelbase: float = positive(0.175, "m")
    """l, distance between the axles [m]."""
    steering_max: float = within(math.pi / 9, 0, math.pi / 2, "rad")
    """Largest steering angle to either side [rad]."""
    throttle_min: float = finite(0.1)
    """Smallest throttle."""
    throttle_max: float = finite(0.25)
    """Largest throttle."""
    max_iterations: int = whole(100, at_least=1, at_most=10_000)
    """Iterations after which a start is given up."""
    tolerance: float = positive(1e-4)
    """A start has converged when an iteration lowers its cost by less than this fraction."""
    poor: float = non_negative(0.05)
    """A cost above this fraction of (M + 1) phase_rate^2, the cost of standing still, is tried from another start too.

    Only there has the problem several optima: before the tight turns, which a car can pass early or late.
    """

    def _check_together(self) -> None:
        self._require(self.throttle_max > self.throttle_min, "throttle_max", "must be above throttle_min")

    @classmethod
    def of(cls, robot: Robot, **overrides: Any) -> "MpccParameters":
        """Take the car's constants from a robot, with the model's offset as its designer measured it."""
        shared = ("wheelbase", "steering_max", "throttle_min", "throttle_max", "drag", "drive")
        offset = robot.offset if robot.model_offset is None else robot.model_offset
        return cls(**{**{name: getattr(robot, name) for name in shared}, "offset": offset, **overrides})

    def replace(self, **overrides: Any) -> "MpccParameters":
        """Copy with some fields changed."""
        return dataclasses.replace(self, **overrides)
