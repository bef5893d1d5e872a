"""Pictures of a scaled world: with all lengths multiplied by L and all times by T, a picture is the same.

The oracle is the picture of the world that was not scaled. Factors that are powers of two change no rounding, so every
pixel of the plot is equal; with others a line may fall on the next pixel. Words and numbers around the plot differ.
"""

import dataclasses

import numpy as np
import pytest

import lissajous_env
from lissajous_env.render import Renderer, Snapshot
from lissajous_env.render.canvas import FOOTER, HEADER
from lissajous_env.render.panel import decimals_of
from lissajous_env.world.state import FAILED

WATCHED = {"targets.wandering": 0.5, "targets.fleeing": 0.5, "targets.arrival_rate": 1.0}


def played(name: str) -> tuple[lissajous_env.Scenario, Snapshot]:
    """The world of a scenario after its first steps, in which a robot has failed."""
    simulation = lissajous_env.Simulation(lissajous_env.scenario(name, **({} if name == "swarm" else WATCHED)), seed=3)
    action = np.random.default_rng(0).uniform(-0.5, 1, simulation.action_shape).astype(np.float32)
    for _ in range(25):
        simulation.step(action)
    seen = Snapshot.of(simulation)
    status = np.where(np.arange(len(seen.status)) == 0, FAILED, seen.status)
    return simulation.scenario, dataclasses.replace(seen, status=status)


def plot(scenario: lissajous_env.Scenario, seen: Snapshot, length: float = 1.0) -> np.ndarray:
    """The plot of a world whose places are multiplied by a length, without the words around it."""
    places = {name: getattr(seen, name) * length for name in ("position", "target_position")}
    return Renderer(scenario).draw(dataclasses.replace(seen, **places))[HEADER + 6 : -FOOTER]


@pytest.mark.parametrize("name", ["experiment", "team", "swarm"])
def test_a_picture_of_a_scaled_world_is_the_same(name):
    scenario, seen = played(name)
    expected = plot(scenario, seen)
    np.testing.assert_array_equal(plot(scenario.scaled(64.0, 16.0), seen, 64.0), expected)
    for length, time in ((0.1, 1.0), (3.0, 0.5)):
        away = (plot(scenario.scaled(length, time), seen, length) != expected).any(axis=-1)
        assert away.mean() < 0.01, (length, time)


@pytest.mark.parametrize(("step", "decimals"), [(0.1, 1), (0.05, 2), (0.025, 2), (0.001, 3), (1.0, 0), (10.0, 0)])
def test_times_are_written_as_finely_as_they_differ(step, decimals):
    assert decimals_of(step) == decimals
    assert len({f"{k * step:.{decimals}f}" for k in range(20)}) == 20
