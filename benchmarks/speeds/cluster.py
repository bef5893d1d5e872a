"""The time of a benchmark on Ray clusters of one node and of two nodes, with one processor each."""

import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from figures import Table
from rich.console import Console

from baselines.benchmark.running import run
from baselines.benchmark.statistics import between, number, summarize
from baselines.benchmark.types import Benchmark
from speeds import Options, Part

SCENARIO, POLICY = "evaders", "kuramoto-mpcc"
EPISODES, BATCH = 512, 16
_NODE = {"num_cpus": 1, "object_store_memory": 80_000_000}


@contextmanager
def cluster_of(nodes: int) -> Iterator[str]:
    """Start a cluster of some nodes on this machine, and yield its address."""
    from ray.cluster_utils import Cluster

    cluster: Any = Cluster(initialize_head=True, head_node_args=_NODE | {"include_dashboard": False})
    try:
        for _ in range(nodes - 1):
            cluster.add_node(**_NODE)
        yield cluster.address
    finally:
        cluster.shutdown()


def seconds(nodes: int, episodes: int) -> float:
    """Return the time of a benchmark on a cluster of some nodes, from its command to its report [s]."""
    with cluster_of(nodes) as address, tempfile.TemporaryDirectory() as folder:
        settings = Benchmark(
            scenarios=(SCENARIO,), policies=(POLICY,), episodes=episodes, batch=BATCH, replays=0,
            engine="ray", address=address, out=Path(folder) / "out",
        )  # fmt: skip
        begin = time.perf_counter()
        run(settings, console=Console(quiet=True))
        return time.perf_counter() - begin


def tables(options: Options) -> dict[str, Table]:
    """Measure, and return the table `cluster`."""
    episodes = 2 * BATCH if options.quick else EPISODES
    times: dict[int, list[float]] = {1: [], 2: []}
    for _ in range(options.rounds):
        for nodes, runs in times.items():
            runs.append(seconds(nodes, episodes))
    ratio = summarize([one / two for one, two in zip(times[1], times[2], strict=True)])
    beside = ["", f"{number(ratio.value)} ({between(ratio.low, ratio.high)})"]
    rows = [
        [f"{nodes} node{'s' * (nodes > 1)}", f"{episodes}", number(summarize(runs).value), number(min(runs)), words]
        for (nodes, runs), words in zip(times.items(), beside, strict=True)
    ]
    columns = ["nodes of one processor", "episodes", "s", "best [s]", "times as fast"]
    return {"cluster": {"columns": columns, "rows": rows}}


PART = Part(
    "cluster",
    f"`lissajous benchmark` of {SCENARIO} with {POLICY} over a Ray cluster of one node and of two",
    tables,
    rounds=3,
    needs={"ray": "cluster"},
)
