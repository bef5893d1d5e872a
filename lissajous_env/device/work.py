"""Work that CPU threads share: calls of compiled kernels in an order, without the interpreter between them.

Work is a list of tasks that do not depend on each other, a task a list of launches in their order. The calling thread
begins at once and wakes the helpers, which otherwise sleep; every thread executes the next task as long as there are
any. So no thread waits for another one to wake up, which would take longer than most stages of a step.
"""

import contextlib
import ctypes
import os
import threading
from collections.abc import Sequence
from functools import cache
from itertools import chain
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.compilation import OPTIONS, load_together
from lissajous_env.device.devices import cores
from lissajous_env.device.locks import COMPILING, Turn, in_turn
from lissajous_env.device.warp_abi import Call

wp.set_module_options(OPTIONS)

_LEAST_STACK = 768 << 10
"""Stack of a helper [bytes]; more where the process has set a larger one for its threads."""
_TASKS_PER_THREAD = 4
"""Number of tasks for each thread; with several, a slower thread can execute fewer of them."""
_APART = wp.constant(16)
"""Distance between two counters [numbers], so that each is on a cache line of its own."""
_YIELD = wp.constant(1024)
"""Spins of a waiting thread after which it yields the processor to other programs."""


@wp.struct
class Queue:
    """Tasks, and how far they are done."""

    calls: wp.array2d(dtype=wp.int64)
    """(C, 3) addresses of function, bounds and arguments of each call."""
    tasks: wp.array(dtype=wp.int64)
    """(T + 1,) first call of each task, and C."""
    counters: wp.array(dtype=wp.int64)
    """(3 _APART,) number of tasks that are to be done, were begun, and are finished, counted through all runs."""
    yielding: wp.int64
    """Address of the function by which a thread yields the processor."""


@wp.func_native(f"""
#if !defined(__CUDA_ARCH__)
    typedef void (*Kernel)(void*, void*);
    typedef wp::int32 (*Yield)(void);
    wp::int64* const opened = queue.counters.data;
    wp::int64* const begun = opened + {int(_APART)};
    wp::int64* const done = begun + {int(_APART)};
    const wp::int64 number = queue.tasks.shape[0] - 1;
    if (leads)
        __atomic_fetch_add(opened, number, __ATOMIC_RELEASE);
    wp::int64 task = __atomic_load_n(begun, __ATOMIC_RELAXED);
    while (task < __atomic_load_n(opened, __ATOMIC_ACQUIRE)) {{
        if (!__atomic_compare_exchange_n(begun, &task, task + 1, false, __ATOMIC_ACQUIRE, __ATOMIC_RELAXED))
            continue;  // with the number of the task that is next now
        for (wp::int64 k = queue.tasks.data[task % number]; k < queue.tasks.data[task % number + 1]; ++k) {{
            const wp::int64* const call = queue.calls.data + 3 * k;
            ((Kernel)call[0])((void*)call[1], (void*)call[2]);
        }}
        __atomic_fetch_add(done, 1, __ATOMIC_RELEASE);
        task = __atomic_load_n(begun, __ATOMIC_RELAXED);
    }}
    for (int spins = 1; leads && __atomic_load_n(done, __ATOMIC_ACQUIRE) < *opened; ++spins) {{
        if (spins % {int(_YIELD)} == 0)
            ((Yield)queue.yielding)();
#if defined(__x86_64__) || defined(_M_X64)
        __builtin_ia32_pause();
#elif defined(__aarch64__)
        __asm__ volatile("yield");
#endif
    }}
#endif
""")
def _take_part(queue: Queue, leads: int):
    """Execute tasks while there are any; the leading thread adds them first, and waits until all are finished."""


@wp.kernel
def take_part(queue: Queue, leads: int):
    """Lead work, or help."""
    _take_part(queue, leads)


def load(kernels: Sequence[Any], device: Any) -> None:
    """Compile or load kernels side by side, on a CPU together with the one by which threads share their launches."""
    load_together([*kernels, take_part] if device.is_cpu else kernels, device, cores())


def task_count(most: int, device: Any, threads: int) -> int:
    """Return the number of tasks for CPU threads, from 1 to `most`; 1 on a GPU or for one thread."""
    return max(min(_TASKS_PER_THREAD * threads, most), 1) if device.is_cpu and threads > 1 else 1


class Work:
    """Launches that CPU threads share; on a GPU they are one graph.

    Threads share them as described above, because the lookups of Warp's graph on a CPU take longer than many kernels.

    Args:
        tasks: Launches that were recorded, of each task.
        device: Device on which they run.
        threads: Largest number of threads.
    """

    def __init__(self, tasks: Sequence[Sequence[Any]], device: Any, threads: int = 1):
        self.tasks, self._device, self.turn = tasks, device, Turn("a launch of kernels")
        self._launches = list(chain.from_iterable(tasks))
        if device.is_cpu:
            self._helpers = min(threads, len(tasks)) - 1
            self._calls = [Call(launch) for launch in self._launches]
            addresses = np.array([call.addresses for call in self._calls], dtype=np.uint64).view(np.int64)
            queue: Any = Queue()
            queue.calls = wp.array(addresses.reshape(-1, 3), dtype=wp.int64, device=device)
            queue.tasks = wp.array(np.cumsum([0, *map(len, tasks)]), dtype=wp.int64, device=device)
            queue.counters = wp.zeros(3 * int(_APART), dtype=wp.int64, device=device)
            queue.yielding = _yielding()
            self._queue = queue  # the calls contain the addresses of its arrays
            self._lead, self.help = (
                Call(wp.launch(take_part, 1, [queue, leads], device=device, record_cmd=True)) for leads in (1, 0)
            )
        else:
            with wp.ScopedCapture(device) as capture:
                self._launch_all()
            self._graph: Any = capture.graph

    @in_turn
    def __call__(self) -> None:
        """Do all of it."""
        self.lead()

    def lead(self) -> None:
        """Do all of it without taking a turn: the simulation has a turn of its own."""
        if self._device.is_capturing:  # by a user, whose graph is made of launches
            self._launch_all()
        elif self._device.is_cpu:
            for helper in _helpers(self._helpers):
                helper.wake(self)
            self._lead()
        else:
            wp.capture_launch(self._graph)

    def _launch_all(self) -> None:
        for launch in self._launches:
            launch.launch()


class _Helper:
    """A thread that sleeps until there is something to do."""

    def __init__(self):
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
                work.help()
            del work  # which would live until the next


_started: list[_Helper] = []


def _helpers(count: int) -> list[_Helper]:
    """Return the first helpers."""
    if len(_started) < count:
        with COMPILING:  # one at a time, because a helper sets the size of stacks for the whole process meanwhile
            _started.extend(_Helper() for _ in range(count - len(_started)))
    return _started[:count]


# Threads do not survive a fork.
os.register_at_fork(after_in_child=_started.clear)


@cache
def _yielding() -> int:
    """Return the address of the system's function that lets a thread yield the processor."""
    function = ctypes.CDLL(None).sched_yield
    return ctypes.cast(function, ctypes.c_void_p).value or 0
