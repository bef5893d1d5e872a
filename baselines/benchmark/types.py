"""What a benchmark is asked for and what it comes to: its settings, cells, failures and outcome."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from baselines.benchmark import standard
from baselines.policies.factories import Factory
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import few_of

_MOST_EPISODES = 1_000_000
_MOST_WORLDS = 65_536


@dataclass(frozen=True)
class Benchmark:
    """What is played, and where the results go."""

    scenarios: tuple[str, ...] = standard.SCENARIOS
    """Scenarios to play."""
    policies: tuple[str, ...] = ()
    """Policies to play, each where it drives the robots; without any, those of the README's table with the clairvoyant
    reference, and those that you registered. `all` plays every one that is registered. Your own: a checkpoint's folder,
    `module:factory`, or a name that a module of the current folder registers."""
    episodes: int = 16
    """Episodes of each policy on each scenario."""
    seed: int = 0
    """Seed of episode 0; episode k has seed + k, for every policy."""
    batch: int = 16
    """Episodes that are played, and written, together; changes no result."""
    device: str = "cpu"
    """cpu, cuda or cuda:k."""
    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Path("results/benchmark")
    """Folder of the results. A second call goes on there: it adds what it asks for (scenarios, policies, episodes) to
    what is there, plays nothing twice, and refuses other settings. The files hold all of the folder."""
    engine: Literal["local", "ray"] = "local"
    """local plays here; ray plays over a cluster, and needs the extra `cluster`. It changes no result."""
    address: str | None = None
    """Address of the Ray cluster: auto, HOST:PORT or ray://HOST:PORT; without one, engine ray starts its own here."""
    clairvoyant: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Play, beside the policies that are named, a reference that sees where the rogues are; its name stands in
    brackets."""
    against: str | None = None
    """Policy that all others are compared with, seed by seed; without one it is the paper's method where that is
    played, or else the first."""
    replays: tuple[str, ...] = ("few",)
    """Episodes that report.html can play: none; each: the worst, the median and the best of each policy on each
    scenario; few: as many of these as 16 s and 11 MB allow, all the worst ones first; a number: so many of the worst of
    each; all; and SCENARIO:POLICY:SEED. Beside each of them goes the policy that all are compared with."""
    overrides: Annotated[Mapping[str, Any], tyro.conf.Suppress] = field(default_factory=dict)
    """Fields changed in every scenario, as {"task.duration": 30.0}."""

    def check(self) -> None:
        """Raise ValueError for a value that a rule forbids."""
        for name, most in (("episodes", _MOST_EPISODES), ("batch", _MOST_WORLDS)):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}")
            if getattr(self, name) > most:
                raise ValueError(f"{name} must be at most {most:,}, got {getattr(self, name)}")
        if not 0 <= self.seed <= 2**31 - self.episodes:
            raise ValueError(f"seed must be from 0 to 2147483647, that of the last episode too, got {self.seed}")
        for name in ("scenarios", "policies"):
            if len(set(getattr(self, name))) < len(getattr(self, name)):
                raise ValueError(f"{name} must name each one once, got {few_of(getattr(self, name))}")
        if not self.scenarios:
            raise ValueError("scenarios must name at least one")
        if self.engine not in ("local", "ray"):
            raise ValueError(f"engine must be local or ray, got {self.engine!r}")
        if self.address is not None and self.engine != "ray":
            raise ValueError(f"address must be given with engine ray alone, got {self.address!r}")

    @property
    def worlds(self) -> int:
        """Episodes that are played together."""
        # This never depends on what is left to do: a policy may round otherwise in another batch.
        return min(self.batch, self.episodes)


@dataclass(frozen=True)
class Cell:
    """A policy on a scenario."""

    scenario: Scenario
    policy: str
    factory: Factory = field(repr=False)


@dataclass(frozen=True)
class Failure:
    """A policy that raised on a scenario."""

    scenario: str
    policy: str
    error: str
    traceback: str = field(repr=False)


@dataclass(frozen=True)
class Batch:
    """Episodes that were played together."""

    rows: list[dict[str, Any]]
    """Their score rows."""
    detections: list[dict[str, Any]]
    """When their targets were detected: `baselines.benchmark.detections.detections_of`."""


@dataclass
class Outcome:
    """What a benchmark came to."""

    settings: Benchmark
    cells: list[Cell]
    rows: list[dict[str, Any]]
    """Score rows of what was asked for, by scenario, policy and episode."""
    failures: list[Failure]
    kept: int
    """How many of them were there from an earlier call."""
    elapsed: float
    """Time that it took, this call alone [s]."""
    held: dict[str, Any]
    """Settings that the folder holds, those of earlier calls among them."""
    held_scenarios: dict[str, Scenario]
    held_rows: list[dict[str, Any]]
    """Score rows that the folder holds."""
    held_curves: dict[str, dict[str, tuple[Any, Any]]]
    """Times [s] and share of the targets detected within each, by scenario and policy, of what the folder holds."""

    @property
    def scenarios(self) -> dict[str, Scenario]:
        """The scenarios that were played, by name."""
        return {cell.scenario.name: cell.scenario for cell in self.cells}
