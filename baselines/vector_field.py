"""Guiding vector field."""

import math
from typing import Any

import numpy as np
import warp as wp

from baselines.coordinated import Coordinator, Remembering
from baselines.observed import own_heading, own_phase, own_position, own_works
from baselines.patrol import robot_speed_max
from baselines.policy import Policy
from lissajous_env.compilation import OPTIONS
from lissajous_env.curve import CurveStruct, point2, tangent2, wrap
from lissajous_env.geometry import curve_length
from lissajous_env.robot import RobotStruct
from lissajous_env.scenario import Scenario
from lissajous_env.structs import to_struct

wp.set_module_options(OPTIONS)

G = dict(k=2.0, turn=4.0, ks=4.0, slow=0.3, ff=1.0, lookahead=0.0, mix=0.0)


@wp.kernel
def follow_field(
    curve: CurveStruct,
    robot: RobotStruct,
    alpha: float,
    rate: float,
    scale: float,
    k: float,
    turn: float,
    ks: float,
    slow: float,
    ff: float,
    look: float,
    mix: float,
    step: float,
    phase_rate: wp.array2d(dtype=float),
    memory: wp.array2d(dtype=wp.vec2),
    observation: wp.array3d(dtype=float),
    action_out: wp.array3d(dtype=float),
):
    w, i = wp.tid()
    position = own_position(w, i, curve, observation)
    heading = own_heading(w, i, observation)
    speed = wp.max(observation[w, i, 4] * robot_speed_max(robot), 0.0)
    known = memory[w, i]
    if known[1] == 0.0 or not own_works(w, i, observation):
        known = wp.vec2(alpha * own_phase(w, i, observation), 1.0)
    gamma = known[0]
    pace = alpha * (rate + mix * (phase_rate[w, i] - rate))
    # field, at a preview
    g2 = gamma + look * pace
    tangent = tangent2(curve, g2)
    off = position + look * speed * wp.vec2(wp.cos(heading), wp.sin(heading)) - point2(curve, g2)
    field = pace * tangent - (rate * alpha * scale * k) * off
    t0 = tangent2(curve, gamma)
    off0 = position - point2(curve, gamma)
    gamma_rate = alpha * phase_rate[w, i] + alpha * rate * k * wp.dot(off0, t0) / scale
    wanted = wp.atan2(field[1], field[0])
    e = wrap(wanted - heading)
    # rate of direction of the field
    a = float(curve.a)
    b = float(curve.b)
    r = point2(curve, g2)
    bend = wp.vec2(-a * a * r[0], -b * b * r[1])
    h = wp.vec2(wp.cos(heading), wp.sin(heading))
    frate = pace * bend * gamma_rate - (rate * alpha * scale * k) * (speed * h - tangent * gamma_rate)
    direction = (field[0] * frate[1] - field[1] * frate[0]) / wp.max(wp.length_sq(field), 1.0e-4)
    yaw = ff * direction + turn * e
    steering = wp.atan(robot.wheelbase * yaw / wp.max(speed, 0.1))
    v = wp.length(field) * wp.max(wp.cos(e), slow)
    if wp.dot(field, tangent) < 0.0:
        v = 0.0
    throttle = (robot.drag * v + robot.model_offset + ks * (v - speed)) / robot.drive
    span = robot.throttle_max - robot.throttle_min
    action_out[w, i, 0] = wp.clamp(steering / robot.steering_max, -1.0, 1.0)
    action_out[w, i, 1] = wp.clamp(2.0 * (throttle - robot.throttle_min) / span - 1.0, -1.0, 1.0)
    gamma += gamma_rate * step
    gamma = gamma - 6.283185307179586 * wp.floor(gamma / 6.283185307179586)
    memory[w, i] = wp.vec2(gamma, 1.0)


class WithVectorField(Policy):
    kind = "car"

    def __init__(self, coordinator: type, scenario: Scenario, num_worlds: int, device: Any):
        super().__init__(scenario, num_worlds, device)
        self.coordinator: Coordinator = coordinator(self.scenario, num_worlds, self.device)
        self._curve = to_struct(CurveStruct, self.scenario.curve)
        self._robot = to_struct(RobotStruct, self.scenario.robot)
        self._scale = curve_length(self.scenario.curve) / (2 * math.pi)
        self._memory = wp.zeros(self.shape, dtype=wp.vec2, device=self.device)

    def _forget(self, mask: np.ndarray) -> None:
        self._memory.assign(np.where(mask[:, None, None], 0.0, self._memory.numpy()).astype(np.float32))
        if isinstance(self.coordinator, Remembering):
            self.coordinator.forget(mask)

    def _decide(self, observation: wp.array) -> None:
        self.coordinator.coordinate(observation)
        alpha = float(self.scenario.alpha)
        rate = self.scenario.formation.phase_rate / alpha
        inputs = [self._curve, self._robot, alpha, rate, self._scale, *G.values(),
                  self.scenario.task.step, self.coordinator.phase_rate, self._memory, observation]
        wp.launch(follow_field, self.shape, inputs, outputs=[self.action], device=self.device)
