"""Strangers' folders with pickles in them, and addresses at which no Ray cluster is."""

import contextlib
import io
import shutil
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np

from lissajous_env.console.cli import main
from tests.adversarial import Attack, planted

_SHORT = ("--set", "task.duration=1.0")
_TRAIN = (
    "train", "--scenario", "failure", "--worlds", "2", "--rollout", "8", "--batch-size", "80", "--layers", "4",
    "--evaluate-every", "80", "--evaluation-episodes", "1", "--threads", "1", "--teacher", "none", "--rivals", *_SHORT,
)  # fmt: skip
_RAY = ("--engine", "ray", "--workers", "1")
_SLOWEST = 30.0
"""Time in which an address must be known to be none [s]: ten of patience, and what a process takes."""


_PLACE = tempfile.TemporaryDirectory(prefix="attacked-")
"""Folder of the attacked folders, until this process ends."""


def _run(arguments: tuple) -> tuple[int | str | None, str]:
    """Exit code and what was said of a command in this process."""
    said = io.StringIO()
    with contextlib.redirect_stderr(said), contextlib.redirect_stdout(io.StringIO()):
        try:
            main([str(each) for each in arguments])
        except SystemExit as end:
            return end.code, said.getvalue()
        except Exception as error:
            return None, repr(error)
    return None, said.getvalue()


@cache
def _made(kind: str) -> Path:
    """A sound folder of some kind, made once."""
    folder = Path(_PLACE.name) / kind
    if kind == "policy":
        import training.learned.policy

        shutil.copytree(training.learned.policy.find("learned-intruders"), folder)
    else:
        if kind == "recording":
            folder.mkdir()
        code, said = _run(_first(kind, folder))
        assert code == 0, said
    return folder


def _first(kind: str, folder: Path) -> tuple:
    return {
        "training": (*_TRAIN, "--steps", "80", "--out", folder),
        "ray": (*_TRAIN, *_RAY, "--steps", "80", "--out", folder),
        "benchmark": ("benchmark", "--scenarios", "failure", "--policies", "still", "--episodes", "1", "--out", folder,
                      *_SHORT),
        "recording": ("run", "failure", "still", "--out", folder / "one.npz", *_SHORT),
    }[kind]  # fmt: skip


def _again(kind: str, folder: Path, draw: np.random.Generator) -> tuple:
    """A command that reads the folder."""
    if kind in ("training", "ray"):
        return *_TRAIN, *(_RAY if kind == "ray" else ()), "--steps", "160", "--out", folder
    if kind == "policy":
        out = folder.parent / "out"
        ways = (
            ("run", "failure", folder, "--out", folder.parent / "out.png", *_SHORT),
            ("evaluate", folder, "failure", "--episodes", "1", *_SHORT),
            ("benchmark", "--scenarios", "failure", "--policies", folder, "--episodes", "1", "--out", out, *_SHORT),
        )
        return ways[draw.integers(len(ways))]
    if kind == "recording":
        return "replay", folder / "one.npz", "--out", folder.parent / "out.png"
    return _first(kind, folder)


def _with_pickles(kind: str) -> Callable[[np.random.Generator], str | None]:
    def attempt(draw: np.random.Generator) -> str | None:
        with tempfile.TemporaryDirectory() as place:
            folder, marker = Path(place) / "folder", Path(place) / "opened"
            shutil.copytree(_made(kind), folder)
            files = sorted(path for path in folder.rglob("*") if path.is_file())
            files += [folder / inner / name for inner in (".", "rllib/000001") for name in planted.RLLIB_FILES]
            chosen = [files[k] for k in draw.choice(len(files), draw.integers(1, 4), replace=False)]
            form = draw.choice(["plain", "archive", "npz"])
            if kind == "ray":  # few tries: all at once, and what would end it sooner is left as it is
                chosen, form = [path for path in files if path.suffix in (".pkl", "")], "plain"
            for path in chosen:
                planted.plant(path, planted.payloads(marker)[form])
            code, said = _run(_again(kind, folder, draw))
            names = ", ".join(str(path.relative_to(folder)) for path in chosen)
            if planted.opened(marker):
                return f"{names}: unpickled"
            if code not in (0, 1, 2) or "Traceback" in said:
                return f"{names}: exit code {code}, {said[-200:]!r}"
        return None

    return attempt


