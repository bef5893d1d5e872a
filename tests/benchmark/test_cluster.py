"""The benchmark over a Ray cluster: same rows as the engine `local`, also if a node, worker or driver is lost."""

import json
import os
import signal
import subprocess
import sys
import threading
import time

import pytest
from rich.console import Console

import baselines
from baselines.benchmark.cluster import _packed, _play
from baselines.benchmark.running import measure, run
from baselines.benchmark.types import Benchmark, Cell
from lissajous_env import scenario as make_scenario

ray = pytest.importorskip("ray")
from ray.cluster_utils import Cluster  # noqa: E402

QUIET = Console(quiet=True)
SHORT = {"task.duration": 2.0}
STORE = 80_000_000
HEAD = {
    "num_cpus": 1, "object_store_memory": STORE, "include_dashboard": False,
    "_system_config": {"health_check_initial_delay_ms": 0, "health_check_period_ms": 200},
}  # fmt: skip
"""Settings of a cluster that notices a lost node after one second instead of fifteen: five times without an answer."""
SCRIPT = """
import sys
from pathlib import Path
from rich.console import Console
from baselines.benchmark.running import run
from test_cluster import Slow, small

run(small(Path(sys.argv[1]), engine="ray", episodes=12), {"slow": Slow}, console=Console(quiet=True))
"""


def small(out, **changes):
    given = {"scenarios": ("failure",), "policies": ("kuramoto", "open-loop"), "episodes": 5, "batch": 2}
    return Benchmark(**given | {"out": out, "overrides": SHORT} | changes)


def numbered(folder):
    """(policy, episode) of each line of the journal."""
    rows = [json.loads(line) for line in (folder / "episodes.jsonl").read_text().splitlines()]
    return [(row["policy"], row["episode"]) for row in rows]


def nodes_that_began(notes):
    return open(notes).read().split() if os.path.exists(notes) else []


class Slow:
    """The policy `kuramoto`, half a second a batch; where notes are kept, each batch enters its node there.

    It then waits for a batch on another node: one of them is killed while both play.
    """

    pause = 0.03
    """Time that a step takes longer [s]."""

    def __init__(self, scenario, num_worlds, device):
        self.policy, self.num_worlds = baselines.make("kuramoto", scenario, num_worlds, device), num_worlds

    def reset(self, worlds=None):
        if notes := os.environ.get("LISSAJOUS_TEST_NOTES"):
            with open(notes, "a") as file:
                file.write(ray.get_runtime_context().get_node_id() + "\n")
            deadline = time.monotonic() + 600
            while time.monotonic() < deadline and len(set(nodes_that_began(notes))) < 2:
                time.sleep(0.05)
        self.policy.reset(worlds)

    def act(self, observation):
        time.sleep(self.pause)
        return self.policy.act(observation)


class Quick(Slow):
    pause = 0.0


class Deadly(Slow):
    """Kills its own process in mid-episode: once, if it is given a file to remember that by; else always."""

    once = None

    def act(self, observation):
        if self.once is None or not os.path.exists(self.once):
            if self.once is not None:
                open(self.once, "w").close()
            os.kill(os.getpid(), signal.SIGKILL)
        return self.policy.act(observation)


