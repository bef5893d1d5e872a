"""The largest memory of a process with the batches of the part `step`."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor

from figures import Table

from speeds import Options, Part, step
from speeds.served import peak_memory


def peak(worlds: int, threads: int) -> float:
    """Make the batches, step each once, and return the largest memory of this process [MB]."""
    batch_steps = [step.batch(*what, worlds, threads) for what in step.BATCHES.values()]
    for batch_step in batch_steps:
        batch_step()
    return peak_memory()


def tables(options: Options) -> dict[str, Table]:
    """Measure, and return the table `memory`."""
    # Another process comes first, because compiling kernels takes more memory than all worlds.
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as pool:
        pool.submit(peak, 1, options.threads).result()
    rows = [["six batches", f"{options.worlds:,}", f"{peak(options.worlds, options.threads):.0f}"]]
    return {"memory": {"columns": ["", "worlds in each", "peak [MB]"], "rows": rows}}


PART = Part("memory", "the memory of a process with the batches of the part `step`", tables)