@contextlib.contextmanager
def server(reply: bytes, closes: bool, host: str) -> Iterator[tuple[str, threading.Event]]:
    """Yield the address of one who accepts connections, replies this to each, and an event of the second connection."""
    connections, asked = [], threading.Event()
    with socket.create_server((host, 0)) as listening:

        def serve() -> None:
            with contextlib.suppress(OSError):
                while True:
                    connection = listening.accept()[0]
                    connections.append(connection)
                    connection.sendall(reply)
                    if closes:
                        connection.close()
                    if len(connections) > 1:  # the first one only looks whether somebody is there
                        asked.set()

        threading.Thread(target=serve, daemon=True).start()
        yield f"{host}:{listening.getsockname()[1]}", asked
        with contextlib.suppress(OSError):
            listening.shutdown(socket.SHUT_RDWR)
        for connection in connections:
            connection.close()


def _any_server(draw: np.random.Generator) -> contextlib.AbstractContextManager[tuple[str, threading.Event]]:
    """Return a local server that says nothing, something else, or hangs up."""
    replies = (b"", b"HTTP/1.1 400 Bad Request\r\n\r\n", b"SSH-2.0-x\r\n", bytes(draw.integers(0, 256, 5000, np.uint8)))
    reply, closes = replies[draw.integers(len(replies))], draw.random() < 0.3
    return server(reply, closes, ("127.0.0.1", "127.0.0.2")[draw.integers(2)])


def _joined(address: str) -> str | None:
    """Give an address to a benchmark in a process of its own: what is wrong with how that ends, if something is."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as place:
        given = ("benchmark", "--scenarios", "failure", "--policies", "still", "--episodes", "1", "--out", place)
        command = [sys.executable, "-m", "lissajous_env", *given, "--engine", "ray", f"--address={address}"]
        try:
            done = subprocess.run(command, capture_output=True, text=True, timeout=60)
        except subprocess.TimeoutExpired:
            return f"{address!r} hangs"
    took = time.monotonic() - began
    if done.returncode not in (1, 2) or not done.stderr.strip().rpartition("\n")[2].startswith("error: "):
        return f"{address!r}: exit code {done.returncode}, {done.stderr[-200:]!r}"
    return None if took < _SLOWEST else f"{address!r} took {took:.0f} s"


def _address_of_no_cluster(draw: np.random.Generator) -> str | None:
    host = ("", "localhost", "127.0.0.1", "[::1]", "::1", "no-such-host.invalid", "a b", "x" * 300)[draw.integers(8)]
    port = ("", "0", "-1", "1", "65536", "9" * 30, "x", "1\n")[draw.integers(8)]
    return _joined(("", "ray://", "http://")[draw.integers(3)] + host + ("" if draw.random() < 0.2 else ":") + port)


def _server_of_something_else(draw: np.random.Generator) -> str | None:
    with _any_server(draw) as (address, _):
        return _joined(("", "ray://")[draw.integers(2)] + address)


_NEVER = "A pickle in place of any file is never opened; the command works, or prints the reason in one line."
ATTACKS = [
    Attack("pickles in the folder of a training", _NEVER, 20, _with_pickles("training")),
    Attack("pickles in the folder of a policy", _NEVER, 20, _with_pickles("policy")),
    Attack("pickles in the folder of a benchmark", _NEVER, 15, _with_pickles("benchmark")),
    Attack("pickles as a recording", _NEVER, 20, _with_pickles("recording")),
    Attack("pickles in the folder of a training by RLlib", _NEVER, 2, _with_pickles("ray")),
    Attack("addresses of no Ray cluster", "They are rejected in one line, within seconds.", 10, _address_of_no_cluster),
    Attack("servers that are no Ray cluster", "They are recognised within seconds.", 6, _server_of_something_else),
]
