"""Scenarios of a split for environments whose spaces stay the same: they fit the largest team of all."""

import itertools
import os
from collections.abc import Mapping
from typing import Any

from lissajous_env.parameters import named
from lissajous_env.parameters.draws import Draws
from lissajous_env.parameters.rogues import AGENTS
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.space import ScenarioSpace
from lissajous_env.wording import shown
from lissajous_env.world.observation import layout

LOOKED_AT = 64
"""Number of scenarios of a split, its first ones, whose largest team is the largest of an environment."""


class Sampler:
    """Draws scenarios of a split with rows of one size, and no more robots and target slots than its first scenarios.

    Args:
        space: Name of a space or SPACE:SPLIT, where SPLIT is a split or a shift, by default `train`; or a
            `ScenarioSpace`.
        overrides: Fields that are given instead of drawn, as for `ScenarioSpace.overridden`.
        max_cycles: Number of steps of an episode, instead of `task.duration`.

    Raises:
        UnknownSettingError: an unknown field.
        ValueError: there is no such space or split, an invalid value, rogues that are agents, or scenarios with rows or
            actions of different sizes.
    """

    def __init__(
        self, space: str | os.PathLike | ScenarioSpace, overrides: Mapping[str, Any], max_cycles: int | None = None
    ):
        if (found := named.space_and_split(space)) is None:
            raise ValueError(f"space must be a space of scenarios, as SPACE or SPACE:SPLIT, got {shown(space)}")
        self.space, self.split = found[0].overridden(overrides), found[1]
        self._max_cycles = max_cycles
        first = [self._changed(made) for made in itertools.islice(self.space.scenarios(self.split), LOOKED_AT)]
        self.first = first[0]
        """First scenario of the split."""
        self.largest = max(first, key=lambda made: made.num_robots)
        """First scenario with the largest team."""
        self.most_robots = self.largest.num_robots
        """Number of robots of the largest team."""
        self.most_targets = max(made.target_capacity for made in first)
        """Largest number of target slots."""
        for made in first:
            self._check(made)

    def draws(self, seed: int) -> Draws:
        """Return the sequences of scenarios that belong to a seed."""
        return Draws(self.space, self.split, seed, self._changed)

    def next(self, draws: Draws, group: int = 0) -> tuple[Scenario, int]:
        """Return the next scenario of a group that fits, and a seed for its worlds.

        Raises:
            ValueError: none fits, or the scenario has rows or actions of another size than the others.
        """
        made, seed = draws.next(group, self._fits)
        self._check(made)
        return made, seed

    def _changed(self, made: Scenario) -> Scenario:
        """Return a drawn scenario with the number of steps of an episode, and every derived field."""
        return named.with_cycles(made, self._max_cycles).resolve()

    def _fits(self, made: Scenario) -> bool:
        return made.num_robots <= self.most_robots and made.target_capacity <= self.most_targets

    def _check(self, made: Scenario) -> None:
        """Raise ValueError for a scenario whose rows or actions differ in size from those of the others."""
        if made.targets.rogues == AGENTS:
            rule = "must be None or a scripted rogue in an environment of a space"
            raise ValueError(f"targets.rogues {rule}, got {AGENTS} in {made.name}")
        sizes = [(layout(each).names, each.action_names) for each in (self.first, made)]
        if sizes[0] != sizes[1]:
            rule = "must have rows and actions of one size"
            raise ValueError(f"scenarios of a space {rule}, got others in {self.first.name} and {made.name}")
