"""Worlds of one robot that is put somewhere, and where its actions take it."""

import numpy as np

import lissajous_env

ALONE = {
    "robot.count": 1, "formation.p": 0, "formation.ring": None, "faults.schedule": (), "formation.start_noise": 0.0,
    "noise.wheelbase_spread": 0.0, "noise.drive_spread": 0.0, "targets.count": 0, "targets.arrival_rate": 0.0,
    "task.grid": None, "task.duration": 200.0,
}  # fmt: skip
A, B, RADIUS = 1.8, 0.8, 0.125
"""Half extents of the rectangle, and radius of the robot [m]."""


def one_robot(x=0.0, y=0.0, heading=0.0, speed=0.0, yaw_rate=0.0, **overrides):
    """Return a simulation of one robot at a pose [m], [rad], at a speed [m/s] and a yaw rate [rad/s]."""
    simulation = lissajous_env.Simulation(lissajous_env.scenario("experiment", **{**ALONE, **overrides}))
    robots = simulation.robots
    robots.position.assign(np.float32([[[x, y, 0.0]]]))
    for array, value in ((robots.heading, heading), (robots.speed, speed), (robots.yaw_rate, yaw_rate)):
        array.assign(np.float32([[value]]))
    return simulation


def driven(simulation, actions):
    """Return (K, 5) x, y, heading, speed and yaw rate of the robot after each of K actions."""
    states, robots = [], simulation.robots
    for action in actions:
        simulation.step(np.float32(action)[None, None])
        rates = (array.numpy()[0, 0] for array in (robots.heading, robots.speed, robots.yaw_rate))
        states.append([*robots.position.numpy()[0, 0, :2], *rates])
    return np.array(states, dtype=float)


def score_after(simulation, steering, throttle, steps):
    """Return the score after as many steps of one action."""
    driven(simulation, [[steering, throttle]] * steps)
    return simulation.score()[0]
