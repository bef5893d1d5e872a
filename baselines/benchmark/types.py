"""The settings of a benchmark, its standard scenarios and policies, the cells that they name, and its outcome."""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from baselines.benchmark.table import Rows, Table
from baselines.policies import registry
from baselines.policies.registry import Factory
from lissajous_env.device.devices import as_device
from lissajous_env.episodes.evaluation import ActingPolicy, refuse_rogue_agents
from lissajous_env.episodes.guarantee import cells
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import Checked, choice, whole, whole_number
from lissajous_env.wording import few_of

SCENARIOS = (
    "evaders", "evaders-walls", "evaders-lost", "team", "intruders", "intruders-walls", "intruders-inside", "rough",
    "redundant",
)  # fmt: skip
"""Scenarios of the standard comparison, on which policies differ. `evaders-failure` and `evaders-fast` are left out,
because they order the policies much like `evaders`."""

WITH_GRID = "intruders", "intruders-inside", "intruders-walls", "rough", "rough-lost"
"""Scenarios that do not follow the guarantee by themselves, as that makes their steps slower: a benchmark has a number
for the guarantee on all of them."""

POLICIES = (
    "kuramoto-mpcc", "kuramoto-mpcc-safe", "open-loop-mpcc", "consensus-mpcc", "partition", "partition-repair",
    "line-abreast", "sweep", "laps",
    "portfolio", "portfolio-guarantee", "random", "kuramoto", "consensus", "open-loop",
    "lanes", "follow", "a-cmommt", "greedy-cover", "greedy-herd", "pure-pursuit", "lead-pursuit",
    "divided-pursuit", "voronoi-pursuit", "index", "index-learned", "learned-watch", "learned-intercept",
)  # fmt: skip
"""Policies of the standard comparison, which the command and the table of docs/comparison.md show; the README's table
has some of them.

A policy is played where it drives the robots, also where it was not made for; from `lanes` on they drive where actions
are velocities.
"""

ALL = "all"
"""Word that names every policy."""
_MOST_EPISODES = 1_000_000


@dataclass(frozen=True)
class Benchmark(Checked, part=""):
    """Episodes to play, and the folder of the results."""

    scenarios: tuple[str, ...] = SCENARIOS
    """Scenarios to play. SPACE:SPLIT, such as monitoring-v1:test, stands for the first 32 scenarios of a split or shift
    of a scenario space, and SPACE:SPLIT:COUNT for the first COUNT."""
    policies: tuple[str, ...] = ()
    """Policies to play, each on the scenarios whose robots it drives; by default the standard ones (`POLICIES`), and
    those that you registered. `all` plays every registered policy. Your own policy can be given as a checkpoint's
    folder, as `module:factory`, or by a name that a module of the current folder registers."""
    episodes: int = whole(16, 1, _MOST_EPISODES)
    """Number of episodes of each policy on each scenario; more of them narrow the intervals."""
    seed: int = 0
    """Seed of episode 0; episode k has seed + k, for every policy."""
    batch: int = whole(16, 1, 65_536)
    """Number of episodes that are played and stored together; it changes the speed, not the results."""
    device: str = "cpu"
    """Device of the simulation: `cpu`, `cuda` or `cuda:k` for CUDA device k."""
    out: Annotated[Path, tyro.conf.arg(metavar="FOLDER")] = Path("results/benchmark")
    """Folder of the results. A second call with the same folder adds scenarios, policies or episodes, plays no episode
    twice, and refuses other settings. The files cover all episodes of the folder."""
    engine: Literal["local", "ray"] = choice("local", "local", "ray")
    """`local` plays on this machine; `ray` plays on a Ray cluster and requires the extra `cluster`. The results are the
    same."""
    address: str | None = None
    """Address of the Ray cluster: auto, HOST:PORT or ray://HOST:PORT; by default, engine ray starts one here."""
    against: str | None = None
    """Policy with which all others are compared, seed by seed; by default the paper's method or the patrol `lanes`
    if one of them is played, else the first policy."""
    replays: int = whole(8, 0, _MOST_EPISODES)
    """Number of episodes that report.html can play: the worst of each policy on each scenario first. The reference
    policy is shown beside each."""
    overrides: Annotated[Mapping[str, Any], tyro.conf.Suppress] = field(default_factory=dict)
    """Fields changed in every scenario, as {"task.duration": 30.0}."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "scenarios", named.expanded(self.scenarios))
        super().__post_init__()

    def _check_together(self) -> None:
        whole_number("seed", self.seed, 0, 2**31 - self.episodes)
        has_cluster = self.engine == "ray" or self.address is None
        self._require(has_cluster, "address", "must be given only with engine ray")

    @property
    def worlds(self) -> int:
        """Return the number of episodes that are played together."""
        # This never depends on the episodes that are left: a user's policy may round otherwise in another batch.
        return min(self.batch, self.episodes)


@dataclass(frozen=True)
class Cell:
    """A policy on a scenario."""

    scenario: Scenario
    policy: str
    factory: Factory = field(repr=False)

    def __str__(self) -> str:
        return f"{self.scenario.name} {self.policy}"


@dataclass(frozen=True)
class Failure:
    """A policy that raised on a scenario, or refused it."""

    scenario: str
    policy: str
    error: str
    traceback: str = field(repr=False)
    is_refusal: bool = False
    """True if the policy refused the scenario (`UnsuitableScenarioError`)."""


Work = list[tuple[Cell, list[int]]]
"""Cells, each with the numbers of the episodes to play."""
Finish = Callable[[Cell, Rows | Failure], None]
"""Function that stores a batch of a cell on the disk before it returns, or notes that its policy failed."""


@dataclass
class BenchmarkOutcome:
    """The results of a benchmark."""

    settings: Benchmark
    cells: list[Cell]
    rows: Rows
    """Score rows of the requested episodes, by scenario, policy and episode."""
    table: Table
    """Table of all episodes in the folder."""
    stored: dict[str, Any]
    """Settings of the folder, including those of earlier calls."""
    failures: list[Failure] = field(default_factory=list)
    left_out: list[Failure] = field(default_factory=list)
    """Policies that refused a scenario, of those that the settings do not name."""
    resumed: int = 0
    """Number of the rows that an earlier call had stored."""
    elapsed: float = 0.0
    """Duration of this call [s]."""
    theorem: dict[str, list[str]] = field(default_factory=dict)
    """Result of `baselines.benchmark.theorem.about_theorem` for the policies and score rows of the folder."""

    @property
    def playable(self) -> dict[tuple[str, str], Cell]:
        """Return the cells of this call that did not fail, by scenario and policy."""
        failed = {(failure.scenario, failure.policy) for failure in (*self.failures, *self.left_out)}
        cells = {(cell.scenario.name, cell.policy): cell for cell in self.cells}
        return {place: cell for place, cell in cells.items() if place not in failed}

    @property
    def device(self) -> str:
        """Return the device on which episodes can be played again here; that of a cluster's node may be elsewhere."""
        return self.settings.device if self.settings.engine == "local" else "cpu"


