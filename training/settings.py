"""The settings of a training of robots, which are the command line of `lissajous train`, and of one of rogues."""

import dataclasses
import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal

import tyro

from baselines.policies import registry
from baselines.policies.registry import as_factory
from lissajous_env import Scenario, ScenarioSpace
from lissajous_env.console.terminal import plain
from lissajous_env.device.devices import as_device
from lissajous_env.parameters import named
from lissajous_env.parameters.assumptions import quietly
from lissajous_env.parameters.rogues import AGENTS
from lissajous_env.settings.checks import Checked, number, whole
from lissajous_env.wording import require
from lissajous_env.world.columns import DETECTION_RATE, OBSERVED, task_score

NO_BASE = "none"
"""Value of `base` for a network that corrects no policy."""
VALIDATION_SPLIT = "validation"
"""Split of a space for validations; a training draws from the split `train`, and nothing uses the split `test`."""
MAX_VALIDATION_SCENARIOS = 16
"""Largest number of scenarios of a validation, the first ones of their split."""


@dataclass(frozen=True)
class SharedSettings(Checked):
    """Settings of every training, of robots or of rogues."""

    scenario: str = "watch"
    """Scenario to train on. For robots also a space of scenarios: training draws from its split train, and validations
    play the first scenarios of its split validation."""
    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Path("runs/train")
    """Folder for the results; the same command resumes from its last checkpoint."""
    seed: int = whole(0, 0, 999)
    """Seed of the worlds, initial weights and exploration."""
    episodes: int = whole(128, 1, 65_536)
    """Episodes per validation; for a space, of all its scenarios together."""
    device: str = "cpu"
    """Device of the worlds: `cpu`, `cuda` or `cuda:k`; the networks of robots are on the CPU."""
    threads: int | None = whole(None, 1, 1024)
    """CPU threads; by default all cores for the worlds and one for the networks, whose threads wait for each other if
    another program uses a core."""
    overrides: Annotated[Mapping[str, Any], tyro.conf.Suppress] = field(default_factory=dict)
    """Overrides of scenario fields, such as {"task.reward_collision": -5.0}."""
    may_change: ClassVar[tuple[str, ...]] = ("out", "threads", "episodes")
    """Settings that may change when a training is resumed."""

    def _check_together(self) -> None:
        as_device(self.device)
        object.__setattr__(self, "out", Path(self.out))


