"""The true state of a batch: by name, equal in NumPy and torch, for every interface."""

import numpy as np
import pytest
import warp as wp

import lissajous_env
from lissajous_env import Simulation
from lissajous_env.envs.sides import state_names, state_rows

DEVICES = ["cpu", pytest.param("cuda", marks=pytest.mark.skipif(not wp.is_cuda_available(), reason="needs CUDA"))]
CRASHING = {"task.on_collision": "remove", "robot.radius": 0.3, "formation.start": "random"}


def played(name, device="cpu", **overrides):
    simulation = Simulation(lissajous_env.scenario(name, **overrides), 3, device=device, seed=2)
    draw = np.random.default_rng(0)
    for _ in range(12):
        simulation.step(draw.uniform(-1, 1, simulation.action_shape).astype(np.float32))
    return simulation


@pytest.mark.parametrize("name", ["rough", "knot"])
def test_each_number_is_what_its_name_says(name):
    # Oracle: the simulation's arrays, robot by robot and target by target.
    simulation = played(name)
    scenario, names, rows = simulation.scenario, state_names(simulation.scenario), state_rows(simulation)
    assert rows.shape == (3, len(names))
    assert rows.dtype == np.float32
    assert len(set(names)) == len(names)
    half = np.array([scenario.curve.half_width, scenario.curve.half_height])
    robots, targets = simulation.robots, simulation.targets
    for w, row in enumerate(rows):
        said, expected = dict(zip(names, row, strict=True)), {"elapsed": 12 / scenario.task.steps}
        for i in range(scenario.num_robots):
            heading, phase = robots.heading.numpy()[w, i], robots.phase.numpy()[w, i]
            x, y = robots.position.numpy()[w, i, :2] / half
            speed, works = robots.speed.numpy()[w, i] / simulation.speed_unit, robots.status.numpy()[w, i] == 0
            parts = {"x": x, "y": y, "cos_heading": np.cos(heading), "sin_heading": np.sin(heading), "speed": speed}
            parts |= {"cos_phase": np.cos(phase), "sin_phase": np.sin(phase), "works": float(works)}
            expected |= {f"robot_{i}_{key}": value for key, value in parts.items()}
        for t in range(scenario.target_capacity):
            waiting = targets.status.numpy()[w, t] == 1
            x, y = targets.position.numpy()[w, t] / half if waiting else (0, 0)
            expected |= {f"target_{t}_waiting": float(waiting), f"target_{t}_x": x, f"target_{t}_y": y}
        assert said == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize(("name", "overrides"), [("rough", {}), ("experiment", CRASHING)])
def test_torch_says_what_numpy_does(name, overrides, device):
    # Oracle: NumPy.
    torch = pytest.importorskip("torch")
    simulation = played(name, device, **overrides)
    rows = state_rows(simulation, torch)
    assert rows.dtype == torch.float32
    assert rows.device.type == device
    np.testing.assert_allclose(rows.cpu(), state_rows(simulation), atol=1e-6)
    before = rows.clone()
    simulation.step(np.ones(simulation.action_shape, dtype=np.float32))
    assert torch.equal(rows, before), "it is the caller's own"
