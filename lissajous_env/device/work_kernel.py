"""How threads share work: compiled code that calls compiled kernels.

One thread leads: it opens group after group of tasks, takes tasks itself as long as there are any, and goes on when all
of the group are done. The others help.
"""

import warp as wp

from lissajous_env.device.compilation import OPTIONS

wp.set_module_options(OPTIONS)

APART = wp.constant(16)
"""Counters stand so many numbers apart, on cache lines of their own."""

_YIELD = wp.constant(1024)
"""Glances of one who waits after which another program may have the processor."""

_PATIENCE = wp.constant(1 << 14)
"""Glances after which a helper goes to sleep, half a millisecond or so."""


@wp.func_native(f"""
#if !defined(__CUDA_ARCH__)
    typedef void (*Kernel)(void*, void*);
    typedef wp::int32 (*Yield)(void);
    // Tasks are numbered through all runs of the work, so that one who comes late cannot take an old one again.
    wp::int64* const taken = counters.data;
    wp::int64* const opened = counters.data + {int(APART)};
    wp::int64* const done = counters.data + 2 * {int(APART)};
    const wp::int64 number = tasks.shape[0] - 1;

    const auto take = [&]() -> bool {{
        wp::int64 next = __atomic_load_n(taken, __ATOMIC_RELAXED);
        while (next < __atomic_load_n(opened, __ATOMIC_ACQUIRE)) {{
            if (__atomic_compare_exchange_n(taken, &next, next + 1, false, __ATOMIC_ACQUIRE, __ATOMIC_RELAXED)) {{
                for (wp::int64 k = tasks.data[next % number]; k < tasks.data[next % number + 1]; ++k) {{
                    const wp::int64* const call = calls.data + 3 * k;
                    ((Kernel)call[0])((void*)call[1], (void*)call[2]);
                }}
                __atomic_fetch_add(done, 1, __ATOMIC_RELEASE);
                return true;
            }}
        }}
        return false;
    }};
    wp::int64 glances = 0;
    const auto wait = [&]() {{
        glances += 1;
        if (yielding != 0 && glances % {int(_YIELD)} == 0)
            ((Yield)yielding)();
#if defined(__x86_64__) || defined(_M_X64)
        __builtin_ia32_pause();
#elif defined(__aarch64__)
        __asm__ volatile("yield");
#endif
    }};

    if (leads == 1) {{
        const wp::int64 before = __atomic_load_n(opened, __ATOMIC_RELAXED);
        for (wp::int64 group = 0; group < ends.shape[0]; ++group) {{
            const wp::int64 end = before + ends.data[group];
            __atomic_store_n(opened, end, __ATOMIC_RELEASE);
            while (take()) {{}}
            while (__atomic_load_n(done, __ATOMIC_ACQUIRE) < end)
                wait();
        }}
    }} else {{
        while (glances < {int(_PATIENCE)}) {{
            if (take())
                glances = 0;
            else if (__atomic_load_n(opened, __ATOMIC_ACQUIRE) % number == 0)
                return;  // the last group has been opened, and all its tasks are taken
            else
                wait();
        }}
    }}
#endif
""")
def _take_part(
    calls: wp.array(dtype=wp.int64),
    tasks: wp.array(dtype=wp.int64),
    ends: wp.array(dtype=wp.int64),
    counters: wp.array(dtype=wp.int64),
    yielding: wp.int64,
    leads: int,
):
    """Do tasks while there are any: one thread leads, opens group after group, and returns when all are done."""
    ...


@wp.kernel
def take_part(
    calls: wp.array(dtype=wp.int64),
    tasks: wp.array(dtype=wp.int64),
    ends: wp.array(dtype=wp.int64),
    counters: wp.array(dtype=wp.int64),
    yielding: wp.int64,
    leads: int,
):
    """Lead work, or help.

    Args:
        calls: (3 C,) addresses of function, bounds and arguments of each call.
        tasks: (T + 1,) first call of each task, and C.
        ends: (groups,) number of tasks up to the end of each group.
        counters: (3 APART,) tasks that were taken, that may be, and that are done.
        yielding: Address of the function by which a thread leaves the processor to others, or 0.
        leads: 1 for the thread that leads.
    """
    _take_part(calls, tasks, ends, counters, yielding, leads)
