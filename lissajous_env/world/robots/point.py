"""Points on the curve, as in the paper's simulations; action = phase rate."""

import warp as wp

from lissajous_env.device.compilation import MOTION
from lissajous_env.device.curve import curve_parameter, point, wrap_phase
from lissajous_env.device.stage import ROBOT, stage
from lissajous_env.parameters.robot_models import RobotModel, register_robot_model
from lissajous_env.theory.geometry import top_speed
from lissajous_env.world.robots.placing import place_on_curve
from lissajous_env.world.state import WORKING

wp.set_module_options(MOTION)


@stage(ROBOT, writes="robots: heading, path, phase, position, speed")
def move_points(w, i, curve, formation, robot, task, command, clock, robots):
    """Move points: the phase advances at the commanded rate, on the curve; no wall is in their way.

    Differs from the paper: (1) is continuous; with a rate that is constant in a step, this is Euler's method on (1).
    """
    alpha = float(formation.alpha)
    substeps = robots.path.shape[2] - 1
    rate = wp.where(robots.status[w, i] == WORKING, command[w, i, 0] * robot.phase_rate_max, 0.0)
    start = robots.phase[w, i]
    robots.path[w, i, 0] = robots.position[w, i]
    for s in range(1, substeps):
        passed = start + wp.float64(rate * task.step * float(s) / float(substeps))
        robots.path[w, i, s] = point(curve, curve_parameter(alpha, passed))
    robots.phase[w, i] = wrap_phase(start + wp.float64(rate * task.step))
    place_on_curve(w, i, rate, curve, alpha, robots)
    robots.path[w, i, substeps] = robots.position[w, i]


POINT = register_robot_model(
    RobotModel(
        name="curve",
        actions=("phase rate",),
        table=((-1.0,), (-0.5,), (-0.1,), (0.0,), (0.1,), (0.5,), (1.0,)),
        move=move_points,
        meanings=("rate of the phase theta, from -phase_rate_max to phase_rate_max [rad/s]",),
        speed_unit=lambda curve, formation, robot: top_speed(curve, formation.phase_rate),
        keeps_to_curve=True,
    )
)
