"""Work shared by threads: compiled code that calls compiled kernels.

One thread leads: it opens one group of tasks after the other, executes tasks itself as long as there are any, and
continues when all tasks of the group are finished. The other threads help. Each searches for tasks from an index of its
own, so that it mostly executes the same tasks as in the previous run, whose data are still in its cache.
"""

import warp as wp

from lissajous_env.device.compilation import OPTIONS

wp.set_module_options(OPTIONS)

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
