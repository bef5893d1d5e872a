"""Programs: kernels in an order, bound to arrays by the names of their parameters, ready to run.

The layout of a kernel determines what each of its threads processes. A kernel that `@stage` of `device/stage.py` makes
has one of these; so has a kernel of a user, by its parameters:

| layout   | parameters                       | a thread works on                                                  |
|----------|----------------------------------|--------------------------------------------------------------------|
| `WORLDS` | `first`                          | world `first + wp.tid()`                                           |
| `LANES`  | `first`, `lanes`                 | each `lanes`-th entity of a world: on a GPU one, on a CPU all      |
| `PARTS`  | `first`, `lanes`, `begin`, `end` | the same, of the entities from `begin` to `end - 1`                |
| `BLOCKS` | `begin`, `end`                   | entities of all worlds in a row, side by side: `device/abreast.py` |

`entities` is the number of entities of a world, for kernels that need it.

With the layouts `PARTS` and `BLOCKS`, CPU threads may share the entities of a large world. Such a stage begins when all
threads have finished the stages before it. Without a `barrier`, it begins on a part as soon as the previous stage has
finished that part; it must then not read data of other parts that the stages since the last barrier write. A stage over
other entities than the previous one always waits. Stages of these layouts write to entities of other parts only by the
functions of `lissajous_env.device.atomic`.

All other parameters of a kernel are matched by name.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from typing import Any, cast

import numpy as np
import warp as wp

from lissajous_env.device.abreast import width_on
from lissajous_env.device.compilation import load_together
from lissajous_env.device.devices import as_device, cores
from lissajous_env.device.stage import BLOCKS, LANES, PARTS, WORLD, WORLDS
from lissajous_env.device.warp_abi import Call, content_of, is_struct, names_of_arguments
from lissajous_env.device.work import TASKS_PER_THREAD, Work
from lissajous_env.wording import few_of

_LAYOUTS = {
    ("first",): WORLDS,
    ("first", "lanes"): LANES,
    ("first", "lanes", "begin", "end"): PARTS,
    ("begin", "end"): BLOCKS,
}
"""Layouts by the parameters that select the worlds and entities of a launch."""
_PLACES = frozenset(name for names in _LAYOUTS for name in names)

_MOST_LAUNCHES = 64
"""Largest number of recorded launches of a launcher."""

_SHARE = 100_000
"""Work below which waking a thread for it does not pay [ns]."""


@dataclass(frozen=True)
class Stage:
    """One stage of a program."""

    name: str
    """Its name, new in its program."""
    run: Any
    """A Warp kernel, or a function without arguments that is called on the host."""
    over: str = WORLD
    """Entities of a kernel that `@stage` has not made: WORLD, ROBOT, TARGET, ROW, FIELD_ROW or BIN."""
    barrier: bool = True
    """False for a PARTS or BLOCKS stage that does not wait for the stages before it, as the module describes."""
    when: bool = True
    """False to leave the stage out."""
    own: Mapping[str, Any] = field(default_factory=dict)
    """Arguments of its kernel besides the values of the program, by name."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "over", getattr(self.run, "over", self.over))
        if self.is_kernel and (self.layout is None or (self.layout == WORLDS) != (self.over == WORLD)):
            of = (
                "of worlds must have first" if self.over == WORLD else "must have first, lanes, perhaps with begin, end"
            )
            got = ", ".join(name for name in self.labels if name in _PLACES) or "none of them"
            raise ValueError(f"kernel of stage {self.name} {of}, got {got}")

    @property
    def layout(self) -> str | None:
        """Return the layout of its kernel; None without one."""
        return _LAYOUTS.get(tuple(name for name in self.labels if name in _PLACES))

    @property
    def is_kernel(self) -> bool:
        """Return whether it is launched on the device."""
        return isinstance(self.run, wp.Kernel)

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the kernel's parameters that are matched in the state and the constants."""
        return tuple(name for name in self.labels if name not in _PLACES | {"entities"})

    @property
    def writes(self) -> tuple[str, ...]:
        """Names of what it changes, as `robots.phase`; none where its kernel does not say it."""
        return getattr(self.run, "writes", ())

    @property
    def is_split(self) -> bool:
        """Return whether CPU threads may share the entities of a world."""
        return self.layout in (PARTS, BLOCKS)

    @property
    def labels(self) -> list[str]:
        """Names of the kernel's parameters."""
        return names_of_arguments(self.run) if self.is_kernel else []

    @property
    def about(self) -> str:
        """Return what it does, in a line."""
        return ((self.run.func if self.is_kernel else self.run).__doc__ or "").strip().partition("\n")[0]


