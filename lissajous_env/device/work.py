"""Work that CPU threads share: calls of compiled kernels in an order, without the interpreter between them.

Work is a list of groups, a group a list of tasks, a task a list of launches. Tasks of a group are done side by side;
those of the next group begin when all are done. The calling thread begins at once and wakes
helpers, which sleep otherwise. A helper takes the next task as long as there are any. So no thread waits for another
to wake up, which would take longer than most stages of a step.
"""

import contextlib
import ctypes
import os
import threading
from collections.abc import Callable, Sequence
from functools import cache
from itertools import chain, pairwise
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.devices import cores
from lissajous_env.device.kernel_cache import load_together
from lissajous_env.device.stacks import LEAST
from lissajous_env.device.turns import Turn, in_turn
from lissajous_env.device.warp_abi import Call
from lissajous_env.device.work_kernel import APART, Plan, take_part

TASKS_PER_THREAD = 4
"""Tasks for each thread: a slower thread takes fewer."""


class Work:
    """Launches that CPU threads share; on a GPU they are made in their order.

    Args:
        groups: Launches that were recorded, of each task of each group.
        device: Where they run.
        threads: Largest number of threads.

    Attributes:
        launches: All of them, in their order.
    """

    def __init__(self, groups: Sequence[Sequence[Sequence[Any]]], device: Any, threads: int = 1):
        self._device, self.turn = device, Turn("a launch of kernels")
        tasks = [task for group in groups for task in group]
        self.launches = list(chain.from_iterable(tasks))
        if device.is_cpu:
            self._calls = [Call(launch) for launch in self.launches]
            self._bind([*map(len, tasks)], [*map(len, groups)], min(threads, max(map(len, groups))))

    def _bind(self, lengths: Sequence[int], sizes: Sequence[int], members: int) -> None:
        """Make the call by which each member takes part, for tasks of these lengths and groups of these sizes."""
        addresses = np.array([each.addresses for each in self._calls], dtype=np.uint64).view(np.int64)
        plan: Any = Plan()
        for name, values in {
            "calls": addresses.reshape(-1, 3),
            "tasks": np.cumsum([0, *lengths]),
            "ends": np.cumsum(sizes),
            "taken": np.zeros(len(lengths)),
            "counters": np.zeros(2 * int(APART)),
        }.items():
            setattr(plan, name, wp.array(values, dtype=wp.int64, device=self._device))
        plan.yielding, plan.members = _yielding(), members
        self._plan = plan  # whose arrays the calls know by their addresses
        self._parts = [
            Call(wp.launch(take_part, 1, [plan, member], device=self._device, record_cmd=True))
            for member in range(members)
        ]

    @in_turn
    def __call__(self) -> None:
        """Do all of it."""
        self.lead()

    def lead(self) -> None:
        """Do all of it without taking a turn: the simulation has a turn of its own."""
        if self._device.is_cpu and not self._device.is_capturing:
            for helper in _helpers(len(self._parts) - 1):
                helper.wake(self)
            self._parts[0]()
        else:
            for launch in self.launches:
                launch.launch()

    def help(self, member: int) -> None:
        """Do a part of what another thread leads now, as one of the members after the first."""
        self._parts[member]()

    def set_argument(self, index: int, value: Any) -> None:
        """Change one of the arguments of every launch."""
        for launch in self.launches:
            launch.set_param_at_index(index, value)
        if self._device.is_cpu:
            for call in self._calls:
                call.read_argument(index)


class SideBySide(Work):
    """Works that are done side by side, the launches of each in their order by one CPU thread.

    Args:
        works: At least one, on one CPU, without dependencies on each other.
        threads: Largest number of threads.
    """

    def __init__(self, works: Sequence[Work], threads: int):
        self._device, self.turn = works[0]._device, Turn("launches of kernels")
        self.launches = [launch for work in works for launch in work.launches]
        self._calls = [call for work in works for call in work._calls]
        self._bind([len(work.launches) for work in works], [len(works)], min(threads, len(works)))


def shared_launch(
    kernel: Any,
    size: int,
    inputs: Callable[[int], list[Any]],
    outputs: list[Any],
    device: Any,
    threads: int,
    smallest: int,
) -> Work:
    """Record launches of a kernel over `size` threads, in shares of `smallest` at least, for CPU threads to take.

    `inputs` gives what the kernel takes of the share that begins with a thread.
    """
    shares = min(TASKS_PER_THREAD * threads, max(size // smallest, 1)) if device.is_cpu and threads > 1 else 1
    edges = [size * share // shares for share in range(shares + 1)]
    load_together([take_part, kernel] if device.is_cpu else [kernel], device, cores)
    launches = [
        wp.launch(kernel, high - low, inputs(low), outputs=outputs, device=device, record_cmd=True)
        for low, high in pairwise(edges)
    ]
    return Work([[[launch] for launch in launches]], device, threads)


def interleaved(kernel: Any, size: int, arguments: Sequence[Any], device: Any) -> Work:
    """Record launches of a kernel over `size` threads for all cores, each of every n-th thread.

    The first two parameters of the kernel are the number of its first thread and n, the others are the arguments.
    """
    tasks = TASKS_PER_THREAD * cores() if device.is_cpu and cores() > 1 else 1
    launches = [
        wp.launch(kernel, -(-size // tasks), [task, tasks, *arguments], device=device, record_cmd=True)
        for task in range(tasks)
    ]
    return Work([[[launch] for launch in launches]], device, cores())


class _Helper:
    """A thread that sleeps until there is something to do."""

    def __init__(self, member: int):
        self._member = member
        self._asleep = threading.Lock()
        self._asleep.acquire()
        self._work: Work | None = None
        before = threading.stack_size(max(threading.stack_size(), 2 * LEAST))
        try:
            threading.Thread(target=self._run, name="lissajous", daemon=True).start()
        finally:
            threading.stack_size(before)

    def wake(self, work: Work) -> None:
        """Wake the thread to help, now or after its current work."""
        self._work = work
        if self._asleep.locked():
            with contextlib.suppress(RuntimeError):  # another thread has just woken it
                self._asleep.release()

    def _run(self) -> None:
        while True:
            self._asleep.acquire()
            work, self._work = self._work, None
            if work is not None:
                work.help(self._member)
            del work  # which would live until the next


_started: list[_Helper] = []


def _helpers(count: int) -> list[_Helper]:
    """Return the first helpers."""
    while len(_started) < count:
        _started.append(_Helper(len(_started) + 1))
    return _started[:count]


if hasattr(os, "register_at_fork"):
    # Threads do not survive a fork.
    os.register_at_fork(after_in_child=_started.clear)


@cache
def _yielding() -> int:
    """Address of the system's function by which a thread leaves the processor to others."""
    function = ctypes.CDLL(None).sched_yield
    return ctypes.cast(function, ctypes.c_void_p).value or 0
