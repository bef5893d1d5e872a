"""Evaluation: invalid actions of a policy raise an error that names it, in every command."""

import json
from functools import partial

import numpy as np
import pytest
import warp as wp
from rich.console import Console

import baselines
import lissajous_env
from baselines.benchmark.running import measure
from baselines.benchmark.types import Benchmark
from lissajous_env.console import cli
from lissajous_env.episodes.evaluation import EpisodeRunner, InvalidActionError, evaluate
from lissajous_env.episodes.recording import record

SHORT = {"task.duration": 3.0}


class Failing:
    """Stands still until one action of one world, in one episode, is something else."""

    name = "failing"

    def __init__(self, scenario, num_worlds=1, device="cpu", *, value=np.nan, step=7, world=0, episode=0):
        shape = lissajous_env.Simulation(scenario, num_worlds).action_shape
        self.num_worlds, self.action = num_worlds, np.zeros(shape, dtype=np.float32)
        self.value, self.when, self.world = value, (episode, step), world
        self.now = [-1, 0]

    def reset(self, worlds=None):
        self.now = [self.now[0] + 1, 0]

    def act(self, observation):
        self.now[1] += 1
        action = self.action.copy()
        if self.now[1] == self.when[1] and self.when[0] in (None, self.now[0]):
            action[self.world, 1, 0] = self.value
        return action


@pytest.mark.parametrize("value", [np.nan, -np.inf])
def test_a_policy_that_returns_no_numbers_is_named_with_where_it_did(value):
    scenario = lissajous_env.scenario("failure", **SHORT)
    policy = Failing(scenario, 3, value=value, step=7, world=2, episode=1)
    words = (
        r"^policy failing must return finite actions, got NaN or infinity in step 7 of failure in world 2 \(seed 15\)$"
    )
    with pytest.raises(InvalidActionError, match=words):
        evaluate(policy, scenario, range(10, 20))
    assert tuple(policy.now) == (1, 7), "it is stopped at once"
    del policy.num_worlds
    with pytest.raises(ValueError, match="policy must have reset, act and num_worlds, or be a function, got <"):
        evaluate(policy, scenario, range(1))


def test_the_last_step_is_looked_at_too():
    scenario = lissajous_env.scenario("failure", **SHORT)
    with pytest.raises(InvalidActionError, match="in step 30 of failure"):
        evaluate(Failing(scenario, step=30), scenario, range(1))
    assert len(evaluate(Failing(scenario, step=31), scenario, range(1))) == 1


def test_surplus_worlds_repeat_the_last_seed():
    scenario = lissajous_env.scenario("failure", **SHORT)
    simulation = lissajous_env.Simulation(scenario, 3)
    runner = EpisodeRunner(baselines.make("still", scenario, 3), simulation)
    runner.play([4, 7])
    assert simulation.clock.seed.numpy().tolist() == [4, 7, 7]
    for seeds in ([], range(4)):
        with pytest.raises(ValueError, match="seeds must be one for each of the 3 worlds"):
            runner.play(seeds)


@pytest.mark.parametrize(("action", "words"), [
    (np.zeros((2, 5)), r"action must have shape \(2, 5, 1\), got \(2, 5\)"),
    (np.zeros((1, 5, 1)), r"got \(1, 5, 1\)"),
    (None, "must contain real numbers, got object None"),
    ([[0.0], [1.0, 2.0]], "got rows of different lengths"),
    (np.zeros((2, 5, 1), dtype=complex), "must contain real numbers, got complex128"),
    (np.full((2, 5, 1), "a"), "must contain real numbers, got <U1"),
    (np.full((2, 5, 1), True), "must contain real numbers, got bool"),
    (np.full((2, 5, 1), 1e300), "must return finite actions"),
])  # fmt: skip
def test_actions_of_another_form_are_refused_by_name(action, words):
    policy = Failing("failure", 2)
    policy.act = lambda observation: action
    for play in (lambda: evaluate(policy, "failure", range(2)), lambda: record(policy, "failure")):
        with pytest.raises(InvalidActionError, match=f"policy failing .*{words}"):
            play()


@pytest.mark.parametrize("as_given", [
    np.ndarray.tolist, lambda a: a.astype(np.int64), lambda a: wp.array(a, dtype=wp.float32, device="cpu"),
])  # fmt: skip
def test_actions_may_come_in_many_forms(as_given):
    scenario, policy = lissajous_env.scenario("failure", **SHORT), Failing("failure", step=0)
    act = policy.act
    expected = evaluate(policy, scenario, range(1))
    policy.act = lambda observation: as_given(act(observation))
    assert json.dumps(evaluate(policy, scenario, range(1))) == json.dumps(expected)


def test_a_benchmark_counts_it_as_a_failure_of_that_policy_alone(tmp_path):
    settings = Benchmark(("failure",), ("still",), 4, batch=2, out=tmp_path, overrides=SHORT)

    def failing(scenario, num_worlds, device):
        return Failing(scenario, num_worlds, episode=0)

    outcome = measure(settings, {"failing": failing}, console=Console(quiet=True))
    (failure,) = outcome.failures
    assert failure.policy == "failing"
    assert "must return finite actions, got NaN or infinity in step 7 of failure in world 0" in failure.error
    assert {row["policy"] for row in outcome.rows} == {"still"}


@pytest.fixture
def broken():
    """A registered policy that returns NaN, by its name."""
    baselines.register("failing", None, partial(Failing, episode=None))
    return "failing"


def test_the_commands_end_with_one_line_and_an_exit_code(broken, tmp_path, capsys):
    for arguments in (
        ["evaluate", "failure", broken, "--episodes", "1", "--set", "task.duration=3"],
        ["run", "failure", broken, "--set", "task.duration=3", "--out", str(tmp_path / "x.npz")],
        ["benchmark", "--scenarios", "failure", "--policies", broken, "--episodes", "1", "--out", str(tmp_path / "b"),
         "--set", "task.duration=3"],
    ):  # fmt: skip
        with pytest.raises(SystemExit) as ended:
            cli.main(arguments)
        assert ended.value.code not in (0, None), arguments
        said = capsys.readouterr()
        output = " ".join((said.out + said.err).split())
        assert "policy failing must return finite actions" in output, arguments
        assert "Traceback (most" not in output
    assert not (tmp_path / "x.npz").exists()
