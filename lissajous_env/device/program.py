"""Programs: kernels in an order, bound to arrays by the names of their parameters, ready to run.

A kernel is one that `@stage` of `device/stage.py` has made. Its parameters are matched by name.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby, pairwise
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.abreast import width_on
from lissajous_env.device.devices import as_device, compile_quietly
from lissajous_env.device.stage import LAUNCH, WORLD
from lissajous_env.device.warp_abi import Call, content_of, is_struct, names_of_arguments
from lissajous_env.device.work import Work, load
from lissajous_env.wording import few_of

_MOST_LAUNCHES = 64
"""Largest number of recorded launches of a launcher."""


@dataclass(frozen=True)
class Stage:
    """One stage of a program."""

    name: str
    """Its name, new in its program."""
    run: Any
    """A kernel that `@stage` has made, or a function without arguments that is called on the host."""
    when: bool = True
    """False to leave the stage out."""
    own: Mapping[str, Any] = field(default_factory=dict)
    """Arguments of its kernel besides the values of the program, by name."""

    def __post_init__(self) -> None:
        if self.is_kernel and not hasattr(self.run, "by_block"):
            raise ValueError(f"kernel of stage {self.name} must be made by @stage, got one by @wp.kernel")

    @property
    def over(self) -> str:
        """Return the entities of its kernel."""
        return getattr(self.run, "over", WORLD)

    @property
    def is_kernel(self) -> bool:
        """Return whether it is launched on the device."""
        return isinstance(self.run, wp.Kernel)

    @property
    def writes(self) -> tuple[str, ...]:
        """Names of what it changes, as `robots.phase`; none for a function or one that changes the whole state."""
        return getattr(self.run, "writes", ())

    @property
    def about(self) -> str:
        """Return what it does, in a line."""
        return ((self.run.func if self.is_kernel else self.run).__doc__ or "").strip().partition("\n")[0]


class Program:
    """Stages in their order, ready to run; consecutive kernels are `Work`.

    Args:
        stages: Stages to run; those whose `when` is False, and those without entities, are left out.
        values: Values of the kernels' parameters, by name.
        sizes: Number of entities in a world, by kind of entity.
        num_worlds: W.
        device: Warp device.
        num_tasks: Number of tasks that CPU threads share, for about as many worlds each.
        threads: Largest number of CPU threads.

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
        num_tasks: int = 1,
        threads: int = 1,
    ):
        self.stages = tuple(stage for stage in stages if stage.when and sizes.get(stage.over, 1) > 0)
        self._values, self._sizes, self._device = values, sizes, device
        load([stage.run for stage in self.stages if stage.is_kernel], device)
        edges = np.linspace(0, num_worlds, num_tasks + 1).astype(int).tolist()
        parts: list[Any] = []
        for is_kernel, run in groupby(self.stages, key=lambda stage: stage.is_kernel):
            part = list(run)
            if is_kernel:
                tasks = [[self._launch(stage, *worlds) for stage in part] for worlds in pairwise(edges)]
                part = [Work(tasks, device, threads)]
            parts += part
        self.work: Work | None = parts[0] if len(parts) == 1 and isinstance(parts[0], Work) else None
        """All of it, where it is kernels alone."""
        self._calls = [part.lead if isinstance(part, Work) else part.run for part in parts]

    def __call__(self) -> None:
        """Run all stages once."""
        for call in self._calls:
            call()

    def __str__(self) -> str:
        names = [names_of_arguments(stage.run) if stage.is_kernel else [] for stage in self.stages]
        matched = [", ".join(name for name in of_stage if name not in LAUNCH) for of_stage in names]
        rows = [(stage.name, stage.over, stage.about, line) for stage, line in zip(self.stages, matched, strict=True)]
        widths = [max(len(row[k]) for row in rows) for k in range(3)]
        lines = ["  ".join([*map(str.ljust, row[:3], widths), row[3]]).rstrip() for row in rows]
        indent = " " * (widths[0] + 2)
        return "\n".join(
            f"{line}\n{indent}writes {', '.join(stage.writes) or 'unknown'}"
            for line, stage in zip(lines, self.stages, strict=True)
        )

    def _lanes(self, stage: Stage) -> int:
        """Return the number of threads that share the entities of a world."""
        return 1 if self._device.is_cpu else self._sizes.get(stage.over, 1)

    def _launch(self, stage: Stage, low: int, high: int) -> Any:
        """Record the launch of a stage for the worlds from `low` to `high` - 1."""
        size, names = self._sizes.get(stage.over, 1), names_of_arguments(stage.run)
        lanes = self._lanes(stage)
        blocks = -(-(high - low) * size // width_on(self._device))
        dim = blocks if stage.run.by_block else (high - low, lanes)
        launch = dict(zip(LAUNCH, (low, high, lanes, size), strict=True))
        values = {**self._values, **stage.own, **launch}
        if unknown := [name for name in names if name not in values]:
            there = few_of(sorted(values), unknown[0])
            raise ValueError(f"parameters of stage {stage.name} must be of {there}; got {few_of(unknown)}")
        inputs = [values[name] for name in names]
        return wp.launch(stage.run, dim=dim, inputs=inputs, device=self._device, record_cmd=True)


def launcher(device: Any) -> Callable[..., None]:
    """Make a function that launches kernels as `wp.launch` does: `launch(kernel, dim, inputs, outputs)`.

    A launch with the same arrays, structs and numbers as an earlier one is made from its record, in a tenth of the
    time, unless a struct has changed since.
    """
    device = as_device(device)
    ready: dict[tuple, tuple] = {}

    def launch(kernel: Any, dim: Any, inputs: Sequence[Any], outputs: Sequence[Any]) -> None:
        arguments = (*inputs, *outputs)
        key = kernel, dim, *[argument if isinstance(argument, (int, float)) else id(argument) for argument in arguments]
        known = ready.get(key)
        if known is None or any(content_of(struct) != content for struct, content in known[3]):
            if len(ready) >= _MOST_LAUNCHES:
                ready.clear()
            with compile_quietly():
                recorded: Any = wp.launch(kernel, dim, inputs, outputs=outputs, device=device, record_cmd=True)
            call = Call(recorded) if device.is_cpu else recorded.launch
            structs = [(argument, content_of(argument)) for argument in arguments if is_struct(argument)]
            # The arguments are stored, so that no other object can have their ids.
            known = ready[key] = call, recorded.launch, arguments, structs
        call, launch_again, *_ = known
        if device.is_capturing:  # by a user, whose graph is made of launches
            launch_again()
        else:
            call()

    return launch
