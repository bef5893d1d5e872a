"""The rules by which a robot outside the simulator stops."""

from dataclasses import dataclass

from lissajous_env.parameters.robot_models import model_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, number
from lissajous_env.theory.geometry import turning_radius

_FOREVER = 1e9


def _limit(unit: str) -> float:
    return number(0.0, 1e-3, _FOREVER, unit, or_zero=True, or_infinite=True)


@dataclass(frozen=True)
class Limits(Checked):
    """Limits beyond which a robot stops; infinite for no limit, and 0 for the one of its scenario.

    After a jump of the clock, or outside the fence, a robot stays stopped until `Onboard.resume`.
    """

    pose_age: float = _limit("s")
    """Age of the pose [s]; 0 means 2.5 control steps."""
    fence: float = _limit("m")
    """Distance of the robot's centre beyond the rectangle [m]; 0 means the diameter of its turning circle, which a car
    needs to come back, or one like the robot."""
    clock_jump: float = _limit("s")
    """Deviation of the time between two calls from a control step, and how far ahead of the own clock a time stamp may
    be [s]; 0 means 2.5 control steps. A clock that stops or goes back counts as a jump."""
    silence: float = _limit("s")
    """Age of the last message of a ring neighbour [s], for policies that use messages; 0 means the age from which
    policies ignore a message, `Scenario.time_unit`. From the first call on, a neighbour that was not heard yet counts
    as silent for the time since then."""
    watchdog: float = number(0.0, 1e-3, _FOREVER, "s", or_zero=True)
    """Time for which a command is valid [s]; 0 means 2.5 control steps."""

    def of(self, scenario: Scenario) -> "Limits":
        """Return the limits of a scenario, in which none is 0."""
        some, robot, as_car = 2.5 * scenario.task.step, scenario.robot, model_of(scenario.robot.kind).as_car
        radius = turning_radius(robot.wheelbase, robot.steering_max) if as_car is None else as_car.turning_radius(robot)
        derived = {
            "pose_age": some, "fence": 2 * radius, "clock_jump": some, "silence": scenario.time_unit, "watchdog": some,
        }  # fmt: skip
        return Limits(**{name: getattr(self, name) or value for name, value in derived.items()})

    @classmethod
    def none(cls) -> "Limits":
        """Return limits that stop a robot only for numbers that are not finite, and a clock that goes back."""
        return cls(pose_age=float("inf"), fence=float("inf"), clock_jump=float("inf"), silence=float("inf"))
