"""The settings of a training: one dataclass, which is the command line of `lissajous train`."""

import dataclasses
import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import tyro

from baselines.policies import registry
from baselines.policies.settings import PolicySettings
from lissajous_env import Scenario, ScenarioSpace
from lissajous_env import scenario as make_scenario
from lissajous_env.device.devices import as_device
from lissajous_env.settings.checks import Checked, is_finite, is_whole, number, rows, whole
from lissajous_env.wording import shown
from training import scenarios
from training.learned import checkpoint
from training.learned.card import CONSTANTS
from training.learned.policy import find

CHANGES_NOTHING = (
    "steps",
    "out",
    "threads",
    "evaluation_episodes",
    "evaluation_scenarios",
    "rivals",
)
"""Settings that may change when a training is resumed: they do not affect what is learned from a step."""
_LEFT_OUT = ("base_parameters", "initial_output")
"""Settings that a checkpoint names only if they are given."""
_PAPERS_METHODS = {"car": ("kuramoto-mpcc", "kuramoto-gvf"), "curve": ("kuramoto",)}
_GROUPS, _GROUP_SIZE = 32, 16
"""Default number of scenarios of a space that are played at the same time, and of the worlds of each."""
_PATROLS = {"car": ("sweep",), "curve": ("kuramoto",)}
"""By kind of robot: the best base for the scenarios of a space."""
_TEACHERS = {"car": ("arc-mpcc", "arc-gvf"), "curve": ("kuramoto",)}
"""By kind of robot, in order of preference: contouring control follows only Lissajous curves, the vector field any."""


def sizes_of_layers() -> Any:
    """Declare the sizes of hidden layers."""
    return rows((64, 64), "must be whole numbers from 1 to 65,536", lambda size: _within(1, size, 65_536, whole=True))


def _within(low: float, value: Any, high: float, whole: bool = False) -> Any:
    """Return a number if it is in a range, and a whole one where it must be; None otherwise."""
    right = is_whole(value) if whole else is_finite(value)
    return value if right and low <= value <= high else None


def parse_numbers(name: str, entries: Iterable[str]) -> dict[str, float]:
    """Parse numbers by name, as in ("cruise=1.9", "inset=0.1").

    Raises:
        ValueError: an entry is not of this form, or a name is given twice.
    """
    numbers: dict[str, float] = {}
    for entry in entries:
        word, equals, text = entry.partition("=")
        try:
            numbers[word] = float(text) if equals and word not in numbers else math.nan
        except ValueError:
            numbers[word] = math.nan
        if not math.isfinite(numbers[word]):
            raise ValueError(f"{name} must be given as name=number, each name once, got {shown(entry)}")
    return numbers


