"""Settings of a training of rogues: `lissajous train --side rogues`."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from baselines.exploitability.survival import with_starts
from baselines.policies.factories import named
from lissajous_env import Scenario
from lissajous_env import scenario as make_scenario
from lissajous_env.device.devices import as_device
from lissajous_env.parameters.rogues import AGENTS
from training.settings import TrainingSettings

_MOST = {"rounds": 10_000, "steps": 10**15, "worlds": 65_536, "evaluation_episodes": 65_536, "evaluate_every": 10**15}
_LEAST = {"rounds": 0, "steps": 0}
CHANGES_NOTHING = ("out", "threads", "evaluation_episodes")
"""Settings that may change when a training is resumed."""
SHARED = ("scenario", "seed", "out", "layers", "activation", "gamma", "evaluation_episodes", "device", "threads")
"""Options of `lissajous train` that trainings of robots and of rogues have in common, with the same defaults."""


@dataclass(frozen=True)
class RogueTraining:
    """Settings of a training of rogues against the robots of a policy, which does not learn."""

    scenario: str = "intruders"
    """Scenario of the game."""
    against: str = "kuramoto-mpcc"
    """Policy of the robots: a name, the folder of a checkpoint, or several of these joined by `+`, among which the
    environments are divided."""
    rounds: int = 48
    """Rounds of imitation of a rogue with foresight, each with an episode per world."""
    steps: int = 0
    """Rogue steps of PPO after the imitation, summed over all rogues."""
    starts: int = 96
    """Rogues per episode, each with a start of its own."""
    seed: int = 0
    """Seed of the worlds, initial weights and exploration."""
    out: Path = Path("runs/train")
    """Folder for the results."""
    worlds: int = 8
    """Environments that are stepped together."""
    layers: tuple[int, ...] = (64, 64)
    """Sizes of the hidden layers."""
    activation: str = "relu"
    """Activation between layers."""
    gamma: float = 0.99
    """Discount factor per step."""
    evaluate_every: int = 250_000
    """Rogue steps of PPO between evaluations, each of which writes a checkpoint."""
    evaluation_episodes: int = 64
    """Episodes per evaluation."""
    device: str = "cpu"
    """Warp device of the worlds."""
    threads: int | None = None
    """CPU threads; all cores by default."""
    overrides: Mapping[str, Any] = field(default_factory=dict)
    """Overrides of scenario fields."""

    def __post_init__(self) -> None:
        for name, most in _MOST.items():
            least, value = _LEAST.get(name, 1), getattr(self, name)
            if not least <= value <= most:
                raise ValueError(f"{name} must be from {least} to {most:,}, got {value!r}")
        if self.rounds == 0 and self.steps == 0:
            raise ValueError("steps must be at least 1 if there are no rounds of imitation, got 0")
        if "rogues" in self.overrides or "targets.rogues" in self.overrides:
            raise ValueError("targets.rogues must be omitted if rogues are trained")
        as_device(self.device)
        self.learner()
        named(self.against)(self.make_scenario(), 1, self.device)  # raises for an unknown or unfit policy

    @classmethod
    def from_common(cls, common: TrainingSettings, **more: Any) -> "RogueTraining":
        """Return the settings for the options that the trainings of robots and rogues share.

        Raises:
            ValueError: another option is not as by default.
        """
        for each in dataclasses.fields(common):
            default = each.default if each.default is not dataclasses.MISSING else {}
            if each.name not in (*SHARED, "overrides") and getattr(common, each.name) != default:
                rule = f"must be omitted if rogues are trained, which share only {', '.join(SHARED)}"
                raise ValueError(f"{each.name} {rule}; got {getattr(common, each.name)!r}")
        return cls(**{name: getattr(common, name) for name in (*SHARED, "overrides")}, **more)

    def home_scenario(self) -> Scenario:
        """Return the scenario with its overrides."""
        return make_scenario(self.scenario, **self.overrides)

    def make_scenario(self, rogues: str = AGENTS) -> Scenario:
        """Return the scenario of the games, with `starts` rogues per episode, and only the grids that they need."""
        made = self.home_scenario()
        needs_grid = rogues == "hide" or made.task.conservative
        made = make_scenario(made, **{"task.grid": None} | ({} if needs_grid else {"task.contamination": None}))
        return with_starts(made, rogues, self.starts)

    def learner(self) -> TrainingSettings:
        """Return the settings of PPO."""
        return TrainingSettings(
            self.scenario,
            seed=self.seed,
            out=self.out,
            base="none",
            teacher="none",
            rivals=(),
            layers=self.layers,
            activation=self.activation,  # type: ignore[arg-type]
            gamma=self.gamma,
            learning_rate=3e-4,
            rollout=64,
            batch_size=2048,
            epochs=3,
            log_std=-1.5,
            log_std_end=-2.5,
            device=self.device,
            threads=self.threads,
            overrides=self.overrides,
        )

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, as written into a checkpoint."""
        kept = {each.name: getattr(self, each.name) for each in dataclasses.fields(self)}
        plain = {name: list(value) if isinstance(value, tuple) else value for name, value in kept.items()}
        return plain | {"side": "rogues", "out": str(self.out), "overrides": dict(self.overrides)}

    def differences(self, stored: Mapping[str, Any]) -> list[str]:
        """Return the settings that prevent a training from resuming what is stored, each in words."""
        return [
            f"{name} = {stored.get(name)!r} there, {value!r} here"
            for name, value in self.to_dict().items()
            if name not in CHANGES_NOTHING and stored.get(name) != value
        ]
