"""The settings of a training: one dataclass, which is the command line of `lissajous train`."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from baselines.policies import registry
from lissajous_env import Scenario
from lissajous_env import scenario as make_scenario
from lissajous_env.device.devices import as_device
from training.learned import checkpoint
from training.learned.network import ACTIVATIONS
from training.learned.policy import find

CHANGES_NOTHING = ("steps", "out", "threads", "address", "workers", "evaluation_episodes", "rivals")
"""Settings that may differ when a training goes on: they do not change what is learned from a step."""

_MOST = {
    "steps": 10**15,
    "worlds": 1_000_000,
    "rollout": 1_000_000,
    "batch_size": 10**9,
    "imitation_batch": 10**9,
    "epochs": 10_000,
    "imitation_epochs": 10_000,
    "evaluate_every": 10**15,
    "evaluation_episodes": 65_536,
    "noise_steps": 10**9,
    "workers": 10_000,
}
"""Whole numbers, all of at least 1, and the most that each may be: above it lie typing errors alone."""
_POSITIVE = ("residual", "clip_range", "gradient_max", "short_time")
_PAPERS_METHODS = {"car": ("kuramoto-mpcc", "kuramoto-gvf"), "curve": ("kuramoto",)}
_TEACHERS = {"car": ("arc-mpcc", "arc-gvf"), "curve": ("kuramoto",)}
"""By kind of robot; the first that can be made: contouring control follows Lissajous curves only, the field any."""


@dataclass(frozen=True)
class TrainingSettings:
    """What is trained, how, and where it goes. The defaults are for two cores of a laptop."""

    scenario: str = "intruders"
    """Scenario to train on."""
    algorithm: Literal["ppo", "dagger", "clone"] = "ppo"
    """ppo: proximal policy optimization of Stable-Baselines3, after a start by imitation. dagger: imitation alone, in
    the states that the student reaches; clone: in those that the teacher reaches."""
    steps: int = 100_000_000
    """Steps of a robot to train for, over all robots of all worlds."""
    worlds: int | None = None
    """Worlds that are stepped together; each robot of each is one row. By default 128 beside a base, so that
    more is learned from fewer steps, for it takes most of the time; else 512."""
    short: float = 0.0
    """Share of the worlds that begin anew after `short_time`: more is learned of how an episode begins."""
    short_time: float = 3.0
    """Time after which these worlds begin anew [s]."""
    seed: int = 0
    """Seed of the worlds, the initial weights and the exploration."""
    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Path("runs/train")
    """Folder of the results; the same command goes on there from the last checkpoint."""
    start: Annotated[str | None, tyro.conf.arg(metavar="CHECKPOINT")] = None
    """Checkpoint, or name of a shipped policy, whose network is the first one."""
    base: str | None = None
    """Classical policy that the network's output is added to; `none` lets the network act alone. By default that of
    `start`, else the paper's method where it can be made for the scenario and nothing is imitated: kuramoto-mpcc for
    cars (kuramoto-gvf on a curve of harmonics), kuramoto for points."""
    residual: float = 0.5
    """What the network's output is multiplied with where there is a base."""
    residual_penalty: float = 0.0
    """Reward that a residual costs, per step and mean square of the output: it leaves the base only where that pays."""
    teacher: str | None = None
    """Policy that is imitated; `none` disables imitation. By default none with `start` or a base, else kuramoto for
    points and arc-mpcc (arc-gvf on a curve of harmonics) for cars."""
    imitation: Literal["dagger", "clone"] = "dagger"
    """How ppo imitates at its start."""
    imitation_steps: int = 1_000_000
    """Steps of a robot, the first of `steps`, in which ppo imitates."""
    imitation_batch: int = 1024
    """Rows of a minibatch of imitation."""
    imitation_epochs: int = 4
    """Passes over a rollout of imitation."""
    inputs: tuple[str, ...] = ()
    """Entries of the observation that the network reads; all by default."""
    critic: Literal["robot", "world"] | None = None
    """What the critic of ppo sees: the policy's inputs, or the whole world besides (MAPPO). By default the world, and
    robot with ray, which knows no other."""
    critic_steps: int = 0
    """Steps of a robot, the first of ppo, in which the critic alone learns: what it says of a policy that was learned
    elsewhere is wrong at first, and would spoil it."""
    layers: tuple[int, ...] = (64, 64)
    """Sizes of the hidden layers."""
    activation: Literal["relu", "tanh"] = "relu"
    """Activation between layers."""
    learning_rate: float = 7e-4
    """Learning rate at the start; it falls linearly to a fiftieth."""
    rollout: int = 64
    """Steps of each world between updates."""
    batch_size: int = 8192
    """Rows of a minibatch."""
    epochs: int = 2
    """Passes over a rollout."""
    gamma: float = 0.99
    """Discount per step."""
    gae_lambda: float = 0.95
    """lambda of the generalized advantage estimate."""
    clip_range: float = 0.2
    """Largest change of a ratio of probabilities that is still rewarded."""
    entropy: float = 0.0
    """Weight of the entropy bonus."""
    value_weight: float = 0.5
    """Weight of the value loss."""
    gradient_max: float = 0.5
    """Largest norm of a gradient."""
    averaging: float = 0.0
    """Share that the average of the policy's weights keeps in each update; above 0, that average is the result."""
    log_std: float = -0.7
    """Logarithm of the standard deviation of the exploration at the start."""
    log_std_end: float | None = -1.2
    """The same at the end, where it is lower; it falls linearly, for what earns the most under much noise is not what
    does without. None lets it be learned."""
    noise_steps: int | None = None
    """Steps for which a robot explores with one random function of its inputs (gSDE); 1 draws noise in each step. By
    default 30 beside a base, else 1; always 1 with ray."""
    caution: float = 3.0
    """What a collision costs while ppo learns, as a multiple of the scenario's `task.reward_collision`."""
    evaluate_every: int = 1_000_000
    """Robot steps between evaluations, each of which ends in a checkpoint."""
    evaluation_episodes: int = 64
    """Episodes of an evaluation; their seeds, from 20,000, are kept from training."""
    rivals: tuple[str, ...] | None = None
    """Policies that the evaluations are compared with; by default the paper's method and the base."""
    device: str = "cpu"
    """cpu, cuda or cuda:k."""
    threads: int | None = None
    """CPU threads of torch and of the worlds; all cores by default."""
    engine: Literal["sb3", "ray"] = "sb3"
    """sb3: this process. ray: RLlib, over a cluster."""
    address: str | None = None
    """Address of a Ray cluster: auto, HOST:PORT or ray://HOST:PORT; without it one is started here."""
    workers: int = 2
    """Processes that collect episodes, with ray."""
    overrides: Annotated[Mapping[str, Any], tyro.conf.Suppress] = field(default_factory=dict)
    """Fields changed in the scenario, as {"task.reward_collision": -5.0}."""

    def __post_init__(self) -> None:
        for name, most in _MOST.items():
            value = getattr(self, name)
            self._require(name, value is None or value >= 1, "must be at least 1")
            self._require(name, value is None or value <= most, f"must be at most {most:,}")
        self._require("seed", 0 <= self.seed < 2**11, "must be from 0 to 2047")
        self._require("layers", all(size >= 1 for size in self.layers), "must be sizes of at least 1")
        few = len(self.layers) <= 100 and all(size <= 65_536 for size in self.layers)
        self._require("layers", few, "must be at most 100 sizes of at most 65,536")
        self._require("activation", self.activation in ACTIVATIONS, f"must be one of {', '.join(ACTIVATIONS)}")
        self._require("address", self.address is None or self.engine == "ray", "must be given with engine ray alone")
        self._require(
            "threads", self.threads is None or 1 <= self.threads <= 1024, "must be at least 1 and at most 1,024"
        )
        for name, most in (("learning_rate", 1), *((n, 1e6) for n in _POSITIVE)):
            self._require(name, getattr(self, name) > 0, "must be positive")
            self._require(name, getattr(self, name) <= most, f"must be at most {most:g}")
        for name in ("gamma", "gae_lambda", "short"):
            self._require(name, 0 <= getattr(self, name) <= 1, "must be from 0 to 1")
        self._require("averaging", 0 <= self.averaging < 1, "must be at least 0 and below 1")
        for name in ("log_std", "log_std_end"):
            value = getattr(self, name)
            self._require(name, value is None or -20 <= value <= 2, "must be from -20 to 2")
        for name in ("entropy", "value_weight", "residual_penalty", "caution"):
            self._require(name, getattr(self, name) >= 0, "must not be negative")
            self._require(name, getattr(self, name) <= 1e6, "must be at most 1e6")
        for name in ("imitation_steps", "critic_steps"):
            self._require(name, getattr(self, name) >= 0, "must not be negative")
            self._require(name, getattr(self, name) <= _MOST["steps"], f"must be at most {_MOST['steps']:,}")
        self._require("start", self.start != "", "must not be empty")
        self._require("teacher", self.imitated is None or self.base in (None, "none"), "must be none beside a base")
        self._require(
            "teacher", self.imitated is not None or self.algorithm == "ppo", "must be given for imitation alone"
        )
        if self.engine == "sb3":
            as_device(self.device)
        for name in (self.chosen_base, self.imitated, *self.chosen_rivals):
            if name is not None:
                registry.check(name, self.make_scenario())

    @cached_property
    def papers_method(self) -> tuple[str | None, str]:
        """The paper's method for the scenario, where there is one, and why it is or is not there, in words."""
        return self._first_made(_PAPERS_METHODS, "the paper's method")

    def _first_made(self, names: Mapping[str, tuple[str, ...]], what: str) -> tuple[str | None, str]:
        """First policy of some for the scenario's kind of robot that can be made for it, and why, in words."""
        scenario = self.make_scenario()
        kind, refused = scenario.robot.kind, ""
        for name in names.get(kind, ()):
            try:
                registry.make(name, scenario)
            except ValueError as error:
                refused += f"; {name} cannot be made: {error}"
            else:
                return name, f"{what} for robots of kind {kind}{refused}"
        return None, f"there is none for robots of kind {kind}{refused}"

    @cached_property
    def chosen_base(self) -> str | None:
        """Policy that the network's output is added to."""
        return self._base_and_reason[0]

    @property
    def reason_for_base(self) -> str:
        """Why `chosen_base` is what it is, in words."""
        return self._base_and_reason[1]

    @cached_property
    def _base_and_reason(self) -> tuple[str | None, str]:
        if self.base is not None:
            return (None if self.base == "none" else self.base), "as --base names it"
        if self.start is not None:
            return checkpoint.read(find(self.start))[1].base, f"that of {self.start}, which --start names"
        if self.algorithm != "ppo" or self.teacher not in (None, "none"):
            return None, "a policy is imitated instead"
        return self.papers_method

    @property
    def num_worlds(self) -> int:
        """Worlds that are stepped together."""
        return self.worlds or (512 if self.chosen_base is None else 128)

    @property
    def chosen_noise_steps(self) -> int:
        """Steps for which a robot explores with one random function of its inputs."""
        return self.noise_steps or (1 if self.chosen_base is None or self.engine == "ray" else 30)

    @cached_property
    def chosen_rivals(self) -> tuple[str, ...]:
        """Policies that the evaluations are compared with."""
        if self.rivals is not None:
            return self.rivals
        return tuple(dict.fromkeys(name for name in (self.papers_method[0], self.chosen_base) if name is not None))

    @property
    def imitated(self) -> str | None:
        """Policy that is imitated."""
        if self.teacher is not None:
            return None if self.teacher == "none" else self.teacher
        if self.start is not None or self.chosen_base is not None:
            return None
        return self._default_teacher[0]

    @cached_property
    def _default_teacher(self) -> tuple[str | None, str]:
        return self._first_made(_TEACHERS, "the teacher")

    @property
    def has_central_critic(self) -> bool:
        """Whether the critic sees the world."""
        return self.engine == "sb3" and self.critic != "robot"

    @property
    def imitated_until(self) -> int:
        """Steps of a robot after which imitation ends; RLlib does not imitate."""
        if self.imitated is None or self.engine == "ray":
            return 0
        return min(self.imitation_steps, self.steps) if self.algorithm == "ppo" else self.steps

    @property
    def student_drives(self) -> bool:
        """Whether the states that are imitated in become those that the student reaches."""
        return (self.imitation if self.algorithm == "ppo" else self.algorithm) == "dagger"

    def make_home_scenario(self) -> Scenario:
        """Make the scenario as it was given."""
        return make_scenario(self.scenario, **self.overrides)

    def make_scenario(self) -> Scenario:
        """Make the scenario, without the coverage grid unless the reward depends on it."""
        made = self.make_home_scenario()
        if made.task.reward_idleness == 0:
            made = make_scenario(made, **{"task.grid": None})
        return made

    def make_cautious_scenario(self) -> Scenario:
        """Make the scenario that is learned in: that of the evaluations, but for what a collision costs."""
        made = self.make_scenario()
        return make_scenario(made, **{"task.reward_collision": self.caution * made.task.reward_collision})

    def to_dict(self) -> dict[str, Any]:
        """Plain values, as written into a checkpoint: those that change what is learned, and the number of steps."""
        kept = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)}
        kept |= {"base": self.chosen_base or "none", "rivals": self.chosen_rivals, "worlds": self.num_worlds}
        kept |= {"noise_steps": self.chosen_noise_steps}
        plain = {name: list(value) if isinstance(value, tuple) else value for name, value in kept.items()}
        return plain | {"out": str(self.out), "overrides": dict(self.overrides)}

    def differences(self, stored: Mapping[str, Any]) -> list[str]:
        """Settings that keep a training from going on with what is stored, each in words."""
        return [
            f"{name} = {stored.get(name)!r} there, {value!r} here"
            for name, value in self.to_dict().items()
            if name not in CHANGES_NOTHING and stored.get(name) != value
        ]

    def _require(self, name: str, holds: bool, rule: str) -> None:
        if not holds:
            raise ValueError(f"{name} {rule}, got {getattr(self, name)!r}")