@dataclass(frozen=True)
class TrainingSettings(Checked):
    """Settings of a training. The defaults suit two cores of a laptop."""

    scenario: str = "intruders"
    """Scenario to train on, or a space of scenarios: training draws from its split train, and evaluations play the
    first scenarios of its split validation."""
    steps: int = whole(100_000_000, 1, 10**15)
    """Robot steps to train for, summed over all robots and worlds. The default takes about 40 minutes on two cores; a
    few million show whether a scenario can be learned."""
    worlds: int | None = whole(None, 1, 1_000_000)
    """Environments that are stepped together. By default 128 with a base, which takes most of the time, so that
    updates are more frequent; otherwise 512. For a space of scenarios, sixteen for each of `groups`."""
    groups: int | None = whole(None, 1, 10_000)
    """Number of scenarios of a space that are played at the same time, each in an equal part of the worlds. When the
    episodes of a group end, it plays the next scenario. By default 32 or, if that does not divide `worlds`, the largest
    smaller number that does. Used only for a space."""
    short: float = number(0.0, 0, 1)
    """Fraction of the worlds whose episodes end after `short_time`; a larger one trains the beginning of episodes more
    often."""
    short_time: float = number(3.0, 1e-6, 1e6, "s")
    """Duration of the episodes of these worlds [s]."""
    seed: int = whole(0, 0, 2047)
    """Seed of the worlds, initial weights and exploration."""
    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Path("runs/train")
    """Folder for the results; the same command resumes from its last checkpoint."""
    start: Annotated[str | None, tyro.conf.arg(metavar="CHECKPOINT")] = None
    """Checkpoint folder, or name of an included policy, whose network is the initial one."""
    base: str | None = None
    """Classical policy to whose action the network's output is added; `none`: the network acts alone. By default the
    base of `start`, or, if nothing is imitated, the paper's method: kuramoto-mpcc for cars (kuramoto-gvf on a curve
    of harmonics), kuramoto for points; for a space of scenarios, sweep for cars. The policy then starts as good as the
    base."""
    base_parameters: Annotated[tuple[str, ...], tyro.conf.arg(metavar="NAME=VALUE ...", help_behavior_hint="")] = ()
    """Changed parameters of the base, as in cruise=1.9 inset=0.1; by default those of the base of `start`, if the base
    is that one."""
    residual: float = number(0.5, 1e-6, 2)
    """Factor of the network's output if there is a base: 0.5 lets it change an action by half of its range."""
    initial_output: tuple[float, ...] = rows((), "must be numbers from -1 to 1", lambda value: _within(-1, value, 1))
    """Mean of the network's output at the start, a number for each component of an action; about 0 by default. A base
    that controls a speed compensates small outputs, so from 0 a policy does not learn to drive faster than the base.
    """
    teacher: str | None = None
    """Policy to imitate; `none` disables imitation. By default none with `start` or a base, otherwise kuramoto for
    points and arc-mpcc (arc-gvf on a curve of harmonics) for cars."""
    imitation_steps: int = whole(1_000_000, 0, 10**15)
    """Robot steps of imitation before ppo, counted in `steps`; as many as these for imitation alone. The teacher is
    imitated in the states that the learned policy reaches."""
    inputs: tuple[str, ...] = ()
    """Names of the observation's entries that the network reads; all by default."""
    critic_steps: int = whole(0, 0, 10**15)
    """Robot steps of ppo in which only the critic learns, so that its initial errors do not spoil a policy given by
    `start`."""
    layers: tuple[int, ...] = sizes_of_layers()
    """Sizes of the hidden layers."""
    learning_rate: float = number(7e-4, 1e-12, 1)
    """Initial learning rate; it decreases linearly to 1/50 of this."""
    rollout: int = whole(64, 1, 1_000_000)
    """Steps of each world between updates."""
    batch_size: int = whole(8192, 2, 10**9)
    """Rows per minibatch."""
    epochs: int = whole(2, 1, 10_000)
    """Passes over each rollout."""
    gamma: float = number(0.99, 0, 1)
    """Discount factor per step."""
    gae_lambda: float = number(0.95, 0, 1)
    """Lambda of generalized advantage estimation."""
    averaging: float = number(0.0, 0, 0.999999)
    """Decay of the exponential moving average of the weights; if above 0, the averaged policy is saved."""
    log_std: float = number(-0.7, -20, 2)
    """Logarithm of the initial standard deviation of the exploration noise."""
    log_std_end: float | None = -1.2
    """Logarithm of this standard deviation at the end of the training, to which it decreases linearly; None: the
    deviation is learned. Less noise at the end matters because a saved policy acts without noise."""
    noise_steps: int | None = whole(None, 1, 10**9)
    """Steps for which a robot uses the same random function of its inputs as noise (gSDE); 1: independent noise in
    each step. By default 30 with a base, otherwise 1."""
    caution: float = number(3.0, 0, 1e6)
    """Factor of `task.reward_collision` while ppo learns: 3 makes collisions cost three times as much."""
    evaluate_every: int = whole(1_000_000, 1, 10**15)
    """Robot steps between evaluations, each of which writes a checkpoint."""
    evaluation_episodes: int = whole(64, 1, 65_536)
    """Episodes per evaluation; their seeds, from 20,000, do not occur in training. For a space, all scenarios of an
    evaluation together: an equal number of each, at least one."""
    evaluation_scenarios: int = whole(16, 1, 10_000)
    """Scenarios per evaluation for a space, the first ones of its split validation. Used only for a space."""
    rivals: tuple[str, ...] | None = None
    """Policies to compare the evaluations with; by default the paper's method, the best classical policy according to a
    rehearsal before the training, and the base."""
    device: str = "cpu"
    """`cpu`, `cuda` or `cuda:k` for CUDA device k."""
    threads: int | None = whole(None, 1, 1024)
    """CPU threads; all cores by default."""
    overrides: Annotated[Mapping[str, Any], tyro.conf.Suppress] = field(default_factory=dict)
    """Overrides of scenario fields, such as {"task.reward_collision": -5.0}."""

    @property
    def part(self) -> str:
        """Name of these settings in error messages."""
        return "training"

    def _check_together(self) -> None:
        end = self.log_std_end
        self._require(end is None or -20 <= end <= 2, "log_std_end", "must be from -20 to 2, or None")
        self._require(self.start != "", "start", "must not be empty")
        if self.initial_output:
            size = self.make_scenario().action_size
            self._require(len(self.initial_output) == size, "initial_output", f"must be {size} numbers")
            self._require(self.start is None, "initial_output", "must be omitted with start")
        alone = self.imitated is None or self.base in (None, "none")
        self._require(alone, "teacher", "must be none if there is a base")
        as_device(self.device)
        if self.space is not None:
            self._check_for_space()
        with scenarios.without_warnings(self.space):
            played = self.make_evaluation_scenarios()
            for name in (self.chosen_base, self.imitated, *self.chosen_rivals):
                for made in played if name is not None else ():
                    registry.check(str(name), made)
        if self.chosen_base_parameters:
            self._require(self.chosen_base is not None, "base_parameters", "must be left out without a base")
            PolicySettings(str(self.chosen_base), self.chosen_base_parameters).make(self.make_scenario())

    def _check_for_space(self) -> None:
        """Raise ValueError for settings that suit only one scenario."""
        space = f"for a space of scenarios ({self.scenario})"
        self._require(self.imitated is None, "teacher", f"must be none {space}: a teacher plays one scenario")
        self._require(self.short == 0, "short", f"must be 0 {space}: worlds of a group end together")
        rule = f"must be a multiple of groups ({self.num_groups}) {space}"
        self._require(self.num_worlds % self.num_groups == 0, "worlds", rule)

    @cached_property
    def space(self) -> ScenarioSpace | None:
        """Space of scenarios to train on, with its overrides, or None for one scenario."""
        space = scenarios.space_of(self.scenario)
        return None if space is None else space.overridden(self.overrides)

    @cached_property
    def papers_method(self) -> tuple[str | None, str]:
        """Name of the paper's method for the scenario, or None, and the reason in words."""
        return self._first_made(_PAPERS_METHODS, "the paper's method")

    def _first_made(self, names: Mapping[str, tuple[str, ...]], what: str) -> tuple[str | None, str]:
        """Return the first policy for the scenario's kind of robot that can be made for it, and the reason in words."""
        scenario = self.make_scenario()
        kind, refused = scenario.actuation, ""
        for name in names.get(kind, ()):
            try:
                with scenarios.without_warnings(self.space):
                    registry.make(name, scenario)
            except ValueError as error:
                refused += f"; {name} cannot be made: {error}"
            else:
                return name, f"{what} for robots of kind {kind}{refused}"
        return None, f"there is none for robots of kind {kind}{refused}"

    @cached_property
    def chosen_base(self) -> str | None:
        """Policy to whose action the network's output is added."""
        return self._base_and_reason[0]

    @cached_property
    def chosen_base_parameters(self) -> dict[str, float]:
        """Parameters of the base that are not its defaults."""
        if self.base is None and self.start is not None and not self.base_parameters:
            return dict(checkpoint.read(find(self.start))[1].base_parameters)
        return parse_numbers("base_parameters", self.base_parameters)

    @property
    def reason_for_base(self) -> str:
        """Reason for `chosen_base` in words."""
        return self._base_and_reason[1]

    @cached_property
    def _base_and_reason(self) -> tuple[str | None, str]:
        if self.base is not None:
            return (None if self.base == "none" else self.base), "given by --base"
        if self.start is not None:
            return checkpoint.read(find(self.start))[1].base, f"the base of {self.start}, given by --start"
        if self.teacher not in (None, "none"):
            return None, "a policy is imitated instead"
        if self.space is not None:
            return self._first_made(_PATROLS, "the best one for spaces")
        return self.papers_method

    @property
    def num_worlds(self) -> int:
        """Number of worlds that are stepped together."""
        if self.worlds is None and self.space is not None:
            return _GROUP_SIZE * (self.groups or _GROUPS)
        return self.worlds or (512 if self.chosen_base is None else 128)

    @property
    def num_groups(self) -> int:
        """Number of scenarios of a space that are played at the same time."""
        most = min(_GROUPS, self.num_worlds)
        return self.groups or next(k for k in range(most, 0, -1) if self.num_worlds % k == 0)

    @property
    def chosen_noise_steps(self) -> int:
        """Steps for which a robot uses the same random function of its inputs as noise."""
        return self.noise_steps or (1 if self.chosen_base is None else 30)

    @cached_property
    def chosen_rivals(self) -> tuple[str, ...]:
        """Policies to compare the evaluations with that are known before the rehearsal, without the base."""
        return tuple(filter(None, [self.papers_method[0]])) if self.rivals is None else self.rivals

    @property
    def base_label(self) -> str:
        """Name of the base among the rivals, with its parameters, such as `sweep(cruise=1.9)`; "" without a base."""
        return "" if self.chosen_base is None else PolicySettings(self.chosen_base, self.chosen_base_parameters).label

    @property
    def imitated(self) -> str | None:
        """Policy to imitate, or None."""
        if self.teacher is not None:
            return None if self.teacher == "none" else self.teacher
        if self.start is not None or self.chosen_base is not None or self.space is not None:
            return None
        return self._default_teacher[0]

    @cached_property
    def _default_teacher(self) -> tuple[str | None, str]:
        return self._first_made(_TEACHERS, "the teacher")

    @property
    def imitated_until(self) -> int:
        """Robot steps after which imitation ends."""
        return 0 if self.imitated is None else min(self.imitation_steps, self.steps)

    @property
    def constants(self) -> tuple[str, ...]:
        """Names of the scenario's numbers that the network reads beside the observation: all for a space."""
        return () if self.space is None else tuple(CONSTANTS)

    def make_home_scenario(self) -> Scenario:
        """Return the scenario with its overrides; for a space, the first one of its evaluations."""
        if self.space is not None:
            return scenarios.evaluated(self.space, 1)[0]
        return make_scenario(self.scenario, **self.overrides)

    def make_scenario(self) -> Scenario:
        """Return the home scenario, without the coverage grid unless the reward depends on it."""
        return scenarios.lean(self.make_home_scenario())

    def make_evaluation_scenarios(self) -> list[Scenario]:
        """Return the scenarios of the evaluations: that of the training, or the first ones of a split of the space."""
        if self.space is None:
            return [self.make_scenario()]
        return [scenarios.leaner(made) for made in scenarios.evaluated(self.space, self.evaluation_scenarios)]

    @property
    def episodes_per_scenario(self) -> int:
        """Episodes of each scenario in an evaluation."""
        parts = 1 if self.space is None else self.evaluation_scenarios
        return max(self.evaluation_episodes // parts, 1)

    def make_cautious_scenario(self) -> Scenario:
        """Return the scenario to learn in: that of the evaluations, with a larger penalty for collisions."""
        return scenarios.cautious(self.make_scenario(), self.caution)

    def change_drawn(self, made: Scenario) -> Scenario:
        """Return a scenario that was drawn from the space, as it is learned in."""
        made = scenarios.leaner(made)
        if self._reference is not None:
            made = scenarios.in_units_of(self._reference, made, self.device)
        return scenarios.cautious(made, self.caution)

    @cached_property
    def _reference(self) -> str | None:
        """Policy relative to which the targets of drawn scenarios are penalized: the base or the best patrol.

        The paper's method for cars would take longer than the training itself.
        """
        return self.chosen_base or self._first_made(_PATROLS, "the best one for spaces")[0]

    def to_dict(self) -> dict[str, Any]:
        """Return plain values, as written into a checkpoint, with defaults replaced by what they resolve to."""
        values = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        values |= {"base": self.chosen_base or "none", "worlds": self.num_worlds}
        values |= {"noise_steps": self.chosen_noise_steps, "base_parameters": self.chosen_base_parameters}
        for name in _LEFT_OUT:
            if not values[name]:
                del values[name]
        if self.space is None:
            del values["groups"], values["evaluation_scenarios"]
        else:
            values["groups"] = self.num_groups
        plain = {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}
        return plain | {"out": str(self.out), "overrides": dict(self.overrides)}

    def differences(self, stored: Mapping[str, Any]) -> list[str]:
        """Return the settings that prevent a training from resuming what is stored, each in words."""
        return differences(dict.fromkeys(_LEFT_OUT) | self.to_dict(), stored, CHANGES_NOTHING)


def differences(here: Mapping[str, Any], stored: Mapping[str, Any], may_change: Collection[str]) -> list[str]:
    """Return the settings that differ from the stored ones, each in words, but for those that may change."""
    return [
        f"{name} = {stored.get(name)!r} there, {value!r} here"
        for name, value in here.items()
        if name not in may_change and stored.get(name) != value
    ]
