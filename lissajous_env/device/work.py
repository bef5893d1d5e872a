"""Work that CPU threads share: calls of compiled kernels in an order, without the interpreter between them.

Work is a list of groups, a group a list of tasks, a task a list of launches. Tasks of a group run in parallel; the next
group begins when all of them have finished. The calling thread begins at once and wakes the helpers, which otherwise
sleep. A helper executes the next task as long as there are any. So no thread waits for another one to wake up, which
would take longer than most stages of a step.

In compiled code, one thread leads: it opens one group of tasks after the other, executes tasks itself as long as there
are any, and continues when all tasks of the group are finished. The other threads help. Each searches for tasks from an
index of its own, so that it mostly executes the same tasks as in the previous run, whose data are still in its cache.
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

from lissajous_env.device.compilation import OPTIONS, load_together
from lissajous_env.device.devices import cores
from lissajous_env.device.locks import Turn, in_turn
from lissajous_env.device.warp_abi import Call

wp.set_module_options(OPTIONS)

_LEAST_STACK = 768 << 10
"""Least stack of a helper [bytes], where threads of the process have less."""
TASKS_PER_THREAD = 4
"""Number of tasks for each thread; with several, a slower thread can execute fewer of them."""
APART = wp.constant(16)
"""Distance between two counters [numbers], so that each is on a cache line of its own."""

_YIELD = wp.constant(1024)
"""Spins of a waiting thread after which it yields the processor to other programs."""

_PATIENCE = wp.constant(1 << 14)
"""Spins after which a helper goes to sleep while another works, half a millisecond or so."""

_LINGER = wp.constant(1 << 10)
"""Spins for which a helper waits for the next run; this takes less time than waking it up."""


@wp.struct
class Plan:
    """Tasks, and how far they are done."""

    calls: wp.array2d(dtype=wp.int64)
    """(C, 3) addresses of function, bounds and arguments of each call."""
    tasks: wp.array(dtype=wp.int64)
    """(T + 1,) first call of each task, and C."""
    ends: wp.array(dtype=wp.int64)
    """(groups,) number of tasks up to the end of each group."""
    taken: wp.array(dtype=wp.int64)
    """(T,) number of runs in which each task was executed."""
    counters: wp.array(dtype=wp.int64)
    """(2 APART,) number of opened groups, and of finished tasks."""
    yielding: wp.int64
    """Address of the function by which a thread yields the processor."""
    members: wp.int32
    """Largest number of threads that take part."""


@wp.func_native(f"""
#if !defined(__CUDA_ARCH__)
    typedef void (*Kernel)(void*, void*);
    typedef wp::int32 (*Yield)(void);
    // Both are counted through all runs of the work.
    wp::int64* const opened = plan.counters.data;
    wp::int64* const done = plan.counters.data + {int(APART)};
    const wp::int64 groups = plan.ends.shape[0], number = plan.tasks.shape[0] - 1;

    // Take a task of the group that is open; whoever comes late finds that all were taken in this run, or in a later.
    const auto take = [&](const wp::int64 open) -> bool {{
        if (open == 0)
            return false;
        const wp::int64 run = (open - 1) / groups, group = (open - 1) % groups;
        const wp::int64 begin = group == 0 ? 0 : plan.ends.data[group - 1], size = plan.ends.data[group] - begin;
        for (wp::int64 k = 0; k < size; ++k) {{
            const wp::int64 task = begin + (member * size / plan.members + k) % size;
            wp::int64 before = run;
            if (__atomic_load_n(&plan.taken.data[task], __ATOMIC_RELAXED) == run
                && __atomic_compare_exchange_n(
                    &plan.taken.data[task], &before, run + 1, false, __ATOMIC_ACQUIRE, __ATOMIC_RELAXED)) {{
                for (wp::int64 k = plan.tasks.data[task]; k < plan.tasks.data[task + 1]; ++k) {{
                    const wp::int64* const call = plan.calls.data + 3 * k;
                    ((Kernel)call[0])((void*)call[1], (void*)call[2]);
                }}
                __atomic_fetch_add(done, 1, __ATOMIC_RELEASE);
                return true;
            }}
        }}
        return false;
    }};
    wp::int64 spins = 0;
    const auto wait = [&]() {{
        spins += 1;
        if (spins % {int(_YIELD)} == 0)
            ((Yield)plan.yielding)();
#if defined(__x86_64__) || defined(_M_X64)
        __builtin_ia32_pause();
#elif defined(__aarch64__)
        __asm__ volatile("yield");
#endif
    }};

    if (member == 0) {{
        const wp::int64 before = __atomic_load_n(opened, __ATOMIC_RELAXED);
        for (wp::int64 group = 0; group < groups; ++group) {{
            __atomic_store_n(opened, before + group + 1, __ATOMIC_RELEASE);
            while (take(before + group + 1)) {{}}
            while (__atomic_load_n(done, __ATOMIC_ACQUIRE) < before / groups * number + plan.ends.data[group])
                wait();
        }}
    }} else {{
        while (spins < {int(_PATIENCE)}) {{
            const wp::int64 open = __atomic_load_n(opened, __ATOMIC_ACQUIRE);
            if (take(open))
                spins = 0;
            else if (open % groups == 0 && spins >= {int(_LINGER)})
                return;  // the last group is open, and all its tasks are taken
            else
                wait();
        }}
    }}
#endif
""")
def _take_part(plan: Plan, member: int):
    """Execute tasks while there are any; the leading thread opens one group after the other."""


@wp.kernel
def take_part(plan: Plan, member: int):
    """Lead work, as member 0, or help."""
    _take_part(plan, member)


class Work:
    """Launches that CPU threads share; on a GPU they are made in their order.

    Args:
        groups: Launches that were recorded, of each task of each group.
        device: Device on which they run.
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
        """Make the call that each thread executes, for tasks of these lengths and groups of these sizes."""
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
        self._plan = plan  # the calls contain the addresses of their arrays
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
    """Works that run in parallel; one CPU thread executes the launches of each in order.

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
    """Record launches of a kernel over `size` threads, in shares of at least `smallest`, which CPU threads execute.

    `inputs` returns the kernel's inputs for the share that begins with the given thread.
    """
    shares = min(TASKS_PER_THREAD * threads, max(size // smallest, 1)) if device.is_cpu and threads > 1 else 1
    edges = [size * share // shares for share in range(shares + 1)]
    load_together([take_part, kernel] if device.is_cpu else [kernel], device, cores)
    launches = [
        wp.launch(kernel, high - low, inputs(low), outputs=outputs, device=device, record_cmd=True)
        for low, high in pairwise(edges)
    ]
    return Work([[[launch] for launch in launches]], device, threads)


class _Helper:
    """A thread that sleeps until there is something to do."""

    def __init__(self, member: int):
        self._member = member
        self._asleep = threading.Lock()
        self._asleep.acquire()
        self._work: Work | None = None
        before = threading.stack_size(max(threading.stack_size(), _LEAST_STACK))
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


# Threads do not survive a fork.
os.register_at_fork(after_in_child=_started.clear)


@cache
def _yielding() -> int:
    """Return the address of the system's function that lets a thread yield the processor."""
    function = ctypes.CDLL(None).sched_yield
    return ctypes.cast(function, ctypes.c_void_p).value or 0
