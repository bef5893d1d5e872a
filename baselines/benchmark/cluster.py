"""The engine of a benchmark on many machines: Ray plays its batches of episodes over a cluster.

The driver alone writes the journal, a batch at a time, when it has come back whole. So the loss of a worker, of a node
or of the driver itself costs the batches that were being played, and these are played again: no episode is lost or
doubled. Machines of one kind return the rows of the engine `local`, bit for bit.
"""

import contextlib
import logging
from collections import deque
from collections.abc import Iterator
from functools import partial
from typing import Any

from baselines.benchmark.local import batches_or_failure, failure_of
from baselines.benchmark.results_folder import score_versions
from baselines.benchmark.table import Rows
from baselines.benchmark.types import Benchmark, Cell, Failure, Finish, Work
from baselines.policies.registry import fingerprint_of
from lissajous_env.console.terminal import Progress
from lissajous_env.identity import MODULE
from lissajous_env.plugins import of_extra
from lissajous_env.wording import require, where_raised

_RETRIES = 3
"""Times that a batch is played again after its worker or node was lost: a policy that kills its process must end."""
_AHEAD = 2
"""Batches handed out for each CPU, so that none waits for work."""
_STORE = 100_000_000
"""Memory that the workers of a local Ray share [bytes]; they exchange little."""
_ray = partial(of_extra, "ray", "engine ray", "cluster")
"""Function that returns the library."""


def check(device: str) -> None:
    """Check that a Ray cluster can play on a device.

    Raises:
        ValueError: Ray is not installed, or the device has a number.
    """
    _ray()
    rule = "must be cpu or cuda, because Ray selects the device"
    require(device in ("cpu", "cuda"), "device of engine ray", rule, device)


@contextlib.contextmanager
def connected(address: str | None) -> Iterator[Any]:
    """Yield Ray, connected to the cluster at an address, or to one on this machine that ends with the block.

    A process that is connected already stays with the cluster that it has.

    Raises:
        ValueError: Ray is not installed, or the cluster cannot be joined.
        ConnectionError: the cluster cannot be reached.
    """
    ray = _ray()
    if ray.is_initialized():
        yield ray
        return
    own = {"object_store_memory": _STORE, "include_dashboard": False} if address is None else {}
    try:
        ray.init(address or "local", log_to_driver=False, logging_level=logging.ERROR, **own)
    except (OSError, RuntimeError, ValueError, ray.exceptions.RayError) as error:
        kind = ConnectionError if isinstance(error, OSError) else ValueError
        raise kind(f"Ray cannot be reached at {address or 'this machine'}: {where_raised(error)}") from error
    try:
        yield ray
    finally:
        ray.shutdown()


def play_all(settings: Benchmark, work: Work, progress: Progress, finish: Finish) -> None:
    """Play the remaining episodes on a cluster; the arguments are those of `baselines.benchmark.local.play_all`.

    A policy that raises, or whose batch has lost its worker again and again, fails; its other batches that end are
    stored, and the other policies continue.

    Raises:
        ValueError: Ray is not available, a policy cannot be sent to it, or a node lacks the device or other code.
        ConnectionError: the cluster cannot be reached.
    """
    size = settings.worlds
    waiting = deque(
        (k, numbers[i : i + size]) for k, (_, numbers) in enumerate(work) for i in range(0, len(numbers), size)
    )
    failed: set[int] = set()
    with connected(settings.address) as ray:
        hand_out = _remote(ray, settings)
        sent = [ray.put(_packed(ray, cell, settings)) for cell, _ in work]
        playing: dict[Any, int] = {}
        while waiting or playing:
            # Counted each time, because nodes come and go.
            most = max(_AHEAD * int(ray.cluster_resources().get("CPU", 0)), 1)
            while waiting and len(playing) < most:
                k, numbers = waiting.popleft()
                if k not in failed:
                    progress.begin(work[k][0])
                    playing[hand_out(sent[k], numbers)] = k
            for reference in ray.wait(list(playing), timeout=1.0)[0] if playing else []:
                k = playing.pop(reference)
                result = _result(ray, reference, work[k][0])
                if not isinstance(result, Failure) or k not in failed:
                    finish(work[k][0], result)
                if isinstance(result, Failure):
                    failed.add(k)


def _remote(ray: Any, settings: Benchmark) -> Any:
    """Return a function that hands a batch of a cell to the cluster."""
    gpus = 1 if settings.device == "cuda" else 0
    if gpus and not ray.cluster_resources().get("GPU"):
        raise ValueError("device must be one that the Ray cluster has, got cuda; none of its nodes has a GPU")
    needs = {"num_cpus": 1, "num_gpus": gpus, "scheduling_strategy": "SPREAD"}
    remote = ray.remote(**needs, max_retries=_RETRIES)(_play_batch)
    return lambda packed, numbers: remote.remote(packed, numbers, score_versions())


def _play_batch(packed: bytes, numbers: list[int], wanted: dict[str, str]) -> Rows | Failure:
    """Play one batch; this runs on a worker."""
    ray = _ray()
    if (here := score_versions()) != wanted:
        raise ValueError(f"every node must have {wanted}, got {here} on {ray.util.get_node_ip_address()}")
    cell, settings, sources = ray.cloudpickle.loads(packed)
    if (here := _sources(cell)) != sources:
        differing = [name for name in sorted(sources | here) if sources.get(name) != here.get(name)]
        raise ValueError(
            f"every node must have the same {', '.join(differing)}; {ray.util.get_node_ip_address()} has not"
        )
    rows: Rows = []
    for result in batches_or_failure(cell, settings, numbers):  # several, for a policy of fewer worlds
        if isinstance(result, Failure):
            return result  # in words: the error itself may be of a class that the driver cannot load
        rows += result
    return rows


def _sources(cell: Cell) -> dict[str, str]:
    """Return digests of the code that a cell needs: the policy's modules, and the scenario with extensions."""
    modules = {name: digest for name, digest in fingerprint_of(cell.factory).items() if name.startswith(MODULE)}
    return modules | {f"scenario {cell.scenario.name}": cell.scenario.digest()}


def _packed(ray: Any, cell: Cell, settings: Benchmark) -> bytes:
    try:
        return ray.cloudpickle.dumps((cell, settings, _sources(cell)))
    except Exception as error:
        raise ValueError(
            f"policy {cell.policy} cannot be sent to another process ({where_raised(error)}); "
            "give a function (scenario, num_worlds, device) that makes it, or module:factory"
        ) from error


def _result(ray: Any, reference: Any, cell: Cell) -> Rows | Failure:
    try:
        return ray.get(reference)
    except ray.exceptions.RayTaskError as error:
        raise ValueError(f"a node of the Ray cluster cannot play: {error.cause}") from error
    except ray.exceptions.RayError as error:
        return failure_of(cell, error)