def require_distinct_names(scenarios: list[Scenario]) -> list[Scenario]:
    """Return scenarios whose results can be stored by name.

    Raises:
        ValueError: several have the same name.
    """
    for name, count in Counter(scenario.name for scenario in scenarios).items():
        if count > 1:
            words = f"scenarios must differ in name, got {count} of {name}"
            raise ValueError(f"{words}; set `name` in the file of one, or by `dataclasses.replace`")
    return scenarios


def as_played(scenario: str) -> Scenario:
    """Make a scenario as a benchmark plays it: with a grid for the guarantee if it is one of `WITH_GRID`."""
    original = named.build(scenario)
    return named.build(original, **{"task.contamination": cells(original)}) if scenario in WITH_GRID else original


def cells_of(
    settings: Benchmark,
    policies: Mapping[str, Factory | ActingPolicy] | None = None,
    scenarios: Iterable[Scenario] | None = None,
) -> list[Cell]:
    """Return the policies on scenarios that some settings name.

    Scenarios that no policy drives are left out if the scenarios are the standard ones, or if a policy is a folder.

    Raises:
        ValueError: an unknown name or device, scenarios of the same name, rogues that are agents, a policy that drives
            no scenario, or another scenario without a policy.
    """
    given = {name: registry.as_factory(policy, name) for name, policy in (policies or {}).items()}
    plays_all = settings.policies == (ALL,)
    wanted = ({} if plays_all else {name: registry.as_factory(name) for name in settings.policies}) | given
    chosen = settings.scenarios if scenarios is None else scenarios
    played = require_distinct_names([named.build(scenario, **settings.overrides) for scenario in chosen])
    if not played:
        raise ValueError("scenarios must contain at least one scenario, got none")
    for scenario in played:
        refuse_rogue_agents(scenario)
    for name in wanted:
        if name not in given and not any(_drives(name, scenario) for scenario in played):
            registry.make(name, played[0])  # raises the reason
    cells: list[Cell] = []
    for scenario in played:
        names = [name for name in wanted if name in given or _drives(name, scenario)]
        if plays_all or not wanted:
            names = list(dict.fromkeys([*_default(scenario, plays_all), *given]))
        cells += [Cell(scenario, name, wanted.get(name) or registry.as_factory(name)) for name in names]
    idle = [scenario for scenario in played if all(cell.scenario is not scenario for cell in cells)]
    leaves_out = tuple(scenario.name for scenario in played) == SCENARIOS or any(map(registry.is_folder, wanted))
    if idle and not (leaves_out and cells):
        kind, got = f"robots of kind {idle[0].actuation}", few_of(wanted) or "none"
        raise ValueError(f"policies must contain one for {idle[0].name}, which has {kind}; got {got}")
    if settings.against is not None and settings.against not in {cell.policy for cell in cells}:
        names = few_of((cell.policy for cell in cells), settings.against)
        raise ValueError(f"against must be one of the policies ({names}), got {settings.against}")
    if settings.engine == "local":
        as_device(settings.device)
    return cells


def _drives(name: str, scenario: Scenario) -> bool:
    """Return whether a policy drives the robots of a scenario, as far as this is known before it is made."""
    if registry.is_folder(name):
        with suppress(ValueError):  # the folder has no valid scenario
            return registry.own_scenario(name).actuation == scenario.actuation
    entry = registry.entry_of(name)
    return entry is None or entry.drives(scenario.actuation)


def _default(scenario: Scenario, plays_all: bool) -> list[str]:
    """Return the policies that are played where none is named: the standard ones and those that users registered.

    `plays_all` adds all other registered ones; of those with a filter, the paper's method alone and policies that were
    made for this very scenario.
    """
    fitting = registry.names(scenario)
    chosen = [name for name in POLICIES if name in fitting]
    for name in fitting:
        is_added = registry.is_default_on(name, scenario.name) and (plays_all or not registry.is_included(name))
        is_plain = not registry.split_suffix(name)[1] or (plays_all and registry.describe(name)["made_for"])
        if is_added and is_plain and name not in chosen:
            chosen.append(name)
    return chosen
