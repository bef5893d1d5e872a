"""The addresses of Ray clusters, and a check that one answers, as Ray itself would try for minutes."""

import importlib
import os
import re
import socket
import time
from typing import Any

_PATIENCE = 10.0
"""Time in which a cluster must answer [s]."""
_WANTS_TOKEN = object()
_HOST_AND_PORT = re.compile(r"(?P<client>ray://)?(?P<host>\[[\w.:%]+\]|[\w.-]+):(?P<port>\d{1,5})", re.ASCII)


def check(address: str | None) -> None:
    """Reject an address that cannot be one of a cluster; None starts one.

    Raises:
        ValueError: it is neither a word that Ray accepts nor a host and a port.
    """
    if address not in (None, "auto", "local"):
        _parts(address)


def knock(address: str) -> None:
    """Wait until the cluster at an address has answered, for 10 s at most.

    Raises:
        ValueError: it is `auto`, which stands for `RAY_ADDRESS`, and that is not an address.
        ConnectionError: nothing answers, another program answers, or the cluster requires a token.
    """
    until = time.monotonic() + _PATIENCE
    if address == "auto":
        address = os.environ.get("RAY_ADDRESS") or address
        check(address)
    if address == "local":
        return
    from ray._private.services import canonicalize_bootstrap_address

    is_client = address.startswith("ray://")
    try:
        # For this machine, Ray uses another of its addresses.
        asked = address.removeprefix("ray://") if is_client else canonicalize_bootstrap_address(address) or address
        socket.create_connection(_parts(asked if address == "auto" else address), _PATIENCE).close()
    except (OSError, UnicodeError) as error:
        raise ConnectionError(f"no Ray cluster answers at {address}: {error}") from error
    answer = _ask(asked, is_client, max(until - time.monotonic(), 1.0))
    if answer is _WANTS_TOKEN and address != "auto":  # for a cluster that Ray selects itself, it also reads the token
        raise ConnectionError(f"the Ray cluster at {address} requires a token: set RAY_AUTH_MODE to token")
    if isinstance(answer, str):
        raise ConnectionError(f"a server answers at {address}, but it is not a Ray cluster: {answer}")


def _parts(address: Any) -> tuple[str, int]:
    """Return the host, without brackets, and the port."""
    found = _HOST_AND_PORT.fullmatch(address) if isinstance(address, str) else None
    if found is None or not 1 <= int(found["port"]) <= 65535:
        raise ValueError(
            "address must be auto, local, HOST:PORT or ray://HOST:PORT with a port from 1 to 65535, or be omitted to "
            f"start Ray on this machine, got {address!r}"
        )
    return found["host"].strip("[]"), int(found["port"])


def _ask(address: str, is_client: bool, patience: float) -> object:
    """Ask what a Ray cluster can answer: None if it does, `_WANTS_TOKEN`, or in words what came instead."""
    try:
        import grpc
        from ray._private.grpc_utils import init_grpc_channel
    except ImportError as error:
        raise ValueError(f'address requires gRPC ({error}): pip install "lissajous-env[cluster]"') from error
    messages, services = _generated("ray_client" if is_client else "gcs_service")
    channel = init_grpc_channel(address, [("grpc.enable_http_proxy", 0)])
    try:
        if is_client:
            question = messages.ClusterInfoRequest(type=messages.ClusterInfoType.PING)
            services.RayletDriverStub(channel).ClusterInfo(question, timeout=patience)
        else:
            services.NodeInfoGcsServiceStub(channel).CheckAlive(messages.CheckAliveRequest(), timeout=patience)
    except grpc.RpcError as error:
        if error.code() == grpc.StatusCode.UNAUTHENTICATED:
            return _WANTS_TOKEN
        if error.code() == grpc.StatusCode.DEADLINE_EXCEEDED:
            return f"it does not answer within {patience:.0f} s"
        return " ".join((error.details() or error.code().name).split())
    finally:
        channel.close()
    return None


def _generated(name: str) -> tuple[Any, Any]:
    """Return the modules that gRPC has generated for one of Ray's interfaces: its messages, its services."""
    messages, services = (importlib.import_module(f"ray.core.generated.{name}_{kind}") for kind in ("pb2", "pb2_grpc"))
    return messages, services
