"""Decoding of the observation by classical policies, compared with the documented layout and the true state."""

import numpy as np
import warp as wp

import lissajous_env
from baselines.policies import own_row
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.structs import to_struct
from lissajous_env.world.observation import LINK, OWN, ROBOT, layout

wp.set_module_options(OPTIONS)

OWN_ENTRIES = ("X", "Y", "COS_HEADING", "SIN_HEADING", "SPEED", "COS_PHASE", "SIN_PHASE", "WORKS")
LINK_ENTRIES = {"HEARD": "heard", "AGE": "age", "COS_LEAD": "cos_phase", "SIN_LEAD": "sin_phase",
                "X_AWAY": "x", "Y_AWAY": "y"}  # fmt: skip
ROBOT_ENTRIES = {"PRESENT": "present", "X_SEEN": "x", "Y_SEEN": "y", "X_VELOCITY": "x_velocity",
                 "Y_VELOCITY": "y_velocity"}  # fmt: skip


def test_places_are_those_of_the_layout():
    # Oracle: the names of the world's own layout.
    names = layout(lissajous_env.scenario("experiment", **{"sensing.robots_seen": 3}).resolve()).names
    assert [names[getattr(own_row, entry)] for entry in OWN_ENTRIES] == [entry.lower() for entry in OWN_ENTRIES]
    for side in range(2):
        found = [names[OWN + LINK * side + getattr(own_row, entry)] for entry in LINK_ENTRIES]
        assert found == [f"neighbour_{side}_{name}" for name in LINK_ENTRIES.values()]
    for k in range(3):
        found = [names[OWN + 2 * LINK + ROBOT * k + getattr(own_row, entry)] for entry in ROBOT_ENTRIES]
        assert found == [f"robot_{k}_{name}" for name in ROBOT_ENTRIES.values()]


@wp.kernel
def read(
    curve: CurveStruct,
    speed_unit: float,
    radius: float,
    observation: wp.array3d(dtype=float),
    heard_out: wp.array3d(dtype=wp.vec2),
    seen_out: wp.array3d(dtype=wp.vec4),
    speed_out: wp.array2d(dtype=float),
):
    w, i = wp.tid()
    speed_out[w, i] = own_row.own_speed(w, i, speed_unit, observation)
    for side in range(2):
        heard_out[w, i, side] = own_row.offset_heard(w, i, side, curve, observation)
    for k in range(seen_out.shape[2]):
        if own_row.sees(w, i, k, observation):
            away = own_row.offset_seen(w, i, k, radius, observation)
            velocity = own_row.velocity_seen(w, i, k, speed_unit, observation)
            seen_out[w, i, k] = wp.vec4(away[0], away[1], velocity[0], velocity[1])


def test_what_is_decoded_is_the_truth():
    # Oracle: the state of the world, which robots without noise observe exactly: offsets and speeds in SI units.
    sees_all = {"sensing.robots_seen": 4, "sensing.radius": 10.0, "faults.schedule": ()}
    scenario = lissajous_env.scenario("experiment", **sees_all).resolve()
    simulation = lissajous_env.Simulation(scenario, 3, seed=4)
    for _ in range(5):
        simulation.step(np.full(simulation.action_shape, [0.3, -0.6], dtype=np.float32))
    heard = wp.zeros((3, 5, 2), dtype=wp.vec2, device="cpu")
    seen, speed = wp.zeros((3, 5, 4), dtype=wp.vec4, device="cpu"), wp.zeros((3, 5), dtype=float, device="cpu")
    inputs = [to_struct(CurveStruct, scenario.curve), scenario.robot.top_speed, 10.0, simulation.observation]
    wp.launch(read, (3, 5), inputs, outputs=[heard, seen, speed], device="cpu")
    state = simulation.robots
    np.testing.assert_allclose(speed.numpy(), state.speed.numpy(), atol=1e-5)
    place, heading = state.position.numpy()[..., :2], state.heading.numpy()
    velocity = state.speed.numpy()[..., None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    for i, pair in enumerate(scenario.neighbours):
        np.testing.assert_allclose(heard.numpy()[:, i], place[:, list(pair)] - place[:, i, None], atol=1e-5)
        others = [j for j in range(5) if j != i]
        truth = np.concatenate([place[:, others] - place[:, i, None], velocity[:, others] - velocity[:, i, None]], -1)
        order = np.argsort(np.linalg.norm(truth[..., :2], axis=-1), axis=1)
        sorted_truth = np.take_along_axis(truth, order[..., None], axis=1)
        np.testing.assert_allclose(seen.numpy()[:, i], sorted_truth, atol=2e-4)
