"""The paper's coordination with the phase measured along the curve: equally spaced robots at a constant ground speed.

Robot i has the arc phase psi_i = 2 pi s(alpha theta_i) / (L alpha), with s(gamma) of (14) and L the length of a lap,
and dynamics (1) act on it:

    psi_i' = 2 pi v / (L alpha) - K sum over j in R_i of sin(psi_j - psi_i)

Its equilibria, their stability and alpha of Lemma 2 are those of the phase, with the places spaced by L / N along the
curve rather than by 2 pi / N in gamma. psi_j follows from the observed phase theta_i and phase difference theta_j -
theta_i, and is advanced at the natural rate by the age of the message. The controller uses one phase rate for its
horizon; here it is the mean one over the next PREVIEW seconds at the ground speed of psi_i'.

The ground speed v is as fast as the cars can follow (`ground_speed`), where theta' = omega reaches it on the fastest
stretch of the curve alone.

Lost: equally spaced robots are not on ellipse (5), so (6), (8) and T_max promise nothing, and `phase_error`, the
deviation from (2) in theta, does not fall to 0. On curve (16) two robots in formation come nearer to one another than
those of (2) do, too near for cars that leave the curve by as much as these do: they collide in `experiment`.

Gained: in `intruders`, where the rectangle is too large for a guarantee, targets are detected sooner, because the speed
is constant and can therefore be higher.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from baselines.policies.coordinators import Coordinator, PhaseRates
from baselines.policies.own_row import Observation, hears, lead, message_age, own_phase
from baselines.policies.patrol_path import cruising_speed
from baselines.similarity import motion_scale
from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import TWO_PI
from lissajous_env.parameters.scenario import Curve, Scenario
from lissajous_env.settings.checks import Checked, number
from lissajous_env.theory import closed_forms

wp.set_module_options(OPTIONS)

PREVIEW = 0.6
"""Time over which the phase rate is averaged [s]: less than this makes the ground speed unsteady before tight turns."""


@dataclass(frozen=True)
class ArcParameters(Checked):
    """Parameters of the coordinator, besides the scenario."""

    speed: float | None = number(None, 1e-6, 1e5, "m/s")
    """v, speed along the curve [m/s]; None is `ground_speed`."""
    preview: float | None = number(None, 1e-3, 1e5, "s")
    """Time over which the phase rate is averaged [s]."""


@wp.func
def interpolate(table: wp.array(dtype=float), angle: float) -> float:
    """Return a function of period 2 pi at an angle [rad], from a table at equal distances over one turn."""
    n = table.shape[0]
    x = angle / TWO_PI * float(n)
    cell = wp.floor(x)
    k = ((int(cell) % n) + n) % n
    return table[k] + (x - cell) * (table[(k + 1) % n] - table[k])


@wp.kernel
def kuramoto_by_arc(
    alpha: float,
    rate: float,
    coupling: float,
    preview: float,
    age_unit: float,
    gain: wp.array(dtype=float),
    loss: wp.array(dtype=float),
    observation: Observation,
    phase_rate_out: PhaseRates,
):
    """Return psi_i' = rate - coupling sum_j sin(psi_j - psi_i), as the mean theta_i' over `preview` [s].

    `gain` and `loss` are the two tables of `arc_tables`, `rate` is that of psi [rad/s].
    """
    w, i = wp.tid()
    theta = own_phase(w, i, observation)
    gamma = alpha * theta
    arc = gamma + interpolate(gain, gamma)
    pull = float(0.0)
    for side in range(2):
        if hears(w, i, side, observation):
            other = alpha * (theta + lead(w, i, side, observation))
            ahead = (other + interpolate(gain, other) - arc) / alpha
            pull += wp.sin(ahead + rate * message_age(w, i, side, age_unit, observation))
    soon = arc + preview * alpha * (rate - coupling * pull)
    phase_rate_out[w, i] = (soon + interpolate(loss, soon) - gamma) / (preview * alpha)


class KuramotoByArc(Coordinator):
    """Coordinator: phase rates (W, N) [rad/s] by (1) on arc phases."""

    kernel = kuramoto_by_arc

    def __init__(self, scenario: Scenario, num_worlds: int, device: Any, parameters: ArcParameters | None = None):
        super().__init__(scenario, num_worlds, device)
        parameters = parameters or ArcParameters()
        preview = parameters.preview or PREVIEW * motion_scale(scenario).time
        speed = parameters.speed or ground_speed(scenario)
        rate = 2 * math.pi * speed / (lap_length(scenario.driven) * scenario.alpha)
        tables = [wp.array(table, dtype=wp.float32, device=device) for table in arc_tables(scenario.driven)]
        self.inputs = [float(scenario.alpha), rate, scenario.coupling, preview, scenario.time_unit, *tables]


def arc_tables(curve: Curve) -> tuple[np.ndarray, np.ndarray]:
    """2 pi s(gamma) / L - gamma at gamma = 2 pi k / n, and gamma(s) - 2 pi s / L at s = L k / n [rad].

    Both are periodic, so float32 keeps them to about 1e-7 rad; between entries they are interpolated to 1e-5 rad.
    """
    gamma = _phases(curve)
    ends, middles = _speed(curve, gamma), _speed(curve, gamma[:-1] + 0.5 * gamma[1])
    cells = (ends[:-1] + 4 * middles + ends[1:]) / 6  # Simpson's rule
    arc = np.concatenate([[0.0], np.cumsum(cells)]) * 2 * math.pi / cells.sum()
    return (arc - gamma)[:-1], (np.interp(gamma, arc, gamma) - gamma)[:-1]


def lap_length(curve: Curve) -> float:
    """Return L, the length of one lap [m]; of a knot (10), in space."""
    return 2 * math.pi * float(np.mean(_speed(curve, _phases(curve)[:-1])))


def _speed(curve: Curve, gamma: np.ndarray) -> np.ndarray:
    """Return ||r'(gamma)|| in the plane or in space [m/rad]."""
    climb = curve.half_depth * curve.c * np.cos(curve.c * gamma)
    return np.hypot(closed_forms.curve_speed(curve, gamma), climb)


def _phases(curve: Curve) -> np.ndarray:
    """Return evenly spaced gamma over a lap, including both ends [rad]."""
    fastest = max(curve.a, curve.b, curve.c if curve.half_depth > 0 else 1)
    count = 1024 << (fastest - 1).bit_length()
    return 2 * math.pi * np.arange(count + 1) / count


def ground_speed(scenario: Scenario) -> float:
    """Return the speed along the curve [m/s]: a patrol's cruising speed, less if grip does not allow such a turn.

    Grip must let it turn round in half of the rectangle's height, v^2 <= a_lat B / 2. The speed is never below the
    formation's mean, omega L / (2 pi), and equal to it if the scenario has no grip.
    """
    mean = scenario.formation.phase_rate * lap_length(scenario.driven) / (2 * math.pi)
    grip = scenario.robot.lateral_acceleration_max
    if math.isinf(grip):
        return mean
    return max(mean, min(cruising_speed(scenario), math.sqrt(grip * scenario.driven.half_height / 2)))
