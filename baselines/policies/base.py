"""The base classes of policies and of filters.

A policy receives the observation and nothing else. The action of a robot depends only on its own row, its own memory
and the scenario; only robots with the filter `-proved` also exchange their tails within a step. So every policy could
run on a robot, and classical and learned ones are compared fairly.
"""

from collections.abc import Mapping
from contextlib import AbstractContextManager, nullcontext
from typing import Any

import numpy as np
import warp as wp

from baselines.policies.inside import Inside, WallRule
from baselines.policies.memory import Remembering
from baselines.policies.stopping import Stopping
from lissajous_env.device.copies import Copyable
from lissajous_env.device.devices import as_device, copy_in, is_torch
from lissajous_env.device.program import launcher
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, whole_number
from lissajous_env.wording import few_of, require
from lissajous_env.world.observation import layout

_ARRAYS = ("numpy", "torch", "warp")


def parameters_for(cls: Any, scenario: Scenario, **changed: Any) -> Any:
    """Return parameters of a class: the changed ones as given, the others scaled if the class has a method `of`."""
    if cls is None:
        return None
    return cls.of(scenario, **changed) if hasattr(cls, "of") else cls(**changed)


class UnsuitableScenarioError(ValueError):
    """Error for a scenario that a policy cannot play, such as a rectangle that is too small for its motion."""


