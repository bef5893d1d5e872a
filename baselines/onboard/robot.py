"""One robot's policy outside the simulator, and the rules by which it stops."""

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from baselines.onboard import signals
from baselines.onboard.row import Row
from baselines.onboard.signals import Command, Message, Odometry, Twist, are_finite, conversion_to_commands
from baselines.policies import registry
from baselines.policies.base import Policy
from baselines.policies.safety.proved import Proved
from baselines.policies.safety.safe import Safe
from lissajous_env import scenario as make_scenario
from lissajous_env.parameters.robot_models import tightest_radius
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, number, whole_number
from lissajous_env.wording import counted, require, shown

_MOST_STEPS = 10
"""Largest number of a policy's steps in one call."""


def _limit(unit: str) -> float:
    return number(0.0, 1e-3, 1e9, unit, or_zero=True, or_infinite=True)


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
    """Deviation of the time between two calls from a control step, and how far ahead of this robot's clock a time stamp
    may be [s]; 0 means 2.5 control steps. A clock that stops or goes back counts as a jump."""
    silence: float = _limit("s")
    """Age of the last message of a ring neighbour [s], for policies that use messages; 0 means the age from which
    policies ignore a message, `Scenario.time_unit`. From the first call on, a neighbour that was not heard yet counts
    as silent for the time since then."""
    watchdog: float = _limit("s")
    """Time for which a command is valid [s]; 0 means 2.5 control steps."""

    def of(self, scenario: Scenario) -> "Limits":
        """Return the limits of a scenario, in which none is 0."""
        some, room = 2.5 * scenario.task.step, 2 * tightest_radius(scenario.robot)
        derived = {"pose_age": some, "fence": room, "clock_jump": some, "silence": scenario.time_unit, "watchdog": some}
        return Limits(**{name: getattr(self, name) or value for name, value in derived.items()})


class Output(NamedTuple):
    """Result of a call of `Onboard.act`."""

    command: Command | Twist
    """Command until the next call; that of a robot at rest if the robot is stopped."""
    message: Message | None
    """Message to both ring neighbours; None before the first valid pose."""
    stopped: str
    """Reason for which the robot is stopped; empty while it drives."""
    action: np.ndarray
    """(A,) action of the policy in [-1, 1], also where the robot is stopped; zeros before the first valid pose."""
    row: np.ndarray
    """(D,) latest observation row; after an early call, the policy decided on the one before."""


