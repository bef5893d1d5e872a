"""Settings of a training of rogues: `lissajous train --side rogues`."""

import dataclasses
from dataclasses import dataclass
from typing import Any

from baselines.policies.factories import as_factory
from lissajous_env import Scenario
from lissajous_env import scenario as make_scenario
from lissajous_env.console.terminal import plain
from lissajous_env.device.devices import as_device
from lissajous_env.parameters.rogues import AGENTS
from lissajous_env.settings.checks import is_whole, rows, whole
from training.settings import SharedSettings, TrainingSettings

MAY_CHANGE = ("out", "threads", "episodes")
"""Settings that may change when a training is resumed."""


@dataclass(frozen=True)
class RogueTraining(SharedSettings, with_defaults=False):
    """Settings of a training of rogues against robots that do not learn."""

    scenario: str = "intruders"
    """Scenario of the game."""
    against: str = "kuramoto-mpcc"
    """Policy of the robots: a name, or the folder of a checkpoint."""
    rounds: int = whole(48, 1, 10_000)
    """Rounds of imitation of a rogue with foresight, each with an episode per world."""
    starts: int = whole(96, 2, 4096)
    """Rogues per episode on average, each with a start of its own; half of them are present from the beginning."""
    worlds: int = whole(8, 1, 65_536)
    """Environments that are stepped together."""
    layers: tuple[int, ...] = rows(
        (64, 64), "must be whole numbers of at least 1", lambda size: size if is_whole(size) and size >= 1 else None
    )
    """Sizes of the hidden layers."""

    def _check_together(self) -> None:
        if "rogues" in self.overrides or "targets.rogues" in self.overrides:
            raise ValueError("targets.rogues must be omitted if rogues are trained")
        as_device(self.device)
        as_factory(self.against)(self.make_scenario(), 1, self.device)  # raises for an unknown or unfit policy

    @classmethod
    def from_common(cls, common: TrainingSettings, **more: Any) -> "RogueTraining":
        """Return the settings with those of `common` that both kinds of training share, and `more`.

        Raises:
            ValueError: another setting of `common` is not the default.
        """
        shared = {option.name: getattr(common, option.name) for option in dataclasses.fields(SharedSettings)}
        for option in dataclasses.fields(common):
            if option.name not in shared and getattr(common, option.name) != option.default:
                rule = f"must be omitted if rogues are trained, which share only {', '.join(shared)}"
                raise ValueError(f"{option.name} {rule}; got {getattr(common, option.name)!r}")
        return cls(**shared, **more)

    def make_scenario(self, rogues: str = AGENTS) -> Scenario:
        """Return the scenario with `starts` rogues per episode that `rogues` controls, and only the necessary grids."""
        scenario = make_scenario(self.scenario, **self.overrides)
        needs_grid = scenario.task.conservative
        scenario = make_scenario(scenario, **{"task.grid": None} | ({} if needs_grid else {"task.contamination": None}))
        first = self.starts // 2
        starts = {"targets.count": first, "targets.arrival_rate": (self.starts - first) / scenario.task.duration}
        return make_scenario(scenario, rogues=rogues, **starts, **{"targets.speed_limit": scenario.rogue_speed})

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, as written into a checkpoint."""
        return plain(self) | {"side": "rogues"}
