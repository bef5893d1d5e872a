"""Worlds of a training: what actors and critics read in them, and what a step is worth to each robot.

Robots are rows: row w N + i is robot i of world w. Worlds of a space of scenarios have room for the largest team, and
rows without a robot are zeros.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from torch import Tensor

import baselines
from baselines.policies.base import Policy
from lissajous_env.envs.batch import Batch
from lissajous_env.envs.sides import padded
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import GONE, HIDDEN, WORKING
from lissajous_env.world.targets.motion import DRIFTING, FLEEING, WANDERING
from training.learned.checkpoint import prefixed, within
from training.learned.perception import axes_of, commanded_velocity, half_of, perceive, to_walls, wish_of
from training.settings import TrainingSettings

TRUTH = (
    *("target", "robot", "x", "y", "distance", "near", "right", "upper", "left", "lower"),
    *("observers", "other_distance", "flees", "x_velocity", "y_velocity"),
)
"""Numbers of a token of the critic: its kind; direction, and distance d as d / (1 + d) and as 1 - d [sight]; distances
to the walls [2 sights]; and of a target the other robots that have it in sight, at most 2, the distance of the nearest
of them, whether it flees, and its velocity while it drifts or wanders [top speed]."""
MOST_TARGETS = 16
"""Most targets of which the critic reads the places; it does not read those in later slots."""
_GOLDEN = 0.618034
"""Multiples of it are spread evenly over [0, 1): the shares of an episode after which the first ones of worlds end."""


class Step(NamedTuple):
    """Results of a step of W worlds, for their B = W N robots or places of robots."""

    reward: np.ndarray
    """(B,) reward without the terms that follow."""
    collided: np.ndarray
    """(B,) the term of the reward for collisions."""
    observed: np.ndarray
    """(B,) the term for targets in sight, which all robots share."""
    acted: np.ndarray
    """(B,) 1 for robots that were in the world before the step."""
    ended: np.ndarray
    """(B,) 1 for robots that were removed."""
    over: np.ndarray
    """(W,) True for worlds whose episode is over."""


class Rollout(NamedTuple):
    """T steps of B robots, as tensors.

    Attributes:
        rows: (T, B, ...) what the actor reads.
        truth: (T, B, ...) what the critic reads besides the robot's own numbers.
        actions: (T, B, A).
        likelihood: (T, B) logarithm of the density of the actions, but for a constant.
        acted: (T, B) 1 where a robot was in its world.
        begins: (T, B) 1 in the first step of an episode.
        memory: (B, memory) before the first step.
        advantages: (T, B).
        returns: (T, B) sums of discounted rewards, as the critic is to learn them.
        deviation: Standard deviation of the actions.
    """

    rows: list[Tensor]
    truth: list[Tensor]
    actions: Tensor
    likelihood: Tensor
    acted: Tensor
    begins: Tensor
    memory: Tensor
    advantages: Tensor
    returns: Tensor
    deviation: float


class Worlds:
    """W worlds of a scenario, or groups of scenarios of a space, and what actor and critic read in them."""

    def __init__(self, settings: TrainingSettings, worlds: int, seed: int):
        groups = settings.num_groups
        self.batch = Batch(
            settings.scenario, worlds, num_groups=groups, roles="robots", seed=seed, device=settings.device,
            threads=settings.threads, overrides=settings.lean_overrides,
        )  # fmt: skip
        self.side = self.batch.sides[0]
        self.count = worlds * self.side.slots
        self._base = settings.chosen_base
        self._bases: list[Policy] = []
        """Policies that the network corrects, one for each group; empty without any."""
        self._wishes: list[np.ndarray] = []
        """Actions (W, N, A) of these for the present states."""
        self.steps = self.batch.scenario.task.steps
        # Worlds of a group end together, so that it can draw its next scenario.
        shares = np.arange(1, 1 + (worlds if settings.space is None else groups)) * _GOLDEN % 1.0
        self._first = np.ceil(shares * self.steps).repeat(worlds // len(shares))
        self._left = self._first
        """Steps (W,) until the episode of a world ends: the first ones, `_first`, end at different times."""
        self.begin_anew(None)

    def begin_anew(self, seed: int | None) -> None:
        """Begin the first episode of all worlds, after a seed if it is not None."""
        self.batch.seed(seed)
        self.batch.reset()
        self._left, self._bases = self._first.copy(), []
        self._update_wishes()

    def rows(self) -> list[np.ndarray]:
        """Return own numbers (B, A), tokens (B, K, F) and presence (B, K) of what the robots perceive."""
        scenarios = [simulation.scenario for simulation in self.batch.simulations]
        wishes: Sequence[np.ndarray | None] = self._wishes or [None] * len(scenarios)
        parts = [perceive(*of) for of in zip(self._observations(), scenarios, wishes, strict=True)]
        return [self._flat(part) for part in zip(*parts, strict=True)]

    def truth(self) -> list[np.ndarray]:
        """Return tokens (B, K, F) and presence (B, K) for the critic, sightings (B,) and nearness (B,): see `truth`."""
        parts = []
        for tokens, present, own, near in map(truth, self.batch.simulations):
            # Scenarios of a space have different numbers of targets and robots.
            more = 0 if self.batch.space is None else MOST_TARGETS + self.side.slots - present.shape[2]
            wider = (0, 0), (0, 0), (0, more)
            parts.append((np.pad(tokens, (*wider, (0, 0))), np.pad(present, wider), own, near))
        return [self._flat(part) for part in zip(*parts, strict=True)]

    def step(self, actions: np.ndarray) -> Step:
        """Advance all worlds with actions (B, A) along the robots' axes; `begin` then begins episodes, if any."""
        batch, side = self.batch, self.side
        actions = actions.reshape(batch.num_worlds, side.slots, -1).clip(-1, 1).astype(np.float32)
        for group, simulation in enumerate(batch.simulations):
            if simulation.scenario.task.action == "velocity":
                part = actions[batch.worlds_of(group), : simulation.num_robots]
                observation = simulation.observation.numpy()
                wish = part[..., :2] * axes_of(observation, simulation.scenario)
                part[..., :2] = commanded_velocity(wish, observation, simulation.scenario)
        before = batch.rows(side)
        acted = (before.mask.astype(bool) & ~before.terminated.astype(bool)).reshape(-1).astype(np.float32)
        batch.step({"robot": actions})
        after, names = batch.rows(side), batch.simulation.reward_term_names
        collided, observed = (after.terms[..., names.index(name)].reshape(-1) for name in ("collision", "observation"))
        self._left -= 1
        reward = after.reward.reshape(-1) - collided - observed
        ended = after.terminated.reshape(-1).astype(np.float32) * acted
        return Step(reward, collided.copy(), observed.copy(), acted, ended, batch.over | (self._left <= 0))

    def begin(self, worlds: np.ndarray) -> None:
        """Begin episodes in the masked worlds, and compute the actions of the base in all of them."""
        if worlds.any():
            self.batch.reset(worlds)
            self._left[worlds] = self.steps
            for group, base in enumerate(self._bases):
                base.reset(worlds[self.batch.worlds_of(group)])
        self._update_wishes()

    def _update_wishes(self) -> None:
        """Compute the bases' actions for the present states; a group that plays another scenario has a new base."""
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
        self._wishes = [wish_of(*of) for of in zip(self._bases, self._observations(), strict=True)]

    def _observations(self) -> list[np.ndarray]:
        return [simulation.observation.numpy() for simulation in self.batch.simulations]

    def save_state(self) -> dict[str, np.ndarray]:
        """Copy everything that changes during steps, without a space of scenarios, by name."""
        arrays = prefixed("batch", self.batch.save_state()) | {"left": self._left.copy()}
        for base in self._bases:
            arrays |= prefixed("base", base.save_state()) | {"wish": self._wishes[0]}
        return arrays

    def load_state(self, saved: dict[str, np.ndarray]) -> None:
        """Resume from what `save_state` returned."""
        self._left = saved["left"].copy()
        self.batch.load_state(within("batch", saved))
        for base in self._bases:
            base.load_state(within("base", saved))
            self._wishes = [saved["wish"].copy()]

    def _flat(self, parts: Sequence[np.ndarray]) -> np.ndarray:
        """Join arrays (W, n, ...) of the groups to (B, ...), with zeros for places without a robot."""
        joined = np.concatenate([padded(part, self.side.slots - part.shape[1], np) for part in parts])
        return joined.reshape(self.count, *joined.shape[2:])


