"""Worlds of a training: the inputs of actors and critics, and the results of a step for each robot.

Row w N + i is robot i of world w. Worlds of a space of scenarios have room for the largest team; rows without a robot
are zeros.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from torch import Tensor

import baselines
from baselines.policies.base import Policy
from lissajous_env.device.copies import Stateful
from lissajous_env.envs.batch import Batch
from lissajous_env.envs.sides import padded
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import GONE, HIDDEN, WORKING
from lissajous_env.world.targets.motion import DRIFTING, FLEEING, WANDERING
from training.learned.perception import FAR, actions_of, axes_of, base_action, columns_of, half_of, perceive, to_walls
from training.settings import TrainingSettings

TRUTH = (
    *("target", "robot", "x", "y", "distance", "near", "right", "upper", "left", "lower"),
    *("observers", "other_distance", "flees", "x_velocity", "y_velocity"),
)
"""Numbers of a token of the critic: its kind; direction, and distance d as d / (1 + d) and as 1 - d [sight]; distances
to the walls [2 sights]; and of a target the number of other robots that have it in sight, at most 2, the distance of
the nearest other robot as d / (1 + d), 1 if it flees, and its velocity while it drifts or wanders [top speed]."""
MOST_TARGETS = 16
"""Largest number of targets that the critic reads, the first ones that are present."""
_GOLDEN = 0.618034
"""Golden ratio less 1. Its multiples modulo 1, evenly spread, are the shares after which the first episodes end."""


class StepResult(NamedTuple):
    """Results of a step of W worlds, for their B = W N slots of robots."""

    reward: np.ndarray
    """(B,) reward without the two terms that follow."""
    collided: np.ndarray
    """(B,) the term of the reward for collisions."""
    observed: np.ndarray
    """(B,) the term for targets in sight, which all robots share."""
    acted: np.ndarray
    """(B,) 1 for robots that were in the world before the step."""
    ended: np.ndarray
    """(B,) 1 for robots that the step removed."""
    over: np.ndarray
    """(W,) True for worlds whose episode has ended."""


class Truth(NamedTuple):
    """True state relative to each robot: the inputs of a central critic, and two numbers for the rewards."""

    tokens: np.ndarray
    """(W, N, K, F) numbers `TRUTH` of each target and each other robot."""
    present: np.ndarray
    """(W, N, K) 1 where there is a token, else 0."""
    alone: np.ndarray
    """(W, N) number of all targets that the robot has in sight and no other robot has; 0 if sight earns no reward."""
    nearness: np.ndarray
    """(W, N) sum over other robots: 1 for one that it touches, and less down to 0 for a gap of a body's diameter."""


class Rollout(NamedTuple):
    """T steps of B robots, as tensors.

    Attributes:
        perception: (T, B, ...) inputs of the actor: `Worlds.perception`.
        critic_inputs: (T, B, ...) inputs of the critic besides the robot's own numbers: tokens and presence.
        actions: (T, B, A).
        likelihood: (T, B) logarithm of the density of the actions, up to a constant.
        acted: (T, B) 1 where a robot was in its world.
        advantages: (T, B).
        returns: (T, B) discounted returns, which the critic learns.
        deviation: Standard deviation of the actions.
    """

    perception: list[Tensor]
    critic_inputs: list[Tensor]
    actions: Tensor
    likelihood: Tensor
    acted: Tensor
    advantages: Tensor
    returns: Tensor
    deviation: float