@dataclass(frozen=True)
class Split:
    """Division of the work on some worlds among CPU threads."""

    threads: int = 1
    """Number of threads."""
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
        return Split(threads, min(TASKS_PER_THREAD * threads, shares, num_worlds))
    parts = max(1, min(-(-threads // num_worlds), shares // num_worlds))
    return Split(threads, num_worlds, parts)


class Program:
    """Stages in their order, ready to run.

    On a GPU, consecutive kernels are one graph. On a CPU they are `Work`, because the lookups of Warp's own graph take
    longer than many of the kernels.

    Args:
        stages: Stages to run; those whose `when` is False, and those without entities, are left out.
        values: Values of the kernels' parameters, by name.
        sizes: Number of entities in a world, by kind of entity.
        num_worlds: W.
        device: Warp device.
        split: Division of the work among CPU threads.

    Raises:
        ValueError: a kernel has a parameter for which there is no value; the message names stage and parameter.
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
        load_together((stage.run for stage in self.stages if stage.is_kernel), device, cores)
        edges = np.linspace(0, num_worlds, split.blocks + 1).astype(int).tolist()
        self._blocks = list(pairwise(edges))
        self.work: Work | None = None
        """All of it, where it is kernels alone, on a CPU."""
        self._calls: list[Callable[[], None]] = []
        for is_kernel, run in groupby(self.stages, key=lambda stage: stage.is_kernel):
            if is_kernel:
                groups = [
                    [self._task(group, *share) for share in self._shares(split.parts if group[0].is_split else 1)]
                    for group in _grouped(run, split.parts)
                ]
                if device.is_cpu:
                    self.work = Work(groups, device, split.threads)
                    self._calls.append(self.work.lead)
                else:
                    self._calls.append(_Graph(groups, device))
            else:
                self._calls += [stage.run for stage in run]
        if len(self._calls) != 1:
            self.work = None

    def __call__(self) -> None:
        """Run all stages once."""
        for call in self._calls:
            call()

    def __str__(self) -> str:
        rows = [(stage.name, stage.over, stage.about, ", ".join(stage.parameters)) for stage in self.stages]
        widths = [max(len(row[k]) for row in rows) for k in range(3)]
        return "\n".join("  ".join([*map(str.ljust, row[:3], widths), row[3]]).rstrip() for row in rows)

    def _shares(self, parts: int) -> list[tuple[int, int, int, int]]:
        """Return, for each task, its first world, the one after its last, and number and count of its part of these."""
        return [(low, high, part, parts) for low, high in self._blocks for part in range(parts)]

    def _lanes(self, stage: Stage) -> int:
        """Return the number of threads that share the entities of a world."""
        return 1 if self._device.is_cpu else self._sizes.get(stage.over, 1)

    def _task(self, stages: Sequence[Stage], *share: int) -> list[Any]:
        """Return the launches of those stages that have entities in this share."""
        return [launch for stage in stages if (launch := self._launch(stage, *share)) is not None]

    def _launch(self, stage: Stage, low: int, high: int, part: int, parts: int) -> Any:
        size, lanes, names = self._sizes.get(stage.over, 1), self._lanes(stage), stage.labels
        begin, end = (size * edge // parts for edge in (part, part + 1))
        dim: tuple[int, ...] = (high - low,) if stage.layout == WORLDS else (high - low, lanes)
        if stage.layout == BLOCKS:
            begin, end = low * size + begin, (high - 1) * size + end
            dim = (-(-(end - begin) // width_on(self._device)),)
        placed = {"first": low, "lanes": lanes, "begin": begin, "end": end, "entities": size}
        values = {**self._values, **stage.own, **placed}
        if unknown := [name for name in names if name not in values]:
            there = few_of(sorted(values), unknown[0])
            raise ValueError(f"parameters of stage {stage.name} must be of {there}; got {few_of(unknown)}")
        inputs = [values[name] for name in names]
        return wp.launch(stage.run, dim=dim, inputs=inputs, device=self._device, record_cmd=True)


def _grouped(stages: Iterable[Stage], parts: int) -> list[list[Stage]]:
    """Return groups of stages that follow each other; each group waits until all threads have done the one before."""
    groups: list[list[Stage]] = []
    for stage in stages:
        if groups and (parts == 1 or not _waits(stage, groups[-1][-1])):
            groups[-1].append(stage)
        else:
            groups.append([stage])
    return groups


def _waits(stage: Stage, before: Stage) -> bool:
    """Return whether a stage of a world whose entities threads share waits for the one before it."""
    if stage.is_split and before.is_split:
        return stage.barrier or stage.over != before.over
    return stage.is_split or before.is_split


def launcher(device: Any) -> Callable[..., None]:
    """Make a function that launches kernels as `wp.launch` does: `launch(kernel, dim, inputs, outputs)`.

    A launch with the same arrays, structs and numbers as an earlier one is made from its record, in a tenth of the
    time, unless a struct has changed since.
    """
    device = as_device(device)
    ready: dict[tuple, tuple] = {}

    def launch(kernel: Any, dim: Any, inputs: Sequence[Any], outputs: Sequence[Any]) -> None:
        arguments = (*inputs, *outputs)
        key = kernel, dim, *[each if isinstance(each, (int, float)) else id(each) for each in arguments]
        known = ready.get(key)
        if known is None or any(content_of(struct) != content for struct, content in known[2]):
            if len(ready) >= _MOST_LAUNCHES:
                ready.clear()
            recorded = wp.launch(kernel, dim, inputs, outputs=outputs, device=device, record_cmd=True)
            call = Call(recorded) if device.is_cpu else cast(Any, recorded).launch
            structs = [(each, content_of(each)) for each in arguments if is_struct(each)]
            # The arguments are stored, so that no other object can have their ids.
            known = ready[key] = call, arguments, structs
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
