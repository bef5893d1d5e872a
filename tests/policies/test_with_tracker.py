"""User-defined coordinators: with every tracker and filter, by name and as a factory, in SI units."""

import pickle
from functools import partial

import numpy as np
import pytest
import warp as wp

import baselines
import lissajous_env
from baselines.policies import registry
from baselines.policies.coordinators import Kuramoto
from lissajous_env.world.state import WORKING

SHORT = {"task.duration": 3.0}


class Again(baselines.NumpyCoordinator):
    """Time-inverted Kuramoto, once more."""

    def rates(self, rows):
        ahead = rows.lead + self.natural_rate * rows.age
        return self.natural_rate - self.scenario.formation.coupling * np.sum(rows.heard * np.sin(ahead), axis=-1)


class Counting(baselines.NumpyCoordinator):
    """Goes on at the natural rate, and counts the steps of each world."""

    def __init__(self, scenario, num_worlds, device):
        super().__init__(scenario, num_worlds, device)
        self.steps = np.zeros(num_worlds)

    def forget(self, mask):
        self.steps[mask] = 0

    def rates(self, rows):
        self.steps += 1
        return np.full(rows.phase.shape, self.natural_rate)


class InWarp:
    def __init__(self, scenario, num_worlds, device):
        self.phase_rate = wp.full((num_worlds, scenario.num_robots), 0.1, dtype=wp.float32, device=device)

    def coordinate(self, observation):
        pass


@pytest.mark.parametrize(("tracker", "scenario", "name"), [
    ("points", "failure", "kuramoto"), ("mpcc", "experiment", "kuramoto-mpcc"), ("gvf", "rough", "kuramoto-gvf"),
])  # fmt: skip
def test_kuramoto_in_numpy_drives_as_the_kernel_does(tracker, scenario, name):
    # Oracle: the coordinator in Warp. Cars amplify the last digits, so the columns of their ways are compared.
    short = lissajous_env.scenario(scenario, **SHORT)
    in_warp = lissajous_env.evaluate(baselines.make(name, short, 2), short, range(2))
    in_numpy = lissajous_env.evaluate(baselines.with_tracker(Again, tracker)(short, 2, "cpu"), short, range(2))
    for column in ("distance_mean", "phase_error", "detection_time_mean", "spacing_factor"):
        expected = [row[column] for row in in_warp]
        np.testing.assert_allclose([row[column] for row in in_numpy], expected, rtol=1e-2, atol=1e-4)


def test_a_registered_coordinator_has_the_names_of_a_shipped_one():
    # Oracle: the names of `kuramoto`.
    wanted = [name.replace("kuramoto", "my-method") for name in baselines.names() if name.startswith("kuramoto")]
    assert baselines.register_coordinator("my-method")(Again) is Again
    assert {name for name in baselines.names() if name.startswith("my-method")} == set(wanted)
    for name in wanted:
        assert not registry.is_included(name), "it is the user's, though its tracker is included"
        assert f"module {__name__}" in registry.fingerprint_of(registry.resolve(name))
        included = name.replace("my-method", "kuramoto")
        shipped, described = registry.describe(included), registry.describe(name)
        assert (described["kind"], described["made_for"]) == (shipped["kind"], shipped["made_for"])
        assert registry.is_default_on(name, "rough") == registry.is_default_on(included, "rough")
    for name, scenario in (("my-method", "failure"), ("my-method-gvf-safe", "rough")):
        short = lissajous_env.scenario(scenario, **SHORT)
        assert lissajous_env.evaluate(baselines.make(name, short), short, [0])[0]["policy"] == name
    assert registry.describe("my-method")["description"] == "Time-inverted Kuramoto, once more."
    assert "for cars with model predictive contouring control" in registry.describe("my-method-mpcc")["description"]
    baselines.register_coordinator("my-method", Again)  # the same again, as a module that is loaded anew does
    with pytest.raises(ValueError, match="name of a policy must be new, got 'my-method', which another one has"):
        baselines.register_coordinator("my-method", Kuramoto)
    with pytest.raises(ValueError, match="name of a policy must be new, got 'kuramoto', which another one has"):
        baselines.register_coordinator("kuramoto", Again)


def test_a_factory_knows_its_kind_and_can_be_sent_elsewhere():
    factory = baselines.with_tracker(Again, "mpcc")
    baselines.register("again-by-hand", factory=factory)
    assert registry.describe("again-by-hand")["kind"] == "car"
    policy = pickle.loads(pickle.dumps(factory))("rough", 2, "cpu")
    assert policy.action.shape == (2, 5, 2)
    assert type(pickle.loads(pickle.dumps(policy)).coordinator) is Again


def test_a_coordinator_forgets_the_worlds_that_begin_anew():
    policy = baselines.with_tracker(Counting)("failure", 3, "cpu")
    for _ in range(4):
        policy.act(np.zeros(policy.observation_shape, np.float32))
    policy.reset([1])
    assert policy.coordinator.steps.tolist() == [4, 0, 4]