@dataclass(frozen=True)
class TrainingSettings(SharedSettings, part="training"):
    """Settings of a training of one policy, which all robots share."""

    steps: int = whole(4_000_000, 1, 10**15)
    """Robot steps of PPO, summed over all robots and worlds."""
    worlds: int = whole(64, 1, 1_000_000)
    """Environments that are stepped together; for a space, a multiple of `groups`."""
    groups: int = whole(16, 1, 10_000)
    """Groups of worlds for a space, each of which plays one scenario at a time. When the episodes of a group end, it
    plays the next scenario. Used only for a space."""
    base: str | None = None
    """Classical policy whose actions the network reads and corrects, and with which validations are compared. By
    default greedy-herd, divided-pursuit or index-learned if actions are velocities; for cars that steer and
    differential drives, arc-mpcc, or partition-repair if targets appear unseen; for points, kuramoto. With none, the
    network corrects no policy, and validations are compared with that default where it can play."""
    critic: Literal["central", "own"] = "central"
    """Input of the critic: the true state of robots and at most 16 targets (MAPPO), or that of the actor (IPPO)."""
    features: int = whole(48, 1, 65_536)
    """Number of features of a token."""
    heads: int = whole(3, 0, 64)
    """Number of attention heads with which a robot pools its tokens; 0 for their mean."""
    hidden: int = whole(128, 1, 65_536)
    """Size of the hidden layers."""
    rollout: int = whole(25, 2, 1_000_000)
    """Steps of each world between updates; a minibatch needs two robot steps for the deviation of its advantages."""
    minibatch: int = whole(512, 2, 10**9)
    """Robot steps per minibatch."""
    epochs: int = whole(4, 1, 10_000)
    """Passes over each rollout."""
    learning_rate: float = number(1e-3, 1e-12, 1)
    """Initial learning rate; it decreases linearly to a twentieth."""
    clip: float = number(0.2, 1e-6, 10)
    """Clipping of the ratio of the likelihoods of an action."""
    divergence: float = number(0.06, 1e-6, 1e6)
    """Divergence (approximate KL) from the policy of a rollout above which it no longer updates the actor."""
    gamma: float = number(0.985, 0, 1)
    """Discount factor per step."""
    gae_lambda: float = number(0.9, 0, 1)
    """Lambda of generalized advantage estimation."""
    noise: float = number(0.3, 1e-6, 10)
    """Standard deviation of the actions at the beginning."""
    noise_end: float = number(0.08, 1e-6, 10)
    """Standard deviation of the actions at the end."""
    correlation: float = number(0.8, 0, 0.999)
    """Correlation of the noise of successive actions of a robot."""
    credit: float = number(1.0, 0, 1)
    """Share of the reward for targets in sight that a robot receives for those that no other robot has in sight; the
    rest is the team's reward."""
    collisions: float | None = number(None, 0, 1e6)
    """Collisions per episode, with the noise of exploration, above which their cost rises, and below which it falls. By
    default four fifths of those, without noise, of the policy with which validations are compared; 0 without one."""
    penalty: float = number(0.3, 0.01, 100)
    """Factor of the scenario's reward for collisions at the beginning."""
    evaluate_every: int = whole(250_000, 1, 10**15)
    """Robot steps between validations, each of which writes a checkpoint."""
    # The schedules of noise and learning rate depend on `steps`.
    may_change = (*SharedSettings.may_change, "steps", "evaluate_every")

    def _check_together(self) -> None:
        super()._check_together()
        if self.space is not None:
            self._require(self.worlds % self.groups == 0, "worlds", f"must be a multiple of groups ({self.groups})")
        if self.rival is not None:
            with quietly():  # the scenario has given its warnings
                registry.resolve(self.rival).check(self.make_scenario())

    @cached_property
    def space(self) -> ScenarioSpace | None:
        """Space of scenarios to train on, or None for one scenario.

        Raises:
            ValueError: a split of a space is given.
        """
        if named.space_and_split(self.scenario) is None:
            return None
        rule = f"must be the name of a space without a split: a training uses its splits train and {VALIDATION_SPLIT}"
        require(":" not in self.scenario, "scenario", rule, self.scenario)
        return named.scenario_space(self.scenario)

    @property
    def corrected_base(self) -> str | None:
        """Policy whose actions the network corrects; None without one."""
        return None if self.base == NO_BASE else self.rival

    @property
    def rival(self) -> str | None:
        """Policy with which validations are compared, the base or its default; None if there is no default."""
        scenario = self.make_scenario()
        if self.base not in (None, NO_BASE):
            return self.base
        if scenario.task.action == "velocity":
            rules = {OBSERVED: "greedy-herd", DETECTION_RATE: "divided-pursuit"}
            return rules.get(task_score(scenario), "index-learned")
        car = "partition-repair" if scenario.targets.entry == "unseen" else "arc-mpcc"
        return {"car": car, "differential": car, "curve": "kuramoto"}.get(scenario.robot.kind)

    def make_scenario(self) -> Scenario:
        """Return the scenario that a checkpoint contains: of a space, the first one of the validations."""
        return self._make_scenarios(self.overrides, 1)[0]

    def make_validation_scenarios(self) -> list[Scenario]:
        """Return the scenarios of the validations, with `lean_overrides`."""
        return self._make_scenarios(self.lean_overrides, MAX_VALIDATION_SCENARIOS)

    def _make_scenarios(self, overrides: Mapping[str, Any], count: int) -> list[Scenario]:
        if self.space is None:
            return [named.scenario(self.scenario, **overrides)]
        with quietly():
            return list(itertools.islice(self.space.overridden(overrides).scenarios(VALIDATION_SPLIT), count))

    @cached_property
    def lean_overrides(self) -> dict[str, Any]:
        """Overrides of the worlds: those of the user, and those that remove what a training does not need.

        These are the grids that neither the reward nor the targets nor extensions use and, if the reward is for targets
        in sight, the rewards for first detections, which would outweigh it.
        """
        scenario, fields = self.make_scenario(), dict(self.overrides)
        task = scenario.task
        if task.reward_observation > 0:
            fields |= {"task.reward_detection": 0.0, "task.reward_waiting": 0.0}
        if not (task.reward_idleness or scenario.extensions):
            fields["task.grid"] = None
        if not (task.reward_contamination or task.conservative or scenario.targets.rogues or scenario.extensions):
            fields["task.contamination"] = None
        return fields

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, as written into a checkpoint."""
        return plain(self) | {"base": self.corrected_base or NO_BASE}


@dataclass(frozen=True)
class RogueTraining(SharedSettings, part="training"):
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

    def _check_together(self) -> None:
        if "rogues" in self.overrides or "targets.rogues" in self.overrides:
            raise ValueError("targets.rogues must be omitted if rogues are trained")
        super()._check_together()
        as_factory(self.against)(self.make_scenario(), 1, self.device)  # raises for an unknown or unfit policy

    @classmethod
    def from_common(cls, common: TrainingSettings, **more: Any) -> "RogueTraining":
        """Return the settings with those of `common` that both kinds of training share, and `more`.

        Raises:
            ValueError: another setting of `common` is not the default.
        """
        shared = {option.name: getattr(common, option.name) for option in dataclasses.fields(SharedSettings)}
        for option in dataclasses.fields(common):
            value = getattr(common, option.name)
            names = ", ".join(shared).replace("overrides", "set")  # as on the command line
            rule = f"must be omitted if rogues are trained, which share only {names}"
            require(option.name in shared or value == option.default, option.name, rule, value)
        return cls(**shared, **more)

    def make_scenario(self, rogues: str = AGENTS) -> Scenario:
        """Return the scenario with `starts` rogues per episode that `rogues` controls, and only the necessary grids."""
        scenario = named.scenario(self.scenario, **self.overrides)
        grids = {"task.grid": None} | ({} if scenario.task.conservative else {"task.contamination": None})
        grids = {} if scenario.extensions else grids  # which may read them
        first = self.starts // 2
        starts = {"targets.count": first, "targets.arrival_rate": (self.starts - first) / scenario.task.duration}
        speed = {"targets.speed_limit": scenario.rogue_speed}
        return named.scenario(scenario, rogues=rogues, **grids, **starts, **speed)

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, as written into a checkpoint."""
        return plain(self) | {"side": "rogues"}
