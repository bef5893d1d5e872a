"""The extent of a search: plans that are tried, which does not depend on the speed of the machine, or seconds."""

import dataclasses
from dataclasses import dataclass

from baselines.planning.request import check_time
from lissajous_env.settings.checks import whole_number

PLANS = 200
"""Default number of plans that are tried: about a minute on two cores for five cars in a hall of 40 m x 25 m."""
_LEAST = 1.0
"""Shortest duration of a search [s]."""
_FINALS, _FEWEST_FINALS = 5, 3
"""Plans that are tried for one that is played to the end, and plans that are played to the end at least."""


@dataclass(frozen=True)
class Budget:
    """The extent of a search: a number of plans, or a duration in its place.

    Raises:
        ValueError: a value is out of its range, or both are given.
    """

    plans: int = PLANS
    """Plans that are tried; a fifth as many of the best ones are then played to the end."""
    seconds: float | None = None
    """Duration [s]; None for a search that ends with its number of plans."""

    def __post_init__(self) -> None:
        whole_number("plans", self.plans)
        check_time("seconds", self.seconds, _LEAST)

    @classmethod
    def of(cls, plans: int | None, seconds: float | None) -> "Budget":
        """Return the budget of a number of plans or of a duration [s], the default if neither is given."""
        if plans is not None and seconds is not None:
            raise ValueError(f"plans must be omitted if seconds is given, got {plans} and {seconds:g} s")
        return cls(PLANS if plans is None else plans, seconds)

    def part(self, spent: float, count: int) -> "Budget":
        """Return the budget of the next of `count` searches, which share the seconds that are not spent [s]."""
        if self.seconds is None:
            return self
        return dataclasses.replace(self, seconds=max((self.seconds - spent) / count, _LEAST))

    @property
    def finals(self) -> int:
        """Return the number of plans that are played to the end, besides the defaults."""
        return max(_FEWEST_FINALS, self.plans // _FINALS)
