"""Addresses of Ray clusters: invalid and unreachable ones are reported within seconds."""

import re
import signal
import subprocess
import sys

import pytest

pytest.importorskip("ray")

from baselines.benchmark import cluster, ray_address
from tests.adversarial.security import server

ELSEWHERE = "127.0.0.2"
"""Another machine, to Ray, and yet this one: for its loopback names Ray takes this machine's own address."""


@pytest.mark.parametrize(
    "address",
    [
        "", " ", "localhost", "localhost:", "localhost:-1", "localhost:0", "localhost:65536", "localhost:1e3", ":6379",
        "localhost:6379\n", "a b:6379", "::1:6379", "[::1]", "http://localhost:6379", "ray://", "ray://localhost",
        "ray://ray://localhost:1", "locall", "localhost:٣", "localhost:6379,other:6379", 6379, "x" * 100_000,
    ],
)  # fmt: skip
def test_what_is_no_address_is_refused_by_name(address):
    rule = r"address must be auto, local, HOST:PORT or ray://HOST:PORT with a port from 1 to 65535"
    with pytest.raises(ValueError, match=f"{rule}.*got {re.escape(repr(address)[:20])}"):
        cluster.check("cpu", address)


@pytest.mark.parametrize(
    "address",
    [None, "auto", "local", "localhost:6379", "10.0.0.1:1", "ray://head.example:10001", "[::1]:65535", "ray://[fe80::1%eth0]:9"],
)  # fmt: skip
def test_what_is_an_address_is_taken(address):
    cluster.check("cpu", address)


@pytest.mark.parametrize(
    ("reply", "closes", "words"),
    [
        (b"", False, "it does not answer within 1 s"),
        (b"", True, ""),
        (b"HTTP/1.1 400 Bad Request\r\nContent-Length: 0\r\n\r\n", False, ""),
        (b"SSH-2.0-OpenSSH_9.6\r\n", False, ""),
        (bytes(range(256)) * 40, True, ""),
    ],
)
@pytest.mark.parametrize("kind", ["", "ray://"])
def test_one_who_is_no_cluster_is_told_apart_in_one_line(monkeypatch, reply, closes, words, kind):
    monkeypatch.setattr(ray_address, "_PATIENCE", 1.0)
    with (
        server(reply, closes, ELSEWHERE) as (address, _),
        pytest.raises(ConnectionError) as raised,
        cluster.connected(kind + address),
    ):
        pass
    assert str(raised.value).startswith(f"a server answers at {kind}{address}, but it is not a Ray cluster: {words}")
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("address", ["127.0.0.1:1", "[::1]:1", "no-such-host.invalid:6379", f"{'x' * 70}.invalid:6379"])
def test_where_nobody_is_the_address_is_named(address):
    with pytest.raises(ConnectionError, match=re.escape(f"no Ray cluster answers at {address}: ")):
        ray_address.knock(address)


def test_what_auto_stands_for_is_looked_at_as_well(monkeypatch):
    # Story: the environment names a server that says nothing, or no address at all.
    monkeypatch.setattr(ray_address, "_PATIENCE", 1.0)
    with server(b"", False, ELSEWHERE) as (address, _):
        monkeypatch.setenv("RAY_ADDRESS", address)
        with pytest.raises(ConnectionError, match=f"a server answers at {address}, but it is not a Ray cluster"):
            ray_address.knock("auto")
    monkeypatch.setenv("RAY_ADDRESS", "localhost:-1")
    with pytest.raises(ValueError, match=r"address must be .* got 'localhost:-1'"):
        ray_address.knock("auto")


def test_what_ray_says_of_a_cluster_that_cannot_be_joined_is_one_line(monkeypatch):
    # Story: a cluster of another version; Ray explains that in several lines.
    import ray

    def refuse(*_, **__):
        raise RuntimeError("Version mismatch: The cluster has:\n    Ray: 2.9.0\n    Python: 3.10.1\n")

    monkeypatch.setattr(ray_address, "knock", lambda address: None)
    monkeypatch.setattr(ray, "init", refuse)
    said = "the Ray cluster at a:1 cannot be joined: Version mismatch: The cluster has: Ray: 2.9.0 Python: 3.10.1"
    with pytest.raises(ValueError, match=re.escape(said)), cluster.connected("a:1"):
        pass


@pytest.mark.usefixtures("ctrl_c")
def test_ctrl_c_while_it_connects_ends_it_cleanly(tmp_path):
    command = [sys.executable, "-m", "lissajous_env", "benchmark", "--scenarios", "failure", "--policies", "still"]
    with server(b"", False, ELSEWHERE) as (address, asked):
        given = ["--episodes", "1", "--out", str(tmp_path / "out"), "--engine", "ray", "--address", address]
        with subprocess.Popen([*command, *given], stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
            assert asked.wait(60), process.poll()
            process.send_signal(signal.SIGINT)
            errors = process.communicate(timeout=30)[1]
    assert process.returncode == 130, errors
    assert "interrupted" in errors
    assert "Traceback" not in errors
