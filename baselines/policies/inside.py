"""The rule by which cars stay inside walls (`lissajous_env.world.robots.inside`), for the actions of policies.

The rule is part of every policy that drives cars (`baselines.Policy`), classical or learned, also of one that drives
other robots as if they were cars; the argument is about cars, though, and not about robots that move like them only
roughly. Differential drives have one more rule after it (`baselines.policies.stopping`). A filter decides after the
rule; if the filter does not prevent contacts with walls itself (`Filter.wall_rule`), the rule is applied once more
to its actions. An action that no policy computes, as that of a function or of an agent in training, is not changed.
"""

from typing import Any

import warp as wp

from baselines.policies.memory import Remembering
from baselines.policies.own_row import Actions, Observation, own_heading, own_position, own_speed, own_works
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.copies import Copyable
from lissajous_env.device.curve import CurveStruct, curve_struct
from lissajous_env.device.devices import as_device
from lissajous_env.device.program import launcher
from lissajous_env.device.structs import RobotStruct, to_struct
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.robots.inside import Walls, action_inside, has_room, walls_of

wp.set_module_options(OPTIONS)


@wp.kernel
def stay_inside(
    walls: Walls,
    robot: RobotStruct,
    curve: CurveStruct,
    observation: Observation,
    action: Actions,
):
    """Change the steering and the throttle of the cars by the rule; an action that is not finite passes."""
    w, i = wp.tid()
    want = wp.vec2(action[w, i, 0], action[w, i, 1])
    if not own_works(w, i, observation) or not wp.isfinite(want[0]) or not wp.isfinite(want[1]):
        return
    place = own_position(w, i, curve, observation)
    speed = own_speed(w, i, walls.speed_unit, observation)
    if robot.speed_min == 0.0:
        speed = wp.max(speed, 0.0)
    car = wp.vec4(place[0], place[1], own_heading(w, i, observation), speed)
    clipped = wp.vec2(wp.clamp(want[0], -1.0, 1.0), wp.clamp(want[1], -1.0, 1.0))
    chosen = action_inside(walls, robot, car, clipped)
    if chosen[0] != clipped[0] or chosen[1] != clipped[1]:
        action[w, i, 0] = chosen[0]
        action[w, i, 1] = chosen[1]


class WallRule(Copyable, Remembering):
    """Base class of the rules that change actions after which robots could not stay inside walls, for W worlds.

    A subclass has the `kernel` of its rule, and may have a memory.
    """

    kernel: Any

    def __init__(self, scenario: Scenario, num_worlds: int, device: Any, constants: Any):
        self.num_worlds, self.shape = num_worlds, (num_worlds, scenario.num_robots)
        curve = curve_struct(scenario.curve, as_device(device))
        self._inputs = [constants, to_struct(RobotStruct, scenario.robot), curve]
        self._launch = launcher(device)

    def __call__(self, observation: wp.array, action: wp.array) -> None:
        """Change the actions (W, N, A) in place, from the observation (W, N, D); messages pass."""
        memory = [getattr(self, name) for name in self.remembers]
        self._launch(self.kernel, self.shape, [*self._inputs, observation], [*memory, action])


class Inside(WallRule):
    """The rule for the cars of a scenario with walls.

    Args:
        scenario: The scenario, resolved.
        num_worlds: W.
        device: Warp device.
        turns_early: True if the policy accounts for the time in which a differential drive gains its yaw rate.
    """

    kernel = stay_inside

    def __init__(self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu", turns_early: bool = False):
        super().__init__(scenario, num_worlds, device, walls_of(scenario, turns_early))

    @staticmethod
    def suits(scenario: Scenario) -> bool:
        """Return whether policies steer cars between walls that are at least a circle at `CREEP` apart."""
        return scenario.actuation == "car" and has_room(scenario)
