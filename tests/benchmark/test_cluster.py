"""The benchmark over a Ray cluster: same rows as the engine `local`, also if a node or a worker is lost."""

import json
import os
import signal
import sys
import threading
import time

import pytest
from benchmarks_in_the_small import QUIET, lines, small

import baselines
from baselines.benchmark import cluster
from baselines.benchmark.running import measure, run
from baselines.benchmark.types import Cell
from lissajous_env import scenario as make_scenario
from lissajous_env.identity import machine

ray = pytest.importorskip("ray")
from ray.cluster_utils import Cluster  # noqa: E402

STORE = 80_000_000
HEAD = {
    "num_cpus": 1, "object_store_memory": STORE, "include_dashboard": False,
    "_system_config": {"health_check_initial_delay_ms": 0, "health_check_period_ms": 200},
}  # fmt: skip
"""Settings of a cluster that notices a lost node after one second instead of fifteen: five times without an answer."""
NOTES = "LISSAJOUS_TEST_NOTES"
"""Variable of the environment with the file in which `Slow` notes the nodes that begin a batch."""


def numbered(folder):
    """(policy, episode) of each line of the journal."""
    return [(row["policy"], row["episode"]) for row in map(json.loads, lines(folder))]


def nodes_that_began():
    notes = os.environ[NOTES]
    return open(notes).read().split() if os.path.exists(notes) else []


class Quick:
    """The policy `kuramoto`, which can be sent to other processes by value."""

    def __init__(self, scenario, num_worlds, device):
        self.policy, self.num_worlds = baselines.make("kuramoto", scenario, num_worlds, device), num_worlds

    def reset(self, worlds=None):
        self.policy.reset(worlds)

    def act(self, observation):
        return self.policy.act(observation)


class Slow(Quick):
    """Half a second a batch; each batch notes its node, and waits for one on another node: one is killed meanwhile."""

    def reset(self, worlds=None):
        with open(os.environ[NOTES], "a") as file:
            file.write(ray.get_runtime_context().get_node_id() + "\n")
        deadline = time.monotonic() + 600
        while time.monotonic() < deadline and len(set(nodes_that_began())) < 2:
            time.sleep(0.05)
        self.policy.reset(worlds)

    def act(self, observation):
        time.sleep(0.03)
        return self.policy.act(observation)


class Deadly(Quick):
    """Kills its own process in mid-episode: once, if it is given a file to remember that by; else always."""

    once = None

    def act(self, observation):
        if self.once is None or not os.path.exists(self.once):
            if self.once is not None:
                open(self.once, "w").close()
            os.kill(os.getpid(), signal.SIGKILL)
        return self.policy.act(observation)


class Raising(Quick):
    def act(self, observation):
        return 1 / 0


@pytest.fixture(scope="module")
def two_nodes(tmp_path_factory):
    """A cluster of two nodes of one CPU each, and the node that is not its head."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(NOTES, str(tmp_path_factory.mktemp("notes") / "notes"))
        here = [os.path.dirname(__file__), os.path.dirname(os.path.dirname(__file__))]
        patch.setenv("PYTHONPATH", os.pathsep.join([*here, os.environ.get("PYTHONPATH", "")]))
        nodes = Cluster(initialize_head=True, head_node_args=HEAD)
        other = nodes.add_node(num_cpus=1, object_store_memory=STORE)
        ray.init(nodes.address, log_to_driver=False, logging_level="ERROR")
        yield nodes, other
        ray.shutdown()
        nodes.shutdown()


def test_a_node_is_killed_and_every_episode_is_there_once(two_nodes, tmp_path):
    # Oracle: the engine `local`, to the byte; and the notes, which show that batches were lost with the node.
    (nodes, other), out, whole = two_nodes, tmp_path / "out", tmp_path / "whole"

    def kill_while_it_plays():
        deadline = time.monotonic() + 600
        while time.monotonic() < deadline and other.node_id not in nodes_that_began():
            time.sleep(0.02)
        time.sleep(0.2)
        nodes.remove_node(other, allow_graceful=False)

    killer = threading.Thread(target=kill_while_it_plays)
    killer.start()
    run(small(out, episodes=8, engine="ray"), {"slow": Slow}, console=QUIET)
    killer.join()
    run(small(whole, episodes=8), {"slow": Quick}, console=QUIET)
    assert sorted(numbered(out)) == sorted(numbered(whole))
    assert (out / "episodes.csv").read_bytes() == (whole / "episodes.csv").read_bytes()
    assert other.node_id in nodes_that_began()
    assert len(nodes_that_began()) > 4  # of the four batches of `slow`, one at least was begun again


def test_policies_that_fail_are_reported_and_the_others_go_on(two_nodes, tmp_path, monkeypatch):
    # Story: one raises, as it would here; one kills its worker each time; one does so once, and all its episodes come;
    # one plays a single world at a time.
    once = type("Once", (Deadly,), {"once": str(tmp_path / "once")})
    own = {"raising": Raising, "deadly": Deadly, "once": once, "single": lambda scenario, *_: Quick(scenario, 1, "cpu")}
    settings = small(tmp_path / "out", policies=("kuramoto",), episodes=2, engine="ray")
    monkeypatch.setattr(cluster, "_RETRIES", 1)
    outcome = measure(settings, own, console=QUIET)
    assert sorted(numbered(settings.out)) == sorted(
        (name, k) for name in ("kuramoto", "once", "single") for k in range(2)
    )
    raising, deadly = outcome.failures
    assert (raising.scenario, raising.policy) == ("failure", "raising")
    assert raising.error.startswith("ZeroDivisionError: division by zero (test_cluster.py, line ")
    assert "1 / 0" in raising.traceback
    assert deadly.policy == "deadly"
    assert "WorkerCrashedError" in deadly.error
    own["raising"] = own["deadly"] = Quick
    healed = measure(small(settings.out, policies=("kuramoto",), episodes=2), own, console=QUIET)  # on this machine
    assert (healed.failures, healed.resumed, len(healed.rows)) == ([], 6, 10)


def test_what_cannot_be_played_on_a_cluster_is_refused(tmp_path, monkeypatch):
    lock = threading.Lock()
    cell = Cell(make_scenario("failure"), "mine", lambda *_: lock)
    with pytest.raises(ValueError, match=r"policy mine cannot be sent .* give a function"):
        cluster._packed(ray, cell, small(tmp_path))
    with pytest.raises(ValueError, match=r"every node must have \{'lissajous-env': '0'\}, got .* on \d"):
        cluster._play_batch(b"", [0], {"lissajous-env": "0"})
    with pytest.raises(ValueError, match="device of engine ray must be cpu or cuda"):
        run(small(tmp_path / "out", engine="ray", device="cuda:1"), console=QUIET)
    assert machine("cuda:99")["device"] == "cuda:99"  # as on a driver without the devices of its nodes
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ValueError, match=r'pip install "lissajous-env\[cluster\]"'):
        run(small(tmp_path / "out", engine="ray"), console=QUIET)
    assert not (tmp_path / "out").exists()
