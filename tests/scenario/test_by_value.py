"""Code of a notebook or of a script travels to other processes by value, and a cell that is run again replaces it.

The tests run programs without a file, as a notebook has none, in folders in which nothing can be imported.
"""

import dataclasses
import subprocess
import sys

import pytest

import baselines
import lissajous_env
from baselines.policies import registry
from lissajous_env.parameters import rogues

NOTEBOOK = """
import linecache, sys
for number, source in enumerate(sys.argv[1:]):
    linecache.cache[f"<cell {number}>"] = len(source), None, source.splitlines(True), f"<cell {number}>"
    exec(compile(source, f"<cell {number}>", "exec"))
"""
CELL = """
import copy, multiprocessing
import numpy as np
import baselines, lissajous_env
FACTOR = 2.0
@lissajous_env.reward_term(weight=-0.5)
def near_wall(world):
    return abs(world.robots.position[..., 0]) * FACTOR

@lissajous_env.rogue("to-the-right")
def decide(rows):
    out = np.zeros((*rows.shape[:2], 2))
    out[..., 0] = 1.0
    return out

@baselines.register("slowly")
class Slowly(baselines.Policy):
    def decide(self, observation):
        return np.full(self.action.shape, 0.1 * FACTOR)

def play(scenario, policy):
    rows = lissajous_env.evaluate(policy, scenario, seeds=[3])
    return [row.get(name, 0.0) for row in rows for name in ("return_mean", "detection_time_mean")]
short = {"task.duration": 4.0, "targets.count": 40, "targets.arrival_rate": 0.0, "sensing.radius": 0.3}
extended = lissajous_env.scenario("experiment", **short, extensions=[near_wall])
haunted = lissajous_env.scenario("experiment", **short, rogues="to-the-right")
tasks = [(scenario, baselines.make("slowly", scenario)) for scenario in (extended, haunted)]
expected = [play(*task) for task in tasks]
assert copy.deepcopy(extended) == extended
"""

POOL = """from concurrent.futures import ProcessPoolExecutor
with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
    rows = [pool.submit(lissajous_env.evaluate, policy, made, [3]).result()[0] for made, policy in tasks]
    assert pool.submit(lissajous_env.Scenario.digest, extended).result() == extended.digest()
    sys.ps1 = "In : "  # the cell of the rogue is edited and run again, while the other process lives on
    lissajous_env.rogue("to-the-right")(lambda rows: -decide(rows))
    rows.append(pool.submit(lissajous_env.evaluate, tasks[1][1], haunted, [3]).result()[0])
expected.append(play(*tasks[1]))
assert [row["return_mean"] for row in rows] == [first for first, *_ in expected]
assert expected[1] != expected[2]
"""


def test_other_processes_play_what_a_notebook_defines(tmp_path):
    # Oracle: the notebook's own process.
    command = [sys.executable, "-c", NOTEBOOK, CELL, POOL]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, timeout=300)
    assert done.returncode == 0, done.stderr


def of_a_cell(value):
    """A function and a class as a cell defines them anew with each run."""
    names = {"__name__": "__main__", "baselines": baselines}
    exec(f"def decide(rows):\n    return {value}\nclass Mine(baselines.Policy):\n    number = {value}\n", names)
    return names["decide"], names["Mine"]


def test_a_cell_that_is_run_again_replaces_what_it_registered(monkeypatch):
    # Story: a cell is edited and run again; a script, and a name of the package, are refused.
    def register(value, name):
        decide, mine = of_a_cell(value)
        lissajous_env.rogue(name)(decide)
        baselines.register(name)(mine)
        return decide, mine

    register(1, "of-a-cell")
    for add in (lissajous_env.rogue, baselines.register):
        with pytest.raises(ValueError, match="must be new, got 'of-a-cell'"):
            add("of-a-cell")(of_a_cell(2)[add is baselines.register])
    monkeypatch.setattr(sys, "ps1", "In : ", raising=False)
    decide, mine = register(2, "of-a-cell")
    assert rogues.rogue_of("of-a-cell").decide is decide
    assert registry.entry_of("of-a-cell").factory is mine
    for coordinator in (type("Mine", (baselines.NumpyCoordinator,), {}) for _ in range(2)):
        baselines.register_coordinator("way-of-a-cell", coordinator)
        assert registry.entry_of("way-of-a-cell-mpcc").factory.args == (coordinator,)
    for add, name in ((lissajous_env.rogue, "flee"), (baselines.register, "still")):
        with pytest.raises(ValueError, match=f"must be new, got '{name}'"):
            add(name)(of_a_cell(3)[add is baselines.register])


def test_a_cell_that_is_run_again_replaces_its_scenario_and_its_space(monkeypatch):
    # Story: a cell is edited and run again; a script, and a name of the package, are refused.
    def register(name, duration):
        scenario = dataclasses.replace(lissajous_env.scenario("failure", **{"task.duration": duration}), name=name)
        lissajous_env.register_scenario(scenario)
        space = lissajous_env.ScenarioSpace("of-a-cell", scenario, {"targets": {"count": "choice(1, 2)"}})
        lissajous_env.register_scenario(space)

    register("mine", 2.0)
    with pytest.raises(ValueError, match="name of a scenario must be new, got 'mine'"):
        register("mine", 3.0)
    monkeypatch.setattr(sys, "ps1", "In : ", raising=False)
    register("mine", 3.0)
    assert lissajous_env.scenario("mine").task.duration == 3.0
    assert lissajous_env.scenario_space("of-a-cell").base.task.duration == 3.0
    with pytest.raises(ValueError, match="name of a scenario must be new, got 'evaders'"):
        register("evaders", 2.0)