def test_a_coordinator_in_warp_alone():
    scenario = lissajous_env.scenario("failure", **SHORT)
    rows = lissajous_env.evaluate(baselines.with_tracker(InWarp, "points")(scenario, 1, "cpu"), scenario, [0])
    assert rows[0]["distance_mean"] > 0


@pytest.mark.parametrize(("rates", "words"), [
    (lambda rows: rows.phase[0], r"rates of Wrong must have shape \(2, 5\), got \(5,\)"),
    (lambda rows: [[0.0] * 5, [0.0, np.nan] * 2 + [1.0]], r"must be finite \[rad/s\], got nan for robot_1 in world 1"),
    (lambda rows: np.full((2, 5), 1e39), r"rates of Wrong must be finite \[rad/s\], got inf for robot_0 in"),
    (lambda rows: "fast", "rates of Wrong must contain real numbers"),
])  # fmt: skip
def test_rates_that_are_none(rates, words):
    wrong = type("Wrong", (baselines.NumpyCoordinator,), {"rates": lambda self, rows: rates(rows)})
    policy = baselines.with_tracker(wrong)("failure", 2, "cpu")
    with pytest.raises(ValueError, match=words):
        policy.act(np.zeros(policy.observation_shape, np.float32))


@pytest.mark.parametrize(("call", "words"), [
    (partial(baselines.with_tracker, Again, "mpc"), "must be one of points, mpcc, gvf, got 'mpc'; did you mean"),
    (partial(baselines.with_tracker, 3, "mpcc"), r"must be coordinator\(scenario, num_worlds, device\), got 3"),
])  # fmt: skip
def test_what_is_no_coordinator_or_tracker(call, words):
    with pytest.raises(ValueError, match=words):
        call()


@pytest.mark.parametrize("name", ["failure", "rough"])
def test_rows_hold_what_is_true(name):
    """Oracle: the state of the world, where nothing is measured with noise."""
    fields = {f"noise.{field}": 0.0 for field in ("position", "heading", "speed", "message_loss", "message_delay")}
    fields |= {"faults.schedule": ((1, 0.5, 5.0),), "targets.arrival_rate": 5.0}
    scenario = lissajous_env.scenario(name, **fields)
    simulation = lissajous_env.Simulation(scenario, 3, seed=5)
    policy = baselines.make("kuramoto" if name == "failure" else "kuramoto-mpcc", scenario, 3)
    for _ in range(20):
        simulation.step(policy.act(simulation.observation))
    rows, robots = baselines.Rows(simulation.observation.numpy(), scenario), simulation.robots
    place = robots.position.numpy()[..., :2]
    near = {"rtol": 0, "atol": 2e-5}
    np.testing.assert_allclose(rows.position, place, **near)
    np.testing.assert_allclose(np.sin(rows.heading - robots.heading.numpy()), 0, **near)
    np.testing.assert_allclose(np.sin(rows.phase - robots.phase.numpy()), 0, **near)
    np.testing.assert_allclose(rows.speed, robots.speed.numpy(), **near)
    np.testing.assert_array_equal(rows.works, robots.status.numpy() == int(WORKING))
    assert not rows.works[:, 1].any()
    for side in range(2):
        other = scenario.neighbours[:, side]
        heard = rows.heard[..., side]
        assert heard.any()
        lead = (robots.phase.numpy()[:, other] - robots.phase.numpy()) - rows.lead[..., side]
        aged = scenario.formation.phase_rate * (rows.age[..., side] + scenario.task.step)  # sent before the last step
        assert (np.abs(np.sin(lead))[heard] <= 4 * aged[heard] + 1e-3).all()
        offset = place[:, other] - place - rows.neighbour_offset[..., side, :]
        assert np.abs(offset[heard]).max() < 0.5
    apart = np.linalg.norm(place[:, :, None] - place[:, None], axis=-1)
    # A robot that has failed senses nothing.
    inside = (apart < scenario.sensing_radius) & ~np.eye(5, dtype=bool) & rows.works[..., None]
    np.testing.assert_array_equal(rows.robots_seen.sum(-1), np.minimum(inside.sum(-1), scenario.sensing.robots_seen))
    nearest, seen = np.where(inside, apart, np.inf).min(-1), rows.robots_seen[..., 0]
    np.testing.assert_allclose(np.linalg.norm(rows.robot_offset[..., 0, :], axis=-1)[seen], nearest[seen], **near)
    assert (np.linalg.norm(rows.target_offset, axis=-1) <= scenario.sensing_radius + 1e-6).all()
    np.testing.assert_array_equal(rows.entry("works") > 0.5, rows.works)
    with pytest.raises(ValueError, match="did you mean works"):
        rows.entry("wroks")
