"""The benchmark on many machines: Ray plays its batches of episodes over a cluster.

The driver alone writes the journal, a batch at a time, when it has come back whole. So the loss of a worker, of a node
or of the driver itself costs the batches that were being played, and these are played again: no episode is lost or
doubled. Machines of one kind return the rows of the engine `local`, bit for bit.
"""

import contextlib
import importlib
import logging
import socket
import textwrap
from collections import deque
from collections.abc import Iterator
from importlib.metadata import version
from typing import Any

from baselines.benchmark import results_folder
from baselines.benchmark.local import failure_of, play
from baselines.benchmark.progress import Progress
from baselines.benchmark.types import Batch, Benchmark, Cell, Failure
from baselines.policies.factories import parts
from lissajous_env.extras import missing
from lissajous_env.identity import MODULE
from lissajous_env.wording import shown

_RETRIES = 3
"""Times that a batch is played again after its worker or node was lost: a policy that kills its process must end."""
_AHEAD = 2
"""Batches handed out for each CPU, so that none waits for work."""
_PATIENCE = 10.0
"""Time in which a cluster must accept a connection [s]."""
_STORE = 100_000_000
"""Memory that the workers of a Ray of our own share [bytes]; what they exchange is small."""


def check(device: str) -> None:
    """Refuse what no Ray cluster can do.

    Raises:
        ValueError: Ray is not installed, or a device by its number.
    """
    _ray()
    if device not in ("cpu", "cuda"):
        raise ValueError(
            f"device of engine ray must be cpu or cuda, because Ray selects the device; got {shown(device)}"
        )


@contextlib.contextmanager
def connected(address: str | None) -> Iterator[Any]:
    """Yield Ray, connected to the cluster at an address, or to one on this machine that ends with the block.

    A process that is connected already stays with the cluster that it has.

    Raises:
        ValueError: Ray is not installed, or the cluster cannot be joined.
        ConnectionError: nothing answers at the address.
    """
    ray = _ray()
    if ray.is_initialized():
        yield ray
        return
    try:
        _join(ray, "local" if address is None else address)
        yield ray
    finally:
        ray.shutdown()


def _join(ray: Any, address: str) -> None:
    _reach(address)
    own = {"object_store_memory": _STORE, "include_dashboard": False} if address == "local" else {}
    try:
        ray.init(address, log_to_driver=False, logging_level=logging.ERROR, **own)
    except (OSError, RuntimeError, ValueError, ray.exceptions.RayError) as error:
        if own:
            raise ValueError(f"Ray cannot be started: {_one_line(error)}") from error
        kind = ConnectionError if isinstance(error, OSError) else ValueError
        raise kind(f"the Ray cluster at {address} cannot be joined: {_one_line(error)}") from error


def _reach(address: str) -> None:
    """Raise a ConnectionError if nothing listens at HOST:PORT; Ray itself would wait for minutes without a word."""
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    if not colon or not port.isdecimal():
        return
    try:
        socket.create_connection((host.strip("[]"), int(port)), _PATIENCE).close()
    except (OSError, OverflowError, UnicodeError) as error:
        raise ConnectionError(f"no Ray cluster answers at {address}: {error}") from error


