"""Settings of the nodes. Those of a robot are the parameters of its node, too."""

from dataclasses import dataclass
from itertools import chain
from typing import Literal

from baselines.onboard import Limits
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, choice, flag, number, rows, whole, within, word
from lissajous_env.wording import require

COMMANDS = {
    "car": {"car": {"command": "JointState"}, "dart": {"steering": "Float32", "throttle": "Float32"}},
    "differential": {"twist": {"cmd_vel": "Twist"}, "twist_stamped": {"cmd_vel": "TwistStamped"}},
}
"""For each `robot.kind` and kind of commands the topics that a robot's base listens to, with their messages' types."""
_FOREVER = 1e6

CommandKind = Literal["car", "twist", "twist_stamped", "dart"]


@dataclass(frozen=True)
class RobotSettings(Limits, part="node"):
    """Settings of a robot's node with the limits beyond which it stops: parameters of ROS 2 with the same names."""

    scenario: str = word("experiment", "must be the name of a scenario or a file")
    """Name of a scenario, .toml file, or module:attribute."""
    policy: str = word("kuramoto-mpcc", "must be the name of a policy or a folder")
    """Name of a policy, folder of a checkpoint, or module:factory."""
    robot: int = whole(0, 0, 1023)
    """Index of the robot, from 0."""
    command: CommandKind = choice("car", *chain(*COMMANDS.values()))  # noqa: RUF009
    """Kind of commands, of cars `car`: sensor_msgs/JointState with steering angle [rad] and throttle on `command`, or
    `dart`: std_msgs/Float32 on `steering` (angle divided by the largest) and `throttle`; of differential drives
    `twist`: geometry_msgs/Twist on `cmd_vel`, or `twist_stamped`: TwistStamped on `cmd_vel`."""
    pose: Literal["odometry", "pose"] = choice("odometry", "odometry", "pose")
    """Kind of poses: `odometry`: nav_msgs/Odometry on `odom`; `pose`: geometry_msgs/PoseStamped on `pose`, from which
    the speed is computed."""
    frame: str = word("map", "must be the name of a frame")
    """Frame of the poses; a pose in another frame stops the robot."""
    origin: tuple[float, float, float] = rows(
        (0.0, 0.0, 0.0), "must be x, y [m] and heading [rad]", within(-_FOREVER, _FOREVER), least=3, most=3
    )
    """x, y [m] and heading [rad] of the middle of the rectangle in this frame."""
    rate: float = number(20.0, 1.0, 1000.0, "1/s")
    """Rate at which the command is published [1/s]."""
    message_wait: float = number(0.02, 0.0, _FOREVER, "s")
    """Longest time for which a new pose waits for the messages of the neighbours of the same time, on the machine's
    clock [s]."""
    message_loss: float = number(0.0, 0.0, 1.0)
    """Fraction of the neighbours' messages that are ignored at random, to try a bad network."""
    autostart: bool = flag(False)
    """Drive from the first pose on, without a call of the service `start`."""


@dataclass(frozen=True)
class WorldSettings(Checked, part="node"):
    """Settings of the node that simulates the robots' hardware."""

    command: CommandKind = choice("car", *chain(*COMMANDS.values()))  # noqa: RUF009
    """Kind of the robots' commands, as in `lissajous ros robot`."""
    seed: int = whole(0, 0, 2**31 - 1)
    """Seed of the episode."""
    wait: float = number(60.0, 1.0, _FOREVER, "s")
    """Longest time to wait for the robots [s]."""
    patience: float = number(10.0, 0.1, _FOREVER, "s")
    """Longest time for which the clock waits for the decision of a robot [s]."""
    pace: float = number(1.0, 0.01, 1000.0)
    """Largest number of simulated seconds per second."""


def command_topics(scenario: Scenario, command: str) -> dict[str, str]:
    """Return the topics of a kind of commands that robots understand, with the types of their messages.

    Raises:
        ValueError: they are neither cars nor differential drives, or understand another kind.
    """
    kind = scenario.robot.kind
    require(kind in COMMANDS, "scenario", f"must be of robots of kind {' or '.join(COMMANDS)}", kind)
    known = " or ".join(COMMANDS[kind])
    require(command in COMMANDS[kind], "command", f"must be {known} for robots of kind {kind}", command)
    return COMMANDS[kind][command]