class Raising(Slow):
    def act(self, observation):
        return 1 / 0


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Results of the engine `local`."""
    folder = tmp_path_factory.mktemp("whole")
    run(small(folder, episodes=12), {"slow": Quick}, console=QUIET)
    return folder


@pytest.fixture(autouse=True)
def _workers_find_this_file(monkeypatch):
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([os.path.dirname(__file__), os.environ.get("PYTHONPATH", "")]))


@pytest.fixture
def two_nodes(tmp_path, monkeypatch):
    """A cluster of two nodes of one CPU each, the node that is not its head, and the notes of `Slow`."""
    monkeypatch.setenv("LISSAJOUS_TEST_NOTES", str(tmp_path / "notes"))
    cluster = Cluster(initialize_head=True, head_node_args=HEAD)
    other = cluster.add_node(num_cpus=1, object_store_memory=STORE)
    ray.init(cluster.address, log_to_driver=False, logging_level="ERROR")
    yield cluster, other, tmp_path / "notes"
    ray.shutdown()
    cluster.shutdown()


@pytest.fixture
def one_node():
    ray.init("local", num_cpus=2, object_store_memory=STORE, include_dashboard=False, log_to_driver=False)
    yield
    ray.shutdown()


def test_a_node_is_killed_and_every_episode_is_there_once(whole, two_nodes, tmp_path):
    # Oracle: the engine `local`, to the byte; and the notes, which show that batches were lost with the node.
    cluster, other, notes = two_nodes
    out = tmp_path / "out"

    def kill_while_it_plays():
        deadline = time.monotonic() + 600
        while time.monotonic() < deadline and other.node_id not in nodes_that_began(notes):
            time.sleep(0.02)
        time.sleep(0.2)
        cluster.remove_node(other, allow_graceful=False)

    killer = threading.Thread(target=kill_while_it_plays)
    killer.start()
    run(small(out, episodes=12, engine="ray"), {"slow": Slow}, console=QUIET)
    killer.join()
    assert sorted(numbered(out)) == sorted(numbered(whole))
    assert (out / "episodes.csv").read_bytes() == (whole / "episodes.csv").read_bytes()
    began = nodes_that_began(notes)
    assert other.node_id in began
    assert len(began) > 6  # of the six batches of `slow`, one at least was begun again


def test_a_killed_driver_is_gone_on_from_by_the_other_engine(whole, tmp_path):
    out = tmp_path / "out"
    process = subprocess.Popen([sys.executable, "-c", SCRIPT, str(out)])
    deadline = time.monotonic() + 600
    while time.monotonic() < deadline and process.poll() is None:
        if (out / "episodes.jsonl").exists() and len(numbered(out)) >= 4:
            break
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    assert process.wait() == -signal.SIGKILL
    assert 4 <= len(numbered(out)) < 36
    run(small(out, episodes=12), {"slow": Slow}, console=QUIET)
    assert len(numbered(out)) == 36
    assert (out / "episodes.csv").read_bytes() == (whole / "episodes.csv").read_bytes()


def test_policies_that_fail_are_reported_and_the_others_go_on(one_node, tmp_path, capfd):
    # Story: one raises, as it would here; one kills its worker each time; one does so once, and all its episodes come.
    once = type("Once", (Deadly,), {"once": str(tmp_path / "once")})
    own = {"raising": Raising, "deadly": Deadly, "once": once}
    settings = small(tmp_path / "out", policies=("kuramoto",), episodes=4, engine="ray")
    outcome = measure(settings, own, console=QUIET)
    assert sorted(numbered(settings.out)) == sorted((name, k) for name in ("kuramoto", "once") for k in range(4))
    local = measure(small(tmp_path / "local", policies=("kuramoto",), episodes=4), {"raising": Raising}, console=QUIET)
    raising, deadly = outcome.failures
    assert (raising.scenario, raising.policy, raising.error) == ("failure", "raising", local.failures[0].error)
    assert "1 / 0" in raising.traceback
    assert deadly.policy == "deadly"
    assert "WorkerCrashedError" in deadly.error
    own["raising"] = own["deadly"] = Quick
    healed = measure(settings, own, console=QUIET)
    assert (healed.failures, healed.resumed, len(healed.rows)) == ([], 8, 16)


def test_a_policy_that_cannot_be_sent_is_named(tmp_path):
    lock = threading.Lock()
    cell = Cell(make_scenario("failure"), "mine", lambda *_: lock)
    with pytest.raises(ValueError, match=r"policy mine cannot be sent .* give a function"):
        _packed(ray, cell, small(tmp_path))


def test_a_node_of_another_version_is_refused():
    with pytest.raises(ValueError, match=r"every node must have \{'lissajous-env': '0'\}, got .* on \d"):
        _play(b"", [0], {"lissajous-env": "0"})


def test_without_ray_the_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ValueError, match=r'pip install "lissajous-env\[cluster\]"'):
        run(small(tmp_path / "out", engine="ray"), console=QUIET)
    with pytest.raises(ValueError, match="address must be given only with engine ray"):
        run(small(tmp_path / "out", address="auto"), console=QUIET)
    assert not (tmp_path / "out").exists()


def test_ray_is_loaded_by_its_engine_alone(tmp_path):
    # Oracle: a process that plays locally and lists what it has loaded.
    program = (
        "import sys; from pathlib import Path; from rich.console import Console;"
        "from baselines.benchmark.running import run; from baselines.benchmark.types import Benchmark;"
        "run(Benchmark(('failure',), ('still',), 1, out=Path(sys.argv[1]), overrides={'task.duration': 1.0}),"
        "console=Console(quiet=True)); print('ray' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program, str(tmp_path)], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