class Filter(Copyable, Remembering):
    """Base class of filters: functions from observations and wanted actions to safer actions.

    A subclass implements `__call__`. A policy with a filter is `Filtered`.

    Args:
        scenario: The scenario, of cars.
        num_worlds: W.
        device: Warp device.
        parameters: Parameters of the filter; by default its `defaults`, scaled to the scenario.

    Raises:
        ValueError: the robots are no cars.
    """

    defaults: Any
    """Parameters for the paper's experiment, which have a method `of(scenario)`."""
    suffix: str = ""
    """Suffix that adds the filter to the name of a policy."""
    about: str = ""
    """End of the description of a policy with the filter, after the name of the policy."""
    as_car: bool = False
    """True if the filter also serves robots of other models that move like cars."""
    communicates: str = "nothing"
    """Content of the messages that the filter uses."""
    wall_rule: bool = True
    """True if the wall rule changes the filter's actions, as it changes those of the policy before the filter; False
    for a filter that prevents contacts with walls itself."""

    def __init__(self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu", parameters: Any = None):
        require(scenario.actuation == "car", "policy of a filter", "must drive robots of kind car", scenario.actuation)
        self.scenario = scenario.resolve()
        self.parameters = parameters or self.defaults.of(self.scenario)
        self.num_worlds = num_worlds
        self.device = as_device(device)
        self.shape = (num_worlds, self.scenario.num_robots)
        self.action = wp.zeros((*self.shape, self.scenario.action_size), dtype=wp.float32, device=self.device)
        self.launch = launcher(self.device)

    def __call__(self, observation: wp.array, wanted: wp.array, out: wp.array | None = None) -> wp.array:
        """Return the actions (W, N, A) for observations (W, N, D) and wanted actions (W, N, A).

        They are written to `out`, by default to `action`. Messages, the entries after those of the motion, pass
        unchanged.
        """
        raise NotImplementedError(f"{type(self).__name__} must have a method __call__(observation, wanted, out)")


class Policy(Copyable, Remembering):
    """Base class of policies, for a batch of W worlds of N robots of one scenario, on one device.

    A subclass implements one method, `decide`, and also `forget` if it has a memory:

        class Slower(baselines.Policy):
            def decide(self, observation):  # NumPy (W, N, D)
                return np.full(self.action.shape, 0.1)

    Copies and pickles of a policy include all attributes that `__init__` sets, also Warp arrays.

    Args:
        scenario: The scenario.
        num_worlds: W.
        device: Warp device.
        parameters: Parameters of the class `Parameters`; by default those for the scenario.

    Raises:
        ValueError: the number of worlds is below 1, the device is not available, the policy is for another kind of
            robots, or parameters of another class.
    """

    arrays: str = "numpy"
    """Type of `decide`'s argument: "numpy", an array on the host; "torch" or "warp", one on the policy's device."""
    kind: str | None = None
    """Kind of robot that the policy drives, or `velocity` if its actions are velocities of cars (`task.action`); None
    drives any."""
    communicates: str = "nothing"
    """Content of the messages that the policy uses; "nothing" if messages do not change its actions."""
    wall_rule: bool = True
    """True if the wall rule of cars (`baselines.policies.inside`) or of differential drives
    (`baselines.policies.stopping`) changes actions after which a robot could not stay inside walls; False for a policy
    that ensures this itself."""

    Parameters: type[Checked] | None = None
    """Dataclass of its parameters; None for none. With a method `of(scenario, **overrides)`, the defaults are those
    for the scenario."""

    def __init__(self, scenario: str | Scenario, num_worlds: int = 1, device: Any = "cpu", parameters: Any = None):
        self.num_worlds = whole_number("num_worlds", num_worlds)
        self.scenario = named.build(scenario).resolve()
        self.num_robots = self.scenario.num_robots
        self.device = as_device(device)
        self.name = type(self).__name__
        require(self.arrays in _ARRAYS, f"arrays of {self.name}", f"must be one of {', '.join(_ARRAYS)}", self.arrays)
        rule = f"must be {self.scenario.actuation}, that of the robots of {self.scenario.name}, or None"
        require(self.kind in (None, self.scenario.actuation), f"kind of {self.name}", rule, self.kind)
        if self.Parameters is not None:
            fits = parameters is None or isinstance(parameters, self.Parameters)
            require(fits, f"parameters of {self.name}", f"must be {self.Parameters.__name__}", parameters)
            self.parameters: Any = parameters or parameters_for(self.Parameters, self.scenario)
        self.shape = (self.num_worlds, self.num_robots)
        self.observation_shape = (*self.shape, layout(self.scenario).size)
        self._observation = wp.zeros(self.observation_shape, dtype=wp.float32, device=self.device)
        self.action = wp.zeros((*self.shape, self.scenario.action_size), dtype=wp.float32, device=self.device)
        self._stay_inside: WallRule | None = None
        for wall_rule in (Inside, Stopping) if self.wall_rule else ():
            if wall_rule.suits(self.scenario):
                self._stay_inside = wall_rule(self.scenario, self.num_worlds, self.device)
        self.launch = launcher(self.device)
        """Launches a kernel, `launch(kernel, dim, inputs, outputs)`; with the same arguments again at little cost."""

    def decide(self, observation: Any) -> Any:
        """Return actions (W, N, action_size) in [-1, 1] for observations (W, N, D); a subclass implements this.

        Args:
            observation: float32, of the type that `arrays` names. A NumPy array or a torch tensor is a copy; a Warp
                array may be the simulation's own, and must not be changed.

        Returns:
            An array of any type, or nested lists, of numbers. With `arrays = "warp"` a policy may write all of
            `self.action` instead, in which the wall rule changes actions, and return None.
        """
        raise NotImplementedError(f"{type(self).__name__} must have a method decide(observation) that returns actions")

    def restrict(self, robot: int) -> None:
        """Skip expensive computations for all robots except one, whose actions alone are used from now on.

        A subclass with expensive computations overrides this; by default a policy restricts the policies in its
        attributes.

        Raises:
            ValueError: there is no such robot.
        """
        whole_number("robot", robot, 0, self.num_robots - 1)
        for part in vars(self).values():
            if isinstance(part, Policy):
                part.restrict(robot)

    def act(self, observation: Any) -> Any:
        """Return actions (W, N, action_size) in [-1, 1] for observations (W, N, D).

        The observation is a NumPy array, torch tensor or Warp array of numbers; the actions are of the same type, in
        float32. The next call overwrites a returned Warp array.

        A policy for one world also accepts the observations of a PettingZoo `ParallelEnv` by agent, and returns
        actions by agent. Removed agents may be missing:

            env, policy = lissajous_env.parallel_env("rough"), baselines.make("kuramoto-mpcc", "rough")
            observations, infos = env.reset(seed=0)
            policy.reset()
            while env.agents:
                observations, rewards, *_ = env.step(policy.act(observations))

        Raises:
            ValueError: the observation has another shape, an unknown agent, or (tested only for arrays on the host) a
                number that is not finite; or `decide` returned actions of another shape, or no numbers.
        """
        if isinstance(observation, Mapping):
            return self._act_by_agent(observation)
        with self._on_torch_stream(observation):
            self._write_action(self._as_warp(observation))
            if isinstance(observation, wp.array):
                return self.action
            return wp.to_torch(self.action).clone() if is_torch(observation) else self.action.numpy().copy()

    def _act_by_agent(self, rows: Mapping[str, Any]) -> dict[str, np.ndarray]:
        require(self.num_worlds == 1, "policy", "must be for one world to take observations by agent", self.num_worlds)
        agents = [f"robot_{i}" for i in range(self.num_robots)]
        if unknown := [str(agent) for agent in rows if agent not in agents]:
            raise ValueError(f"observation must be of the agents {few_of(agents, unknown[0])}, got {few_of(unknown)}")
        self._observation.zero_()
        for agent, row in rows.items():
            copy_in(f"observation of {agent}", row, self._observation[0, agents.index(agent)])
        actions = self.act(self._observation.numpy())[0]
        return {agent: action for agent, action in zip(agents, actions, strict=True) if agent in rows}

    def _as_warp(self, observation: Any) -> wp.array:
        """Return the observation as a Warp array on the device; refuse numbers on the host that are not finite."""
        rows, on_host = self._observation, not isinstance(observation, wp.array) and not is_torch(observation)
        if isinstance(observation, wp.array) and observation.device == self.device:
            rows = observation
            if observation.dtype is not wp.float32 or observation.shape != self.observation_shape:
                got = f"{wp.types.type_repr(observation.dtype)} of shape {observation.shape}"
                raise ValueError(f"observation must be float32 of shape {self.observation_shape}, got {got}")
        else:
            copy_in("observation", observation, rows)
        if self.device.is_cpu or on_host:
            numbers = rows.numpy()
            if not np.isfinite(numbers).all():
                w, i, k = np.argwhere(~np.isfinite(numbers))[0]
                at = f"{layout(self.scenario).names[k]} of robot_{i} in world {w}"
                raise ValueError(f"observation must be finite, got {numbers[w, i, k]} for {at}")
        return rows

    def _write_action(self, rows: wp.array) -> None:
        """Write `action`: convert the observation for `decide`, store its result, and apply the wall rule."""
        observation: Any = rows
        if self.arrays == "numpy":
            observation = np.array(rows.numpy())
        elif self.arrays == "torch":
            observation = wp.to_torch(rows).clone()
        decided = self.decide(observation)
        if decided is not self.action and not (decided is None and self.arrays == "warp"):
            copy_in(f"actions of {self.name}", decided, self.action)
        if self._stay_inside is not None:
            self._stay_inside(rows, self.action)

    def _on_torch_stream(self, observation: Any) -> AbstractContextManager:
        """Return a context in which Warp launches on torch's stream if torch also computes on the GPU."""
        if self.device.is_cpu or not (is_torch(observation) or self.arrays == "torch"):
            return nullcontext()
        import torch

        stream = wp.stream_from_torch(torch.cuda.current_stream(wp.device_to_torch(self.device)))
        return wp.ScopedStream(stream, sync_enter=True, sync_exit=True)


def both_contents(one: str, other: str) -> str:
    """Return the content of the messages of two parts of a policy, in the words of `Policy.communicates`."""
    return " and ".join(content for content in dict.fromkeys((one, other)) if content != "nothing") or "nothing"


class Filtered(Policy):
    """A policy whose actions pass through a filter: the filter decides last.

    Args:
        policy: The policy.
        filter: Class of the filter, such as `baselines.policies.safety.proved.Proved`.
        parameters: Parameters of the filter; by default those that it has for the scenario.

    Raises:
        ValueError: the robots are no cars.
    """

    arrays = "warp"

    def __init__(self, policy: Policy, filter: type[Filter], parameters: Any = None):
        self.wall_rule = filter.wall_rule
        super().__init__(policy.scenario, policy.num_worlds, policy.device)
        self.policy = policy
        self.filter = filter(self.scenario, self.num_worlds, self.device, parameters)
        self.kind, self.communicates = "car", both_contents(policy.communicates, filter.communicates)
        self.name = policy.name + filter.suffix

    def decide(self, observation: wp.array) -> None:
        """Let the policy act, and filter its actions."""
        self.filter(observation, self.policy.act(observation), self.action)
