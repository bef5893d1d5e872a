"""Evaluate a policy: play episodes to the end and return their score rows.

A policy whose actions are not finite numbers is stopped with an error, because its score would be meaningless.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, Protocol

import numpy as np
import warp as wp

from lissajous_env.parameters import named
from lissajous_env.parameters.rogues import AGENTS
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import require, shown
from lissajous_env.world.simulation import Simulation

_TOGETHER = 16
"""Largest number of episodes that a function plays together."""


class ActingPolicy(Protocol):
    """Interface of a policy in an evaluation; see `baselines.policies.base.Policy`."""

    num_worlds: int

    def reset(self, worlds: Any = None) -> None:
        """Reset the memory of some worlds, or of all."""

    def act(self, observation: Any) -> Any:
        """Return actions (num_worlds, N, action_size) for observations (num_worlds, N, D)."""


class FunctionPolicy:
    """Policy made from a function `act(observation) -> action` on NumPy arrays (W, N, D) and (W, N, action_size).

    Args:
        function: Stateless function; it is not notified when an episode begins.
        num_worlds: W.
    """

    def __init__(self, function: Callable[[np.ndarray], Any], num_worlds: int):
        self.num_worlds, self._function = num_worlds, function
        self.name = getattr(function, "__name__", type(function).__name__)

    def reset(self, worlds: Any = None) -> None:
        """Do nothing: a function has no memory."""

    def act(self, observation: Any) -> Any:
        """Return the actions of the function for a copy of the observation."""
        rows = observation.numpy() if isinstance(observation, wp.array) else observation
        return self._function(np.array(rows))


def acts(policy: Any) -> bool:
    """Return whether an object is a policy: no class, with the attributes of `ActingPolicy`."""
    return not isinstance(policy, type) and all(hasattr(policy, part) for part in ("act", "reset", "num_worlds"))


class InvalidActionError(ValueError):
    """Error for actions of a policy that have a wrong shape or are not finite."""


def refuse_rogue_agents(scenario: Scenario) -> None:
    """Raise ValueError if the rogues of a scenario are agents: an episode of a policy has no actions of theirs."""
    rule = "must be None, or the name or the folder of a rogue, where no caller gives the actions of agents"
    require(scenario.targets.rogues != AGENTS, f"targets.rogues of {scenario.name}", rule, AGENTS)


class EpisodeRunner:
    """Plays episodes of a policy in a simulation, and raises an error for invalid actions.

    On a CPU every step is checked; on a GPU, to avoid waiting for it, an episode is checked at its end.

    Args:
        policy: The policy.
        simulation: The simulation.

    Raises:
        ValueError: as `refuse_rogue_agents`.
    """

    def __init__(self, policy: ActingPolicy, simulation: Simulation):
        refuse_rogue_agents(simulation.scenario)
        self.policy, self.simulation = policy, simulation
        self.name = name_of(policy)
        self._invalid = simulation.invalid.numpy() if simulation.device.is_cpu else None

    def step(self) -> None:
        """Take a step of the simulation with the policy's actions.

        Raises:
            InvalidActionError: an action has a wrong shape or is not finite; the message names policy and step.
        """
        action = self.policy.act(self.simulation.observation)
        try:
            self.simulation.take(action)
        except ValueError as error:
            raise InvalidActionError(f"policy {self.name} must return valid actions: {error}") from error
        self.simulation.advance()
        if self._invalid is not None:
            self.check()

    def play(self, seeds: Sequence[int], on_moment: Callable[[int], Any] = lambda taken: None) -> None:
        """Play an episode to its end in every world.

        Args:
            seeds: Seeds of the worlds' episodes, of which the last is repeated in surplus worlds.
            on_moment: Called with the number of steps taken, at the beginning and after each step.

        Raises:
            InvalidActionError: as `step`.
        """
        self.policy.reset()
        surplus = self.simulation.num_worlds - len(seeds)
        self.simulation.reset(seeds=[*seeds, *list(seeds[-1:]) * surplus])
        on_moment(0)
        for taken in range(self.simulation.scenario.task.steps):
            self.step()
            on_moment(taken + 1)
        self.check()

    def check(self) -> None:
        """Check that all actions of the running episodes were finite.

        Raises:
            InvalidActionError: an action was not finite.
        """
        invalid = self.simulation.invalid.numpy() if self._invalid is None else self._invalid
        if invalid.any():
            at = self.simulation.invalid_at.numpy()
            world = min(np.flatnonzero(invalid), key=lambda index: at[index])
            seed = self.simulation.clock.seed.numpy()[world]
            where = f"step {at[world]} of {self.simulation.scenario.name} in world {world} (seed {seed})"
            raise InvalidActionError(f"policy {self.name} must return finite actions, got NaN or infinity in {where}")


def name_of(policy: ActingPolicy) -> str:
    """Return the name of a policy, or of its class if it has none."""
    return str(getattr(policy, "name", type(policy).__name__))


def evaluate(
    policy: ActingPolicy | Callable[[np.ndarray], Any],
    scenario: str | Scenario,
    seeds: Iterable[int] = range(16),
    device: Any = "cpu",
    **overrides: Any,
) -> list[dict[str, Any]]:
    """Play one episode for each seed, `policy.num_worlds` at a time.

    Args:
        policy: A policy, or a function `act(observation) -> action` on NumPy arrays (W, N, D), which is called for
            at most 16 worlds together.
        scenario: The scenario.
        seeds: Seed of each episode.
        device: Warp device of the simulation.
        **overrides: Fields of the scenario, as in `lissajous_env.scenario`.

    Returns:
        A score row for each seed in order, with the columns of `lissajous_env.world.columns.NAMES`.

    Raises:
        InvalidActionError: the policy returned actions that have a wrong shape or are not finite (a ValueError).
        ValueError: an invalid policy, scenario or seed.
    """
    seeds, variant = list(seeds), named.build(scenario, **overrides)
    if not acts(policy) and (isinstance(policy, type) or hasattr(policy, "act") or not callable(policy)):
        hint = "; `baselines.make` makes one by name, a class by a call" if isinstance(policy, (str, type)) else ""
        raise ValueError(f"policy must have reset, act and num_worlds, or be a function, got {shown(policy)}{hint}")
    acting: Any = policy if acts(policy) else FunctionPolicy(policy, max(min(len(seeds), _TOGETHER), 1))  # type: ignore
    return [row for rows in episodes(acting, variant, seeds, device) for row in rows]


def episodes(
    policy: ActingPolicy,
    scenario: str | Scenario,
    seeds: Iterable[int],
    device: Any = "cpu",
    on_step: Callable[[Simulation], Any] = lambda simulation: None,
) -> Iterator[list[dict[str, Any]]]:
    """Yield the score rows of each batch of episodes when it has ended.

    Args:
        policy: The policy, which plays `num_worlds` episodes at a time.
        scenario: The scenario.
        seeds: Seed of each episode.
        device: Warp device of the simulation.
        on_step: Called with the simulation after each step.

    Raises:
        InvalidActionError: the policy returned actions that have a wrong shape or are not finite (a ValueError).
        ValueError: an invalid scenario or seed.
    """
    seeds = list(seeds)
    simulation = Simulation(named.build(scenario), policy.num_worlds, device=device)
    runner = EpisodeRunner(policy, simulation)
    for first in range(0, len(seeds), policy.num_worlds):
        batch = seeds[first : first + policy.num_worlds]
        runner.play(batch, lambda taken: on_step(simulation) if taken else None)
        rows = enumerate(simulation.score(np.arange(len(batch))), first)
        identity = {"scenario": simulation.scenario.name, "policy": runner.name}
        yield [identity | {"episode": episode} | row for episode, row in rows]
