"""Programs: kernels in an order, bound to arrays by the names of their parameters, ready to run.

A kernel of a program takes `first`, the first world of the block that it works on, and, unless it goes over whole
worlds, `lanes`, how many threads share the entities of a world: on a GPU there is one for each entity, on a CPU one
that loops over them all, which saves its setup. One that takes `last` instead, the world after the block, goes over
the entities of all its worlds, side by side (`lissajous_env.device.abreast`). One that takes `begin` and `end` too, and
goes over the entities from the one to the other, may have those of a large world split among CPU threads; the number of
the share is `part`. It must not write what another part reads or writes, nor add to it: an atomic operation is none on
a CPU. Every other parameter is looked up by its name.
"""

import ctypes
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from itertools import groupby, pairwise
from typing import Any, cast

import numpy as np
import warp as wp

from lissajous_env.device.abreast import width_on
from lissajous_env.device.devices import as_device, side_by_side

WORLD, ROBOT, TARGET, ROW, FIELD_ROW, BIN = "world", "robot", "target", "row", "field row", "bin"

_PLACED = ("first", "last", "lanes", "part", "begin", "end")
"""Parameters that say which worlds and entities a launch is for."""

_MOST_LAUNCHES = 64
"""Launches that a launcher keeps ready."""

_BLOCK = 256
"""Worlds below which a CPU thread of its own costs more than it saves."""

_PART = 8192
"""Targets, or other entities of all worlds together, below which it does."""


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
        names = [argument.label for argument in self.run.adj.args] if self.is_kernel else []
        return tuple(name for name in names if name not in _PLACED)

    @property
    def about(self) -> str:
        """What it does, in a line."""
        return ((self.run.func if self.is_kernel else self.run).__doc__ or "").strip().partition("\n")[0]


class Program:
    """Stages in their order, ready to run.

    On a GPU neighbouring kernels are one graph. On a CPU a graph of Warp's would do, but what it looks up for each
    kernel takes longer than to call the compiled functions one after the other, which is done for each thread's block
    of worlds.

    Args:
        stages: What is run; those whose `when` is False, and those over nothing, are left out.
        values: What the kernels' parameters are bound to, by name.
        sizes: Number of entities in a world, by what a stage goes over.
        num_worlds: W.
        device: Warp device.
        threads: CPU threads over which the worlds are split.

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
        threads: int,
    ):
        self.stages = tuple(stage for stage in stages if stage.when and sizes.get(stage.over, 1) > 0)
        self._values, self._sizes, self._device = values, sizes, device
        edges = np.linspace(0, num_worlds, _blocks(num_worlds, device, threads) + 1).astype(int)
        blocks = [(int(low), int(high)) for low, high in pairwise(edges)]
        groups = groupby(self.stages, key=lambda each: (each.is_kernel, self._parts(each, num_worlds, threads)))
        self._calls: list[Callable[[], None]] = []
        for (is_kernel, parts), group in groups:
            if not is_kernel:
                self._calls += [stage.run for stage in group]
                continue
            ready, together = _Calls if device.is_cpu else _Graph, list(group)
            shares = [(*block, part, parts) for block in blocks for part in range(parts)]
            tasks = [ready(device, [self._launch(stage, *share) for stage in together]) for share in shares]
            self._calls.append(tasks[0] if len(tasks) == 1 else partial(side_by_side, tasks, threads))

    def __call__(self) -> None:
        """Run all stages once."""
        for call in self._calls:
            call()

    def __str__(self) -> str:
        rows = [(stage.name, stage.over, stage.about, ", ".join(stage.parameters)) for stage in self.stages]
        widths = [max(len(row[k]) for row in rows) for k in range(3)]
        return "\n".join("  ".join([*map(str.ljust, row[:3], widths), row[3]]).rstrip() for row in rows)

    def _parts(self, stage: Stage, num_worlds: int, threads: int) -> int:
        """Into how many parts the entities of a stage are split."""
        if not stage.is_kernel or "begin" not in [argument.label for argument in stage.run.adj.args]:
            return 1
        return parts_of(self._sizes[stage.over], num_worlds, self._device, threads)

    def _lanes(self, stage: Stage) -> int:
        """How many threads share the entities of a world."""
        return 1 if self._device.is_cpu else self._sizes.get(stage.over, 1)

    def _launch(self, stage: Stage, low: int, high: int, part: int, parts: int) -> Any:
        lanes = self._lanes(stage)
        begin, end = (self._sizes.get(stage.over, 0) * edge // parts for edge in (part, part + 1))
        placed = {"first": low, "last": high, "lanes": lanes, "part": part, "begin": begin, "end": end}
        values = {**self._values, **stage.own, **placed}
        names = [argument.label for argument in stage.run.adj.args]
        if unknown := [name for name in names if name not in values]:
            there = ", ".join(sorted(values))
            raise ValueError(f"parameters of stage {stage.name} must be of {there}; got {', '.join(unknown)}")
        size: tuple[int, ...] = (high - low,) if stage.over == WORLD else (high - low, lanes)
        if "last" in names:
            size = (-(-(high - low) * self._sizes[stage.over] // width_on(self._device)),)
        return wp.launch(
            stage.run, dim=size, inputs=[values[name] for name in names], device=self._device, record_cmd=True
        )


def _blocks(num_worlds: int, device: Any, threads: int) -> int:
    """Number of blocks of worlds that run side by side."""
    return min(threads, -(-num_worlds // _BLOCK)) if device.is_cpu else 1


def parts_of(size: int, num_worlds: int, device: Any, threads: int) -> int:
    """Into how many parts so many entities of a world are split: on a CPU, where there are too few worlds to split."""
    if not device.is_cpu or _blocks(num_worlds, device, threads) > 1:
        return 1
    return max(1, min(threads, size * num_worlds // _PART))


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
            call = _Calls(device, [recorded]) if device.is_cpu else cast(Any, recorded).launch
            # Kept, what has these ids lives on, and nothing else can have them.
            known = ready[key] = call, kernel, inputs, outputs
        known[0]()

    return launch


class _Calls:
    """Launches on a CPU whose arguments are laid out once, where Warp does so at each launch."""

    def __init__(self, device: Any, launches: Sequence[Any]):
        self._device, self._launches = device, launches
        self._arguments = [_laid_out(launch.params[1:]) for launch in launches]
        self._calls = [
            (launch.hooks.forward, ctypes.byref(launch.params[0]), ctypes.byref(arguments))
            for launch, arguments in zip(launches, self._arguments, strict=True)
        ]

    def __call__(self) -> None:
        if self._device.is_capturing:  # by a user, whose graph is made of launches
            for launch in self._launches:
                launch.launch()
        else:
            for function, bounds, arguments in self._calls:
                function(bounds, arguments)


def _laid_out(values: Sequence[Any]) -> ctypes.Structure:
    """Put the arguments of a kernel into one struct, as the compiled kernel reads them."""
    fields = [(f"argument_{k}", type(value)) for k, value in enumerate(values)]
    return type("Arguments", (ctypes.Structure,), {"_fields_": fields})(*values)


class _Graph:
    """Launches on a GPU that are replayed together."""

    def __init__(self, device: Any, launches: Sequence[Any]):
        self._device, self._launches = device, launches
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