def play_all(
    settings: Benchmark, work: list[tuple[Cell, list[int]]], kept: results_folder.Episodes, progress: Progress
) -> list[Failure]:
    """Play the remaining episodes on a cluster, and store each batch when it arrives; return the policies that failed.

    A policy that raises, or whose batch has lost its worker again and again, fails; its other batches that ended are
    stored, and the other policies continue.

    Args:
        settings: Settings of the benchmark.
        work: Cells, each with the numbers of the episodes that are left to play.
        kept: Folder in which the rows are stored.
        progress: Display of the finished episodes.

    Raises:
        ValueError: Ray cannot be had, a policy cannot be sent to it, or a node lacks what the settings ask for.
        ConnectionError: nothing answers at the address.
    """
    size = settings.worlds
    waiting = deque((cell, numbers[k : k + size]) for cell, numbers in work for k in range(0, len(numbers), size))
    if not waiting:
        return []
    left = {_name(cell): len(numbers) for cell, numbers in work if numbers}
    begun: set[str] = set()
    failures: dict[str, Failure] = {}
    with connected(settings.address) as ray:
        hand_out = _remote(ray, settings)
        sent = {_name(cell): ray.put(_packed(ray, cell, settings)) for cell, numbers in work if numbers}
        playing: dict[Any, Cell] = {}
        while waiting or playing:
            # Counted anew each time: nodes come and go.
            room = max(_AHEAD * int(ray.cluster_resources().get("CPU", 0)), 1)
            while waiting and len(playing) < room:
                cell, numbers = waiting.popleft()
                if _name(cell) not in failures:
                    if _name(cell) not in begun:
                        begun.add(_name(cell))
                        progress.begin(cell)
                    playing[hand_out(sent[_name(cell)], numbers)] = cell
            for reference in ray.wait(list(playing), timeout=1.0)[0] if playing else []:
                cell = playing.pop(reference)
                result = _result(ray, reference, cell)
                if isinstance(result, Failure):
                    if _name(cell) not in failures:
                        failures[_name(cell)] = result
                        progress.end(cell, result.word)
                    continue
                kept.add(result)
                progress.finished(cell, len(result.rows))
                left[_name(cell)] -= len(result.rows)
                if not left[_name(cell)]:
                    progress.end(cell)
    return [failures[_name(cell)] for cell, _ in work if _name(cell) in failures]


def _remote(ray: Any, settings: Benchmark) -> Any:
    """Return a function that hands a batch of a cell to the cluster."""
    gpus = 1 if settings.device == "cuda" else 0
    if gpus and not ray.cluster_resources().get("GPU"):
        raise ValueError("device must be one that the Ray cluster has, got cuda; none of its nodes has a GPU")
    versions = results_folder.as_settings(settings, [])["versions"]
    needs = {"num_cpus": 1, "num_gpus": gpus, "scheduling_strategy": "SPREAD"}
    remote = ray.remote(**needs, max_retries=_RETRIES)(_play)
    return lambda packed, numbers: remote.remote(packed, numbers, versions)


def _play(packed: bytes, numbers: list[int], versions: dict[str, str]) -> Batch | Failure:
    """Play one batch; this runs on a worker."""
    ray = _ray()
    here = {name: version(name) for name in versions}
    if here != versions:
        raise ValueError(f"every node must have {versions}, got {here} on {ray.util.get_node_ip_address()}")
    cell, settings, sources = ray.cloudpickle.loads(packed)
    if (here := _sources(cell)) != sources:
        differing = [name for name in sorted(sources | here) if sources.get(name) != here.get(name)]
        raise ValueError(
            f"every node must have the same {', '.join(differing)}; {ray.util.get_node_ip_address()} has not"
        )
    try:
        return next(play(cell, settings, numbers, lambda _: None))
    except (Exception, SystemExit) as error:
        # As words: the error itself may be of a class that the driver cannot load.
        return failure_of(cell, error)


def _sources(cell: Cell) -> dict[str, str]:
    """Return digests of what a node imports to play a cell: the policy's modules, and the scenario with extensions."""
    modules = {name: each for name, each in parts(cell.factory).items() if name.startswith(MODULE)}
    return modules | {f"scenario {cell.scenario.name}": cell.scenario.digest()}


def _packed(ray: Any, cell: Cell, settings: Benchmark) -> bytes:
    try:
        return ray.cloudpickle.dumps((cell, settings, _sources(cell)))
    except Exception as error:
        raise ValueError(
            f"policy {cell.policy} cannot be sent to another process ({_one_line(error)}); "
            "give a function (scenario, num_worlds, device) that makes it, or module:factory"
        ) from error


def _result(ray: Any, reference: Any, cell: Cell) -> Batch | Failure:
    try:
        return ray.get(reference)
    except ray.exceptions.RayTaskError as error:
        raise ValueError(f"a node of the Ray cluster cannot play: {_one_line(error.cause)}") from error
    except ray.exceptions.RayError as error:
        return failure_of(cell, error)


def _name(cell: Cell) -> str:
    return f"{cell.scenario.name} {cell.policy}"


def _one_line(error: BaseException) -> str:
    return textwrap.shorten(str(error), 400, placeholder=" ...") or type(error).__name__


def _ray() -> Any:
    try:
        return importlib.import_module("ray")
    except ImportError as error:
        raise missing("engine ray", "cluster", error) from error
