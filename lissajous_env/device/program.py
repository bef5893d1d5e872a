"""Programs: kernels in an order, bound to arrays by the names of their parameters, ready to run.

A kernel of a program takes `first`, the first world of the block that it works on, and, unless it goes over whole
worlds, `lanes`, how many threads share the entities of a world: on a GPU there is one for each entity, on a CPU one
that loops over them all, which saves its setup. One that takes `begin` and `end` too, and goes over the entities from
the one to the other, may have those of a large world split among CPU threads; the number of the part is `part`. One
that takes these without `first` goes over the entities of all worlds in a row, side by side
(`lissajous_env.device.abreast`): the last of them, and the first of the next world.

Kernels over the same entities that follow each other work on a part without waiting for the others. So none of them
may read of other parts what another one of them writes, nor write or add to what is not its part's own: an atomic
operation is none on a CPU.

Every other parameter is looked up by its name.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from typing import Any, cast

import numpy as np
import warp as wp

from lissajous_env.device.abreast import width_on
from lissajous_env.device.devices import as_device
from lissajous_env.device.kernel_cache import OURS
from lissajous_env.device.stacks import require_room
from lissajous_env.device.work import SHARES, Call, Work
from lissajous_env.wording import few_of

WORLD, ROBOT, TARGET, ROW, FIELD_ROW, BIN = "world", "robot", "target", "row", "field row", "bin"

_PLACED = ("first", "lanes", "part", "begin", "end")
"""Parameters that say which worlds and entities a launch is for."""

_MOST_LAUNCHES = 64
"""Launches that a launcher keeps ready."""

_SHARE = 100_000
"""Work below which it does not pay to wake a thread for it [ns]."""


@dataclass(frozen=True)
class Stage:
    """One stage of a program."""

    name: str
    """Its name, new in its program."""
    run: Any
    """A Warp kernel, or a function without arguments that is called on the host."""
    over: str = WORLD
    """What the kernel goes over: WORLD, ROBOT, TARGET, ROW (of the grid), FIELD_ROW (of contamination) or BIN."""
    when: bool = True
    """Whether the program has it."""
    own: Mapping[str, Any] = field(default_factory=dict)
    """What its kernel's parameters are bound to besides the values of the program, by name."""

    @property
    def is_kernel(self) -> bool:
        """Whether it is launched on the device."""
        return isinstance(self.run, wp.Kernel)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of what the kernel takes from the state and the constants."""
        return tuple(name for name in self.labels if name not in _PLACED)

    @property
    def labels(self) -> list[str]:
        """Names of all that the kernel takes."""
        return [argument.label for argument in self.run.adj.args] if self.is_kernel else []

    @property
    def about(self) -> str:
        """What it does, in a line."""
        return ((self.run.func if self.is_kernel else self.run).__doc__ or "").strip().partition("\n")[0]


@dataclass(frozen=True)
class Split:
    """How work on some worlds is split among CPU threads."""

    threads: int = 1
    """How many take part."""
    blocks: int = 1
    """Blocks of worlds."""
    parts: int = 1
    """Parts of the entities of a world; where it is more than one, a block is one world."""


def split_of(work: float, num_worlds: int, device: Any, threads: int) -> Split:
    """Split so much work on each world [ns], so that it pays: by worlds, and where they are too few by their entities.

    A GPU's threads have one entity each, so there is nothing to split.
    """
    shares = int(num_worlds * work / _SHARE) if device.is_cpu and threads > 1 else 1
    if shares < 2:
        return Split()
    if num_worlds >= threads:
        return Split(threads, min(SHARES * threads, shares, num_worlds))
    parts = max(1, min(-(-threads // num_worlds), shares // num_worlds))
    return Split(threads, num_worlds, parts)


class Program:
    """Stages in their order, ready to run.

    On a GPU neighbouring kernels are one graph. On a CPU a graph of Warp's would do, but what it looks up for each
    kernel takes longer than many of them do; there they are `Work`.

    Args:
        stages: What is run; those whose `when` is False, and those over nothing, are left out.
        values: What the kernels' parameters are bound to, by name.
        sizes: Number of entities in a world, by what a stage goes over.
        num_worlds: W.
        device: Warp device.
        split: How it is split among CPU threads.

    Raises:
        ValueError: a kernel asks for what is not there, by the names of stage and parameter.
    """

    def __init__(
        self,
        stages: Sequence[Stage],
        values: Mapping[str, Any],
        sizes: Mapping[str, int],
        num_worlds: int,
        device: Any,
        split: Split,
    ):
        self.stages = tuple(stage for stage in stages if stage.when and sizes.get(stage.over, 1) > 0)
        self._values, self._sizes, self._device = values, sizes, device
        edges = np.linspace(0, num_worlds, split.blocks + 1).astype(int).tolist()
        self._blocks = list(pairwise(edges))
        own = [stage for stage in self.stages if stage.is_kernel and not stage.run.module.name.startswith(OURS)]
        self._calls: list[Callable[[], None]] = [require_room] if own and device.is_cpu else []
        for is_kernel, run in groupby(self.stages, key=lambda stage: stage.is_kernel):
            if is_kernel:
                groups = [
                    [self._task(group, *share) for share in self._shares(parts)]
                    for parts, group in _grouped(run, split.parts)
                ]
                self._calls.append(
                    Work(groups, device, split.threads).lead if device.is_cpu else _Graph(groups, device)
                )
            else:
                self._calls += [stage.run for stage in run]

    def __call__(self) -> None:
        """Run all stages once."""
        for call in self._calls:
            call()

    def __str__(self) -> str:
        rows = [(stage.name, stage.over, stage.about, ", ".join(stage.parameters)) for stage in self.stages]
        widths = [max(len(row[k]) for row in rows) for k in range(3)]
        return "\n".join("  ".join([*map(str.ljust, row[:3], widths), row[3]]).rstrip() for row in rows)

    def _shares(self, parts: int) -> list[tuple[int, int, int, int]]:
        """First world and the one after the last, number of the part and of parts, of each task."""
        return [(low, high, part, parts) for low, high in self._blocks for part in range(parts)]

    def _lanes(self, stage: Stage) -> int:
        """How many threads share the entities of a world."""
        return 1 if self._device.is_cpu else self._sizes.get(stage.over, 1)

    def _task(self, stages: Sequence[Stage], *share: int) -> list[Any]:
        """Launches of some stages, of those that have entities in this share."""
        return [launch for stage in stages if (launch := self._launch(stage, *share)) is not None]

    def _launch(self, stage: Stage, low: int, high: int, part: int, parts: int) -> Any:
        lanes, size, names = self._lanes(stage), self._sizes.get(stage.over, 1), stage.labels
        begin, end = (size * edge // parts for edge in (part, part + 1))
        dim: tuple[int, ...] = (high - low,) if stage.over == WORLD else (high - low, lanes)
        if "begin" in names and "first" not in names:
            begin, end = low * size + begin, (high - 1) * size + end
            dim = (-(-(end - begin) // width_on(self._device)),)
        placed = {"first": low, "lanes": lanes, "part": part, "begin": begin, "end": end}
        values = {**self._values, **stage.own, **placed}
        if unknown := [name for name in names if name not in values]:
            there = few_of(sorted(values), unknown[0])
            raise ValueError(f"parameters of stage {stage.name} must be of {there}; got {few_of(unknown)}")
        inputs = [values[name] for name in names]
        return wp.launch(stage.run, dim=dim, inputs=inputs, device=self._device, record_cmd=True)


def _grouped(stages: Iterable[Stage], parts: int) -> list[tuple[int, list[Stage]]]:
    """Stages that follow each other without waiting, and into how many parts their entities are split."""

    def split_over(stage: Stage) -> str | None:
        return stage.over if parts > 1 and "begin" in stage.labels else None

    return [(1 if over is None else parts, list(group)) for over, group in groupby(stages, key=split_over)]


def launcher(device: Any) -> Callable[..., None]:
    """Make a function that launches kernels as `wp.launch` does: `launch(kernel, dim, inputs, outputs)`.

    What is launched with the very same arguments once more is called at once, in a tenth of the time. Structs must not
    be changed meanwhile, and numbers that are made anew for each launch make it as slow as Warp's own.
    """
    device = as_device(device)
    ready: dict[tuple, tuple] = {}

    def launch(kernel: Any, dim: Any, inputs: Sequence[Any], outputs: Sequence[Any]) -> None:
        key = (id(kernel), dim, *map(id, inputs), *map(id, outputs))
        known = ready.get(key)
        if known is None:
            if len(ready) >= _MOST_LAUNCHES:
                ready.clear()
            recorded = wp.launch(kernel, dim, inputs, outputs=outputs, device=device, record_cmd=True)
            call = Call(recorded) if device.is_cpu else cast(Any, recorded).launch
            # Kept, what has these ids lives on, and nothing else can have them.
            known = ready[key] = call, kernel, inputs, outputs
        known[0]()

    return launch


class _Graph:
    """Launches on a GPU that are replayed together."""

    def __init__(self, groups: Sequence[Sequence[Sequence[Any]]], device: Any):
        self._device = device
        self._launches = [launch for group in groups for task in group for launch in task]
        with wp.ScopedCapture(device) as capture:
            self._launch_all()
        self._graph: Any = capture.graph

    def __call__(self) -> None:
        if self._device.is_capturing:
            self._launch_all()
        else:
            wp.capture_launch(self._graph)

    def _launch_all(self) -> None:
        for launch in self._launches:
            launch.launch()
