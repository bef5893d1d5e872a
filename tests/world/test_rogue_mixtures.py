"""Mixtures: rogues of several kinds in one episode."""

import numpy as np
import pytest

import lissajous_env
from lissajous_env import Simulation
from lissajous_env.parameters.rogues import rogue_of
from training.learned import checkpoint
from training.learned.network import Network
from training.learned.rogue import rogue_card

FIELD = {"targets.arrival_rate": 0.0, "targets.count": 200, "targets.entry": "inside", "sensing.radius": 0.2}


@pytest.fixture(scope="module", autouse=True)
def upwards():
    """Register a rogue that goes up."""

    @lissajous_env.rogue("upwards-in-mixtures")
    def act(rows):
        return np.broadcast_to([0.0, 1.0], (*rows.shape[:2], 2))


def velocities(rogues, seeds=(3, 4), steps=12):
    """Velocities (steps, W, T, 2) and presence (steps, W, T) of rogues beside robots that do not move."""
    simulation = Simulation("experiment", len(seeds), rogues=rogues, **FIELD)
    simulation.reset(seeds=seeds)
    found, present = [], []
    for _ in range(steps):
        simulation.step(np.zeros(simulation.action_shape, np.float32))
        found.append(simulation.rogues.velocity.numpy().copy())
        present.append(simulation.rogue_present.numpy().astype(bool))
    return np.array(found), np.array(present)


def test_each_rogue_is_moved_by_one_member_with_its_share(tmp_path):
    # Oracle: a script that goes up, with 2 shares of 3, and a network that goes left; each rogue does one of both.
    scenario = lissajous_env.scenario("experiment", rogues="agents", **FIELD)
    card = rogue_card(scenario)
    network = Network((np.zeros((2, len(card.inputs))),), (np.array([-1.0, 0.0]),))
    checkpoint.save(tmp_path / "left", network, card)
    upwards, left = "upwards-in-mixtures", str(tmp_path / "left")
    moved, present = velocities(f"{upwards}+{left}+{upwards}")
    alive = present.all(axis=0)
    goes_up, goes_left = (moved[:, alive, 1] > 0), (moved[:, alive, 0] < 0)
    free = goes_up | goes_left  # a wall stops some
    assert free.mean() > 0.8
    assert not (goes_up.any(axis=0) & goes_left.any(axis=0)).any()
    assert goes_up.any(axis=0).mean() == pytest.approx(2 / 3, abs=0.1)


def test_a_mixture_of_one_rogue_with_itself_is_that_rogue():
    # Law: the draw does not matter where all members are the same.
    one, both = (velocities(rogues)[0] for rogues in ("follow-gap", "follow-gap+follow-gap"))
    assert (one == both).all()
    assert np.abs(one).max() > 0


def test_bad_input_is_refused_by_name():
    with pytest.raises(ValueError, match=r"targets.rogues must be one of .*, got 'fle'; did you mean flee\?"):
        rogue_of("wander+fle")
    with pytest.raises(ValueError, match=r"targets.rogues must be one of"):
        rogue_of("wander+agents")
    with pytest.raises(ValueError, match=r"task.contamination must be given for the rogue flee\+hide, got None"):
        lissajous_env.scenario("experiment", rogues="flee+hide", **{"task.contamination": None})