def truth(simulation: Simulation) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return what a critic reads of the true state, relative to each robot.

    Returns:
        Tokens (W, N, K, F) with the numbers `TRUTH`; presence (W, N, K), 1 where there is a token, else 0; the number
        of targets (W, N) that the robot has in sight and no other robot has; and its nearness (W, N) to others, a
        sum of 1 for each one that it touches, and less up to a gap of a body's diameter.
    """
    sight = np.float32(simulation.scenario.sight)
    axes = axes_of(simulation.observation.numpy(), simulation.scenario)
    robots = simulation.robots.position.numpy()[..., :2] / sight
    works = simulation.robots.status.numpy() == WORKING
    status = simulation.targets.status.numpy()
    there = (status != int(HIDDEN)) & (status != int(GONE))
    first = np.argsort(~there, axis=1, kind="stable")[:, :MOST_TARGETS]
    there, motion, speed, heading = (
        np.take_along_axis(of, first, 1)
        for of in (there, *(getattr(simulation.targets, name).numpy() for name in ("motion", "speed", "heading")))
    )
    targets = np.take_along_axis(simulation.targets.position.numpy() / sight, first[..., None], 1)
    pace = np.where((motion == int(DRIFTING)) | (motion == int(WANDERING)), speed / simulation.scenario.speed_unit, 0)
    count = there.shape[1]
    places = np.concatenate([targets, robots], axis=1)[:, None] * axes[:, :, None]
    offset = places - robots[:, :, None] * axes[:, :, None]
    distance = np.sqrt((offset**2).sum(axis=-1))
    others = ~np.eye(robots.shape[1], dtype=bool) & works[:, None]
    present = np.concatenate([np.broadcast_to(there[:, None], distance[..., :count].shape), others], axis=2)
    sighted = (distance[..., :count] < 1) & there[:, None] & works[..., None]
    observers = sighted.sum(axis=1, keepdims=True) - sighted
    nearest = np.where(works[..., None], distance[..., :count], np.inf)
    two = np.sort(np.pad(nearest, ((0, 0), (0, 1), (0, 0)), constant_values=1e4), axis=1)[:, :2]
    other = np.minimum(np.where(nearest <= two[:, :1], two[:, 1:], two[:, :1]), np.float32(1e4))
    tokens = np.zeros((*distance.shape, len(TRUTH)), np.float32)
    tokens[:, :, :count, 0], tokens[:, :, count:, 1] = 1, 1
    tokens[..., 2:4] = offset / np.maximum(distance, np.float32(1e-6))[..., None]
    tokens[..., 4], tokens[..., 5] = distance / (1 + distance), np.maximum(1 - distance, 0)
    tokens[..., 6:10] = to_walls(places, half_of(simulation.scenario), 2)
    tokens[:, :, :count, 10], tokens[:, :, :count, 11] = np.minimum(observers, 2), other / (1 + other)
    tokens[:, :, :count, 12] = (motion == int(FLEEING))[:, None]
    velocity = pace[..., None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    tokens[:, :, :count, 13:] = velocity[:, None] * axes[:, :, None]
    own = (sighted & (observers == 0)).sum(axis=-1).astype(np.float32)
    gap = distance[..., count:] / np.float32(2 * simulation.scenario.robot.radius / sight) - 1
    near = np.where(others & works[..., None], np.clip(1 - gap, 0, 1), 0).sum(axis=-1)
    return tokens * present[..., None], present.astype(np.float32), own, near.astype(np.float32)
