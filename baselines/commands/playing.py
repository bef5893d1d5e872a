"""Policies that a command plays, with progress and with errors that name the policy, and recordings that it shows."""

import math
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from baselines.benchmark.types import ALL, Benchmark, Cell, cells_of
from baselines.policies import registry
from lissajous_env.console.terminal import (
    DEFAULT_OUTPUT,
    CommandError,
    Device,
    Output,
    Overrides,
    Progress,
    bar,
    parse_overrides,
)
from lissajous_env.episodes.recording import Recording, record
from lissajous_env.logs.messages import rosbags
from lissajous_env.logs.writing import save_mcap
from lissajous_env.parameters.named import denotes_scenario
from lissajous_env.render import film
from lissajous_env.replay import Replay
from lissajous_env.storage.files import check_writable_file
from lissajous_env.wording import few_of, nearest, require, where_raised

T = TypeVar("T")
FORMATS = (".html", ".mp4", ".gif", ".npz", ".mcap")
"""Endings of the files that show or store one episode."""


@dataclass(frozen=True)
class PlayOptions(Output):
    """Episodes and console output."""

    seed: int = 0
    """Seed of episode 0; episode k has seed + k."""
    device: Device = "cpu"
    overrides: Overrides = ()

    def cells(
        self, names: Sequence[str], episodes: int = 1, batch: int = 1, rogues: str | None = None
    ) -> tuple[Benchmark, list[Cell]]:
        """Return the settings and the cells of some episodes of a policy on scenarios.

        Args:
            names: Scenarios, then the policy; or a policy's folder alone, which is played on its own scenario.
            episodes: Number of episodes on each scenario.
            batch: Number of episodes that are played together.
            rogues: Adversary that moves all targets.

        Raises:
            ValueError: as `split_scenarios_and_policy` and `cells_of`, the folder has no scenario, or all policies.
        """
        own = [registry.own_scenario(names[0])] if len(names) == 1 and registry.is_folder(names[0]) else None
        scenarios, policy = split_scenarios_and_policy(names) if own is None else ((names[0],), names[0])
        require(policy != ALL, "policy", "must be the name of one policy", policy)
        changed = parse_overrides(self.overrides, rogues)
        settings = Benchmark(scenarios, (policy,), episodes, self.seed, batch, self.device, overrides=changed)
        return settings, cells_of(settings, scenarios=own)

    def cell(self, names: Sequence[str], episodes: int = 1, rogues: str | None = None) -> Cell:
        """Return the cell of a policy on one scenario; the arguments are those of `cells`.

        Raises:
            ValueError: as `cells`, or several scenarios.
        """
        cells = self.cells(names, episodes, rogues=rogues)[1]
        if len(cells) > 1:
            raise ValueError(f"exactly one scenario must be given, got {few_of(cell.scenario.name for cell in cells)}")
        return cells[0]


DEFAULT_PLAY = PlayOptions()


def split_scenarios_and_policy(names: Sequence[str]) -> tuple[tuple[str, ...], str]:
    """Return the scenarios of a command, and the policy after them.

    Raises:
        ValueError: the policy is not the last of the names, or there is no scenario before it.
    """
    if not names:
        raise ValueError("names must be scenarios and then a policy, got nothing")
    *scenarios, policy = names
    for name in scenarios:
        if not denotes_scenario(name) and (registry.is_folder(name) or name in registry.names()):
            words = "scenario must be given before the policy (that of a policy's folder is FOLDER/scenario.toml)"
            raise ValueError(f"{words}, got {few_of(names)}")
    if denotes_scenario(policy) and policy not in registry.names() and not registry.is_folder(policy):
        raise ValueError(f"policy must be given after the scenario, got {few_of(names)}")
    if not scenarios:
        registry.as_factory(policy)  # refuses a policy that does not exist
    require(scenarios, "scenario", "must be given before the policy, one that `lissajous scenarios` lists", policy)
    return tuple(scenarios), policy


def of_each_seed(cell: Cell, seeds: Sequence[int], common: PlayOptions, play: Callable[..., T]) -> list[T]:
    """Return `play(policy, scenario, seed, device)` for each seed, with progress, and errors that name the policy."""
    results = []
    with Progress([(cell, [*seeds])], common.progress()) as progress:
        progress.begin(cell)
        policy = with_policy(cell, 1, common.device).factory(cell.scenario, 1, common.device)
        for seed in seeds:
            with naming(cell):
                results.append(play(policy, cell.scenario, seed, common.device))
            progress.finished(cell, 1)
    return results


def record_one(cell: Cell, seed: int, common: PlayOptions) -> Recording:
    """Record an episode of a policy on a scenario."""
    (recording,) = of_each_seed(cell, [seed], common, record)
    return replace(recording, score=recording.score | {"policy": cell.policy})


def with_policy(cell: Cell, num_worlds: int, device: str) -> Cell:
    """Return a cell whose policy is made, so that a wrong name or folder is reported as bad input, not as a failure."""
    with naming(cell) if registry.is_imported(cell.policy) else nullcontext():
        policy = cell.factory(cell.scenario, num_worlds, device)
    return replace(cell, factory=registry.as_factory(policy, cell.policy))


@contextmanager
def naming(cell: Cell) -> Iterator[None]:
    """Turn an error into one that names the policy that failed, and where."""
    try:
        yield
    except (Exception, SystemExit) as error:
        raise CommandError(f"{cell.policy} failed on {cell.scenario.name}: {where_raised(error)}") from error


def has_display() -> bool:
    """Return True if a window can be opened; without a display, SDL would open an invisible one."""
    driver = os.environ.get("SDL_VIDEODRIVER", "")
    display = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    return driver not in ("dummy", "offscreen") if driver else display


def check_file(out: Path | None, *suffixes: str) -> None:
    """Check that an output file can be written, before any work is done for it.

    Raises:
        ValueError: the suffix is unknown, the path is a folder, or its parent is missing or not writable.
        MissingExtraError: the library for .mp4 or .mcap is not installed.
    """
    if out is None:
        return
    suffix = out.suffix.lower()
    if suffix not in suffixes:
        raise ValueError(f"out must end in {' or '.join(suffixes)}, got {out}{nearest(suffix, suffixes)}")
    if suffix == ".mp4":
        film.pyav()
    if suffix == ".mcap":
        rosbags()
    check_writable_file(out)


def show(
    recording: Recording,
    out: Path | None,
    output: Output = DEFAULT_OUTPUT,
    speed: float = 1.0,
    fps: float = 10.0,
    against: Recording | None = None,
) -> None:
    """Show a recording in a window or, if a file is given, write it in the format of its suffix."""
    if out is None:
        film.play(recording, speed=speed)
        return
    suffix = out.suffix.lower()
    if suffix in film.FILMS:
        with bar(output.progress()) as progress:
            pictures = math.ceil(len(recording) / film.paced(recording, fps, speed)[0])
            task = progress.add_task("drawing", total=pictures)
            film.save_film(recording, out, fps=fps, speed=speed, on_frame=lambda: progress.advance(task))
    elif suffix == ".html":
        Replay(recording, against).save(out)
    elif suffix == ".mcap":
        save_mcap(recording, out)
    else:
        recording.save(out)
    output.print(f"wrote {out}")
