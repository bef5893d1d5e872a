"""The sequence of scenarios that each group of a batch plays, drawn from a space by a seed."""

import hashlib
import os
from collections.abc import Callable

from lissajous_env.parameters.named_spaces import scenario_space
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.space import ScenarioSpace
from lissajous_env.settings.checks import LAST_SEED, whole_number

_MOST_TRIES = 10_000
"""Limit on the seeds that are tried for a scenario with a group's number of robots."""


class Draws:
    """Scenarios of a split for groups of worlds: those of a group depend on the seed and on its number alone.

    Args:
        space: A `ScenarioSpace`, or the name or file of one.
        split: Split or shift from which scenarios are drawn.
        seed: Whole number from 0 to 2^31 - 1.
        change: Function that returns a drawn scenario with fields changed, but for the number of robots.

    Raises:
        ValueError: there is no such space or split, or the seed is out of its range.
    """

    def __init__(
        self,
        space: str | os.PathLike | ScenarioSpace,
        split: str = "train",
        seed: int = 0,
        change: Callable[[Scenario], Scenario] | None = None,
    ):
        self.seed, self._change = whole_number("seed", seed, 0, LAST_SEED), change
        of = scenario_space(space)
        next(of.seeds(split))
        self.split = None if split in of.shifts else split
        self.space = of.shifted(split) if split in of.shifts else of
        self.counts: dict[int, int] = {}
        """Number of draws of each group so far, those included that were not used."""
        self.robots: dict[int, int] = {}
        """Number of robots of each group, that of its first scenario."""

    def next(self, group: int, fits: Callable[[Scenario], bool] | None = None) -> tuple[Scenario, int]:
        """Return the next scenario of a group, and a seed for its worlds.

        Args:
            group: Number of the group.
            fits: Function that returns False for scenarios to skip; by default those with another number of robots than
                the first of the group.

        Raises:
            ValueError: the space has no other scenario with this number of robots, or none that fits.
        """
        for _ in range(_MOST_TRIES):
            draw = self.counts[group] = self.counts.get(group, -1) + 1
            seed = self._hashed(f"scenario/{group}/{draw}")
            if self.split is not None and self.space.split_of(seed) != self.split:
                continue
            drawn = self.space.sample(seed)
            robots = self.robots.setdefault(group, drawn.num_robots)
            if fits is None and drawn.num_robots != robots:
                continue  # before it is changed, which may take long
            made = self._changed(drawn)
            if fits is None or fits(made):
                return made, self._seed_of_episodes(group)
        if fits is not None:
            raise ValueError(f"space {self.space.name} must contain more scenarios of the largest size, got none")
        raise ValueError(
            f"space {self.space.name} must contain more scenarios with {self.robots[group]} robots, got none"
        )

    def latest(self, group: int) -> tuple[Scenario, int]:
        """Return the latest scenario of a group, and the seed for its worlds, again."""
        drawn = self.space.sample(self._hashed(f"scenario/{group}/{self.counts[group]}"))
        return self._changed(drawn), self._seed_of_episodes(group)

    def _changed(self, drawn: Scenario) -> Scenario:
        return drawn if self._change is None else self._change(drawn)

    def _seed_of_episodes(self, group: int) -> int:
        return self._hashed(f"episodes/{group}/{self.counts[group]}") // 2

    def _hashed(self, what: str) -> int:
        digest = hashlib.sha256(f"{self.space.name}/{self.seed}/{what}".encode()).digest()
        return int.from_bytes(digest[:8]) % LAST_SEED