class Worlds(Stateful):
    """W worlds of a scenario, or of a space, with the actions of the base; inputs of actor and critic.

    `save_state` and `load_state` are for worlds of a scenario.
    """

    def __init__(self, settings: TrainingSettings, worlds: int, seed: int):
        groups = 1 if settings.space is None else settings.groups
        self.batch = Batch(
            settings.scenario, worlds, num_groups=groups, roles="robots", seed=seed, device=settings.device,
            threads=settings.threads, overrides=settings.lean_overrides,
        )  # fmt: skip
        self.side = self.batch.sides[0]
        self.count = worlds * self.side.slots  # B
        self._base = settings.corrected_base
        self._bases: list[Policy] = []
        """Policies that the network corrects, one for each group; empty without any."""
        self._base_actions = np.zeros((worlds, self.side.slots, min(self.side.action_size, 2)), np.float32)
        """Actions of these policies for the present states, without messages."""
        self.steps = self.batch.scenario.task.steps
        # Worlds of a group end together, so that it can draw its next scenario.
        shares = np.arange(1, 1 + (worlds if settings.space is None else groups)) * _GOLDEN % 1.0
        self._first = np.ceil(shares * self.steps).repeat(worlds // len(shares))
        self._left = self._first
        """Steps (W,) until the episode of a world ends: the first ones, `_first`, end at different times."""
        self.restart(None)

    def restart(self, seed: int | None) -> None:
        """Begin a first episode in all worlds, again of different lengths; None leaves the seed as it is."""
        self.batch.seed(seed)
        self.batch.reset()
        self._left, self._bases = self._first.copy(), []
        self._update_base_actions()

    def perception(self) -> list[np.ndarray]:
        """Return the inputs of the actor, as `perceive` does: own numbers (B, A), tokens (B, K, F), presence (B, K)."""
        parts = []
        for group, simulation in enumerate(self.batch.simulations):
            of_base = self.batch.of_group(self._base_actions, group) if self._bases else None
            parts.append(perceive(simulation.observation.numpy(), simulation.scenario, of_base))
        return [self._flat(part) for part in zip(*parts, strict=True)]

    def truth(self) -> Truth:
        """Return the true state, with rows (B, ...) instead of (W, N, ...)."""
        parts = []
        for tokens, present, *numbers in map(true_view, self.batch.simulations):
            # Scenarios of a space have different numbers of targets and robots.
            more = 0 if self.batch.space is None else MOST_TARGETS + self.side.slots - present.shape[2]
            wider = (0, 0), (0, 0), (0, more)
            parts.append((np.pad(tokens, (*wider, (0, 0))), np.pad(present, wider), *numbers))
        return Truth(*(self._flat(part) for part in zip(*parts, strict=True)))

    def step(self, actions: np.ndarray) -> StepResult:
        """Advance all worlds with outputs (B, A) of the network; `begin` must follow."""
        batch, side = self.batch, self.side
        actions = actions.reshape(batch.num_worlds, side.slots, -1).astype(np.float32)
        for group, simulation in enumerate(batch.simulations):
            part = batch.of_group(actions, group)
            part[...] = actions_of(part, simulation.observation.numpy(), simulation.scenario)
        acted = batch.live(side).reshape(-1).astype(np.float32)
        batch.step({"robot": actions})
        after, names = batch.rows(side), batch.simulation.reward_term_names
        collided, observed = (after.terms[..., names.index(name)].reshape(-1) for name in ("collision", "observation"))
        self._left -= 1
        reward = after.reward.reshape(-1) - collided - observed
        ended = after.terminated.reshape(-1).astype(np.float32) * acted
        return StepResult(reward, collided.copy(), observed.copy(), acted, ended, batch.over | (self._left <= 0))

    def begin(self, mask: np.ndarray) -> None:
        """Begin episodes in the masked worlds, and compute the actions of the base in all of them."""
        if mask.any():
            self.batch.reset(mask)
            size = self.batch.group_size
            steps = np.repeat([simulation.scenario.task.steps for simulation in self.batch.simulations], size)
            # A world of a space that has lost all of its robots begins anew alone, and still ends with its group.
            begun = mask if self.batch.space is None else mask.reshape(-1, size).all(axis=1).repeat(size)
            self._left[begun] = steps[begun]
            for group, base in enumerate(self._bases):
                base.reset(mask[self.batch.worlds_of(group)])
        self._update_base_actions()

    def _update_base_actions(self) -> None:
        """Compute the base's actions for the present states; a group with a new scenario gets a new base."""
        if self._base is None:
            return
        simulations = self.batch.simulations
        before: Sequence[Policy | None] = self._bases or [None] * len(simulations)
        self._bases = [
            base
            if base and base.scenario == simulation.scenario
            else baselines.make(self._base, simulation.scenario, simulation.num_worlds)
            for base, simulation in zip(before, simulations, strict=True)
        ]
        for group, (base, simulation) in enumerate(zip(self._bases, simulations, strict=True)):
            action = base_action(base, simulation.observation.numpy())
            self.batch.of_group(self._base_actions, group)[...] = action[..., :2]

    def _flat(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """Join arrays (W, n, ...) of the groups to (B, ...), with zeros for slots without a robot."""
        joined = np.concatenate([padded(part, self.side.slots - part.shape[1], np) for part in parts])
        return joined.reshape(self.count, *joined.shape[2:])


def true_view(simulation: Simulation) -> Truth:
    """Return the true state relative to each robot, as a critic reads it."""
    sight = np.float32(simulation.scenario.sight)
    axes = axes_of(simulation.observation.numpy(), simulation.scenario)
    robots = simulation.robots.position.numpy()[..., :2] / sight
    works = simulation.robots.status.numpy() == WORKING
    targets, there, flees, velocity = _true_targets(simulation)
    rewarded = there.any(axis=0) & (simulation.scenario.task.reward_observation != 0)
    to_targets = targets[:, None, rewarded] - robots[:, :, None]
    sighted = (np.sqrt((to_targets**2).sum(axis=-1)) < 1) & there[:, None, rewarded] & works[..., None]
    alone = (sighted & (sighted.sum(axis=1, keepdims=True) == 1)).sum(axis=-1).astype(np.float32)
    targets, there, flees, velocity = (part[:, :MOST_TARGETS] for part in (targets, there, flees, velocity))
    count = there.shape[1]
    positions = np.concatenate([targets, robots], axis=1)[:, None] * axes[:, :, None]
    offset = positions - robots[:, :, None] * axes[:, :, None]
    distance = np.sqrt((offset**2).sum(axis=-1))
    others = ~np.eye(robots.shape[1], dtype=bool) & works[:, None]
    present = np.concatenate([np.broadcast_to(there[:, None], distance[..., :count].shape), others], axis=2)
    observers, other_distance = _sightings(distance[..., :count], there, works)
    tokens = np.zeros((*distance.shape, len(TRUTH)), np.float32)
    tokens[:, :, :count, TRUTH.index("target")], tokens[:, :, count:, TRUTH.index("robot")] = 1, 1
    tokens[..., columns_of(TRUTH, "x", "y")] = offset / np.maximum(distance, np.float32(1e-6))[..., None]
    tokens[..., TRUTH.index("distance")] = distance / (1 + distance)
    tokens[..., TRUTH.index("near")] = np.maximum(1 - distance, 0)
    tokens[..., columns_of(TRUTH, "right", "lower")] = to_walls(positions, half_of(simulation.scenario), 2)
    tokens[:, :, :count, TRUTH.index("observers")] = np.minimum(observers, 2)
    tokens[:, :, :count, TRUTH.index("other_distance")] = other_distance / (1 + other_distance)
    tokens[:, :, :count, TRUTH.index("flees")] = flees[:, None]
    tokens[:, :, :count, columns_of(TRUTH, "x_velocity", "y_velocity")] = velocity[:, None] * axes[:, :, None]
    gap = distance[..., count:] / np.float32(2 * simulation.scenario.robot.radius / sight) - 1
    nearness = np.where(others & works[..., None], np.clip(1 - gap, 0, 1), 0).sum(axis=-1)
    return Truth(tokens * present[..., None], present.astype(np.float32), alone, nearness.astype(np.float32))


def _true_targets(simulation: Simulation) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return all targets, present ones first: positions (W, T, 2) [sight], presence, flight (W, T) and velocity.

    The velocity (W, T, 2) [top speed] is 0 unless a target drifts or wanders.
    """
    status = simulation.targets.status.numpy()
    there = (status != HIDDEN) & (status != GONE)
    first = np.argsort(~there, axis=1, kind="stable")
    arrays = (getattr(simulation.targets, name).numpy() for name in ("motion", "speed", "heading"))
    there, motion, speed, heading = (np.take_along_axis(array, first, 1) for array in (there, *arrays))
    positions = simulation.targets.position.numpy() / np.float32(simulation.scenario.sight)
    pace = np.where((motion == DRIFTING) | (motion == WANDERING), speed / simulation.scenario.speed_unit, 0)
    velocity = pace[..., None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    return np.take_along_axis(positions, first[..., None], 1), there, motion == FLEEING, velocity


def _sightings(distance: np.ndarray, there: np.ndarray, works: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return how many other robots have each target in sight, and the distance of the nearest other robot.

    Args:
        distance: (W, N, K) distances of the targets [sight]; the results have this shape.
        there: (W, K) presence of the targets.
        works: (W, N) True for working robots.
    """
    sighted = (distance < 1) & there[:, None] & works[..., None]
    observers = sighted.sum(axis=1, keepdims=True) - sighted
    measured = np.where(works[..., None], distance, np.inf)
    nearest = np.sort(np.pad(measured, ((0, 0), (0, 1), (0, 0)), constant_values=FAR), axis=1)[:, :2]
    # The nearest other robot of the nearest one is the second.
    other = np.where(measured <= nearest[:, :1], nearest[:, 1:], nearest[:, :1])
    return observers, np.minimum(other, FAR)