class Onboard:
    """One robot's policy outside the simulation: on the robot's own computer, or in another simulator.

    Call `act` once in each control step of the scenario (`scenario.task.step`), also while the robot is stopped. The
    policy's steps follow the clock: after a missed call it takes two steps, and a call more than half a step too early
    repeats the last action. A policy that is more than ten steps behind, as after a long wait for the first pose, takes
    ten in each call, and one that is ahead of a clock that went back takes none; the robot is stopped meanwhile. If it
    would have to make up for more than an episode, it begins anew. Send `command_at(now)` to the actuators, as often as
    they require it. All times are of one clock that the robots share. Coordinates are those of the scenario: the origin
    is the middle of the rectangle.

    A robot stops if a limit of `Limits` is exceeded, if input is not finite, and after `stop()`; `Output.stopped`
    contains the reason. While it is stopped, its policy observes that the robot has failed, as in the simulation, and
    the robot still sends its phase, so that its neighbours slow down.

    Args:
        policy: A name, a checkpoint's folder, `module:factory`, a factory, or a policy for one world.
        scenario: Scenario of the robots, which must be cars or differential drives.
        robot: Index of this robot, from 0.
        limits: The limits beyond which the robot stops.

    Attributes:
        neighbours: Indices of the two ring neighbours, whose messages the robot requires: the previous and the next
            one, -1 for none.
        listens: True if the policy uses the messages of the ring neighbours.

    Raises:
        ValueError: the policy or the scenario is unknown, its robots are neither cars nor differential drives, the
            index is out of range, the policy uses the proved filter, whose messages to all robots are not exchanged
            here, or the scenario has observation entries of extensions, which require a simulation.
    """

    def __init__(
        self,
        policy: Any,
        scenario: str | os.PathLike[str] | Scenario,
        robot: int,
        limits: Limits | None = None,
    ):
        self.scenario = make_scenario(scenario).resolve()
        n = self.scenario.num_robots
        self.robot = whole_number("robot", robot, 0, n - 1)
        self.neighbours = tuple(int(neighbour) for neighbour in self.scenario.neighbours[self.robot])
        self.limits = (limits or Limits()).of(self.scenario)
        self._policy = _policy_of(policy, self.scenario, self.robot)
        self.listens = getattr(self._policy, "communicates", "nothing") != "nothing"
        self._row = Row(self.scenario, self.robot)
        self._command_of = conversion_to_commands(self.scenario)
        self._rest = self._command_of(self.scenario.model.rest_action(self.scenario.robot))
        self._rows = wp.zeros((1, n, len(self._row.values)), dtype=wp.float32, device="cpu")
        self._rows_host = self._rows.numpy()
        self._size = self.scenario.messages.size
        self.reset()

    def reset(self) -> None:
        """Begin a new episode: reset all memory, and let a stopped robot drive again."""
        self._begin(math.nan)
        self._heard: list[Message | None] = [None, None]
        self._now, self._latched = math.nan, ""
        self._action = np.zeros(self.scenario.action_size, dtype=np.float32)
        self._numbers = (0.0,) * self._size
        self._command, self._since = self._rest, math.nan

    def stop(self, reason: str = "the robot was requested to stop") -> None:
        """Stop the robot until `resume`; `command_at` returns the command of rest at once."""
        self._latched = self._latched or reason
        self._command = self._rest

    def resume(self) -> None:
        """Let the robot drive again after `stop`, after a jump of its clock, or after it left the fence.

        Its phase is then computed from its next pose, because it may have been moved.
        """
        self._latched = ""
        self._row.forget()

    def command_at(self, now: float) -> Any:
        """Return the command for the actuators at a time [s]: the latest, or that of rest if it is no longer valid.

        A command is valid for `limits.watchdog` from the call of `act` that returned it.
        """
        return self._command if 0 <= now - self._since <= self.limits.watchdog else self._rest  # also for NaN

    def announce(self, odometry: Odometry) -> Message | None:
        """Return the message of a new pose for both ring neighbours, before `act` is called with this pose.

        A robot that sends it at once, and calls `act` when the messages of its neighbours have arrived, decides on
        messages of the same time. `Output.message` is then the same message again, with the numbers of the new action.

        Returns:
            The message; None for a pose that is not finite.
        """
        if signals.finite_pose(odometry) is None:
            return None
        self._row.fill(odometry, self._heard, True, None)
        return self._message()

    def act(
        self,
        now: float,
        odometry: Odometry | None,
        heard: Sequence[Message] = (),
        robots: Any = (),
        targets: Any = (),
        phase: tuple[float, float] | None = None,
        works: bool = True,
    ) -> Output:
        """Decide on the command of the next control step.

        Args:
            now: Time [s].
            odometry: The latest pose and speed; None if there is none yet.
            heard: Messages that were received, at least those since the last call. The latest one of each ring
                neighbour counts; those of other robots, and damaged ones, are ignored.
            robots: Robots that the sensor detects: (K, 4) relative x, y [m] and relative velocity [m/s], in the
                directions of the axes.
            targets: Targets that the sensor detects: (K, 2) relative x, y [m].
            phase: Cosine and sine of the robot's phase, if known; by default the phase is computed from the first pose
                and then follows the curve, as in the simulation.
            works: False if the robot cannot move now; it is then stopped.

        Raises:
            ValueError: `robots` or `targets` have another shape, the pose is no `Odometry`, or a message is none.
        """
        robots, targets = signals.detection_rows("robots", robots, 4), signals.detection_rows("targets", targets, 2)
        self._listen(now, heard)
        measured = signals.finite_pose(odometry)
        fault = self._lasting_fault(now, measured)
        self._latched = self._latched or fault
        reasons = [self._latched] if self._latched else []
        reasons += ["there is no pose"] if odometry is None else self._faults(now, measured)
        if not are_finite([*robots.flat, *targets.flat, *(() if phase is None else phase)]):
            reasons.append("a number of the phase or of the sensor's data is not finite")
            robots, targets, phase = robots[:0], targets[:0], None
        if not works:
            reasons.append("the robot does not work")
        pose = measured or self._row.pose
        if pose is None or not are_finite([now]):
            return self._output(now, self._rest, reasons[0])
        due = round((now - self._begun) / self.scenario.task.step) + 1 - self._steps
        if not 0 <= due <= _MOST_STEPS:
            off = f"the policy is {counted(abs(due), 'step')} {'behind' if due > 0 else 'ahead of'} the clock"
            if abs(due) > self.scenario.task.steps:
                off, due = f"{off}, so it begins anew", 1
                self._begin(now)
            reasons.append(off)
        self._row.place_detections(robots, targets)
        row = self._row.fill(pose, self._heard, not reasons, phase if pose is odometry else None)
        for _ in range(min(due, _MOST_STEPS)):
            self._decide(row)
        if not np.isfinite(self._action).all():
            reasons.append("the action of the policy is not finite")
        if reasons:
            return self._output(now, self._rest, reasons[0])
        if self._size:
            self._numbers = tuple(np.clip(self._action[-self._size :], -1, 1).tolist())
        return self._output(now, self._command_of(self._action))

    def _begin(self, now: float) -> None:
        """Begin an episode of the policy at a time [s]; NaN for that of the next call."""
        self._policy.reset()
        self._row.forget()
        self._begun, self._steps = now, 0

    def _listen(self, now: float, heard: Sequence[Message]) -> None:
        """Store the latest message of each ring neighbour; after a clock went back, none of before is the latest."""
        if now <= self._now:
            self._heard = [None, None]
        for message in heard:
            rule = "must have messages of baselines.onboard.Message"
            require(isinstance(message, Message), "heard", rule, message)
            if message.sender >= 0 and message.sender in self.neighbours and message.is_sound(self._size):
                side = self.neighbours.index(message.sender)
                known = self._heard[side]
                comes_later = known is None or message.sent_at >= known.sent_at
                if comes_later and message.sent_at - now <= self.limits.clock_jump:
                    self._heard[side] = message

    def _lasting_fault(self, now: float, pose: Odometry | None) -> str:
        """Store the time, and return a fault of the clock or the place, after which the robot stays stopped, or ""."""
        before, step, limits, curve = self._now, self.scenario.task.step, self.limits, self.scenario.curve
        if not are_finite([now]):
            return "the clock is not finite"
        self._now, passed = now, now - before
        if math.isnan(before):
            self._begun = now
        elif passed <= 0:
            return f"the clock went back by {before - now:.3g} s" if passed < 0 else "the clock stopped"
        elif abs(passed - step) > limits.clock_jump:
            return (
                f"the clock jumped by {passed:.3g} s, where a step of {step:g} s may be off by {limits.clock_jump:g} s"
            )
        out = 0.0 if pose is None else max(abs(pose.x) - curve.half_width, abs(pose.y) - curve.half_height)
        is_out, rule = out > limits.fence, f"the limit is {limits.fence:g} m"
        return f"the robot is {out:.3g} m outside of the rectangle, {rule}" if is_out else ""

    def _faults(self, now: float, pose: Odometry | None) -> Iterator[str]:
        """Yield the faults of the latest pose, which is None if it is not finite, and of the ring neighbours."""
        limits = self.limits
        if pose is None:
            yield "the pose is not finite"
        elif now - pose.stamp > limits.pose_age:
            yield f"the pose is {now - pose.stamp:.3g} s old, the limit is {limits.pose_age:g} s"
        elif pose.stamp - now > limits.clock_jump:
            yield f"the pose is of {pose.stamp - now:.3g} s from now"
        for neighbour, message in zip(self.neighbours, self._heard, strict=True):
            since = now - (self._begun if message is None else message.sent_at)
            if self.listens and neighbour >= 0 and since > limits.silence:
                yield f"robot {neighbour} has been silent for {since:.3g} s, the limit is {limits.silence:g} s"

    def _decide(self, row: np.ndarray) -> None:
        self._rows_host[:], self._steps = row, self._steps + 1
        if isinstance(self._policy, Policy):
            self._action[:] = self._policy.act(self._rows).numpy()[0, self.robot]
        else:
            self._action[:] = np.asarray(self._policy.act(self._rows_host.copy()))[0, self.robot]

    def _output(self, now: float, command: Command | Twist, stopped: str = "") -> Output:
        """Store the command, and return it with the message, the action and the row."""
        self._command, self._since = command, now
        return Output(command, self._message(), stopped, self._action.copy(), self._row.values.copy())

    def _message(self) -> Message | None:
        pose = self._row.pose
        return None if pose is None else Message(self.robot, pose.stamp, *self._row.sent, self._numbers)


def _policy_of(policy: Any, scenario: Scenario, robot: int) -> Any:
    """Return the policy for one world, restricted to a robot."""
    acting: Any = registry.as_factory(policy, shown(policy))(scenario, 1, "cpu")
    require(acting.num_worlds == 1, "num_worlds of the policy", "must be 1", acting.num_worlds)
    if isinstance(acting, Policy):
        kind, filters = scenario.robot.kind, f"filter {Proved.suffix}, as no tails are sent here; use {Safe.suffix}"
        require(acting.kind in (None, kind), "policy", f"must drive robots of kind {kind}", acting.kind)
        require(not _is_proved(acting), "policy", f"must be without the {filters}", acting.name)
        acting.restrict(robot)
    return acting


def _is_proved(part: Any) -> bool:
    """Return whether a policy, or one in its attributes, uses the proved filter."""
    return isinstance(part, Proved) or (isinstance(part, Policy) and any(map(_is_proved, vars(part).values())))
