"""Optimality of the MPCC against CasADi + IPOPT on the same problems, which `python benchmarks/speed.py` also times.

There are two sets of problems, and both solvers start from the same guess: states from a closed loop in the paper's
experiment (guess: the last solution shifted by a stage), and random states near its curve (guess: straight on at the
speed that is wanted at the start).
"""

import time
from dataclasses import dataclass

import numpy as np

from baselines.benchmark.statistics import number
from baselines.mpcc.solver import Mpcc, MpccParameters, Solution
from lissajous_env.parameters.scenario import Curve, Robot
from lissajous_env.plugins import requiring
from lissajous_env.theory import closed_forms

with requiring("benchmarks/mpcc.py", "bench"):
    import casadi as ca

RING = (0, 1, 4, 2, 3)
PHASE_RATE = 0.3


@dataclass
class Problems:
    """States (n, 5), wanted phase rates (n,) and guesses (n, M, 2)."""

    state: np.ndarray
    phase_rate: np.ndarray
    guess: np.ndarray

    def __getitem__(self, rows) -> "Problems":
        return Problems(self.state[rows], self.phase_rate[rows], self.guess[rows])


class Model:
    """Problem (11)-(15) once more, in float64 by CasADi: the car and the curve inside it, and what controls cost."""

    def __init__(self, curve: Curve, p: MpccParameters):
        self.curve, self.p = curve, p
        z, u, U, rate = ca.SX.sym("z", 5), ca.SX.sym("u", 2), ca.SX.sym("U", 2, p.stages), ca.SX.sym("rate")
        X = ca.SX.sym("X", 5, p.stages + 1)
        self.advance = ca.Function("advance", [z, u], [self.advanced(z, u)])
        self.total = ca.Function("total", [X, U, rate], [self.summed(X, U, rate)])
        self.low, self.high = (-p.steering_max, p.throttle_min), (p.steering_max, p.throttle_max)

    def _curve(self, gamma):
        c = self.curve
        r = ca.vertcat(c.half_width * ca.cos(c.a * gamma), c.half_height * ca.sin(c.b * gamma))
        d = ca.vertcat(-c.half_width * c.a * ca.sin(c.a * gamma), c.half_height * c.b * ca.cos(c.b * gamma))
        return r, d, ca.sqrt(ca.sumsqr(d))

    def rates(self, z, u):
        """Return the time derivative (5,) of a state under a control, (12) and (14)."""
        p = self.p
        return ca.vertcat(
            z[3] * ca.cos(z[2]),
            z[3] * ca.sin(z[2]),
            z[3] * ca.tan(u[0]) / p.wheelbase,
            -p.drag * z[3] + p.drive * u[1] - p.offset,
            z[3] / self._curve(z[4])[2],
        )

    def advanced(self, z, u):
        """Return the state (5,) a stage later: one Runge-Kutta step."""
        h = self.p.step
        k1 = self.rates(z, u)
        k2 = self.rates(z + h / 2 * k1, u)
        k3 = self.rates(z + h / 2 * k2, u)
        k4 = self.rates(z + h * k3, u)
        return z + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)

    def errors(self, z, rate):
        """Return the errors (3,) of a state whose weighted squares are its cost: of the phase rate, lag and lateral."""
        r, d, speed = self._curve(z[4])
        off, t = z[:2] - r, d / speed
        return ca.vertcat(rate - z[3] / speed, t[0] * off[0] + t[1] * off[1], t[0] * off[1] - t[1] * off[0])

    def summed(self, X, U, rate):
        """Return (11a) of states (5, M + 1) and controls (2, M)."""
        weights = ca.vertcat(1, self.p.weight_lag, self.p.weight_lateral)
        cost = sum(ca.dot(weights, self.errors(X[:, i], rate) ** 2) for i in range(X.shape[1]))
        return cost + self.p.weight_steering * ca.sumsqr(U[0, :]) + self.p.weight_throttle * ca.sumsqr(U[1, :])

    def rollout(self, state, control):
        """Return the trajectory (M + 1, 5) of the model from one state under controls (M, 2)."""
        path = [np.asarray(state, float)]
        for u in control:
            path.append(np.array(self.advance(path[-1], u)).ravel())
        return np.array(path)

    def cost(self, state, phase_rate, control) -> float:
        """Return the cost (11a) of controls (M, 2), in float64."""
        return float(self.total(self.rollout(state, control).T, np.asarray(control, float).T, phase_rate))


class Ipopt(Model):
    """Problem (11)-(15) solved by IPOPT, with the states as variables (multiple shooting)."""

    def __init__(self, curve: Curve, p: MpccParameters):
        super().__init__(curve, p)
        M = p.stages
        X, U = ca.SX.sym("X", 5, M + 1), ca.SX.sym("U", 2, M)
        start, rate = ca.SX.sym("start", 5), ca.SX.sym("rate")
        gaps = [X[:, 0] - start] + [X[:, i + 1] - self.advanced(X[:, i], U[:, i]) for i in range(M)]
        nlp = {
            "x": ca.vertcat(ca.vec(X), ca.vec(U)),
            "f": self.summed(X, U, rate),
            "g": ca.vertcat(*gaps),
            "p": ca.vertcat(start, rate),
        }
        quiet = {
            "print_time": False,
            "ipopt.print_level": 0,
            "ipopt.sb": "yes",
            "ipopt.tol": 1e-9,
            "ipopt.max_iter": 500,
        }
        self.solver = ca.nlpsol("mpcc", "ipopt", nlp, quiet)
        free = np.full(5 * (M + 1), np.inf)
        self.bounds = {
            "lbx": np.r_[-free, np.tile(self.low, M)],
            "ubx": np.r_[free, np.tile(self.high, M)],
            "lbg": 0,
            "ubg": 0,
        }

    def solve(self, state, phase_rate, guess):
        """Return cost and controls (M, 2) of IPOPT from the guess."""
        M = self.p.stages
        x0 = np.r_[self.rollout(state, guess).ravel(), np.ravel(guess)]
        solution = self.solver(x0=x0, p=np.r_[state, phase_rate], **self.bounds)
        control = np.array(solution["x"]).ravel()[5 * (M + 1) :].reshape(M, 2)
        return self.cost(state, phase_rate, np.clip(control, self.low, self.high)), control


def plant_step(robot: Robot, z: np.ndarray, u: np.ndarray, h: float) -> np.ndarray:
    """Return the cars (n, 4) after h under controls (n, 2): the simulated car, with its dead zone and no reversing."""
    push = np.where(u[:, 1] > robot.dead_zone, robot.drive * u[:, 1] - robot.offset, 0.0)

    def rates(z):
        v = np.maximum(z[:, 3], 0)
        return np.stack(
            [v * np.cos(z[:, 2]), v * np.sin(z[:, 2]), v * np.tan(u[:, 0]) / robot.wheelbase, push - robot.drag * v],
            axis=1,
        )

    k1 = rates(z)
    k2 = rates(z + h / 2 * k1)
    k3 = rates(z + h / 2 * k2)
    k4 = rates(z + h * k3)
    moved = z + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    moved[:, 3] = np.maximum(moved[:, 3], 0)
    return moved


def tangent(curve: Curve, gamma: np.ndarray) -> np.ndarray:
    """Return r'(gamma), (n, 2) [m/rad]."""
    return np.stack(
        [
            -curve.half_width * curve.a * np.sin(curve.a * gamma),
            curve.half_height * curve.b * np.cos(curve.b * gamma),
        ],
        axis=1,
    )


def closed_loop(mpcc: Mpcc, curve: Curve, steps: int):
    """Run the experiment of Section VII with our solver; return its problems and the time per warm solve [s]."""
    robot, n, h = Robot(), len(RING), mpcc.parameters.step
    phase = closed_forms.equilibrium_phases(n, 2, RING)
    d = tangent(curve, phase)
    z = np.c_[
        closed_forms.curve_point(curve, phase), np.arctan2(d[:, 1], d[:, 0]), PHASE_RATE * np.hypot(d[:, 0], d[:, 1])
    ]
    before, after = np.empty(n, int), np.empty(n, int)
    before[list(RING)], after[list(RING)] = np.roll(RING, 1), np.roll(RING, -1)
    states, rates, guesses, warm = [], [], [], []
    for _ in range(steps):
        rate = PHASE_RATE - np.sin(phase[before] - phase) - np.sin(phase[after] - phase)
        state = np.c_[z, np.mod(phase, 2 * np.pi)]
        guess = mpcc.control.numpy()
        states.append(state)
        rates.append(rate)
        guesses.append(np.concatenate([guess[:, 1:], guess[:, -1:]], axis=1))
        mpcc.state.assign(state.astype(np.float32))
        mpcc.phase_rate.assign(rate.astype(np.float32))
        begin = time.perf_counter()
        mpcc.launch()
        warm.append((time.perf_counter() - begin) / n)
        control = mpcc.control.numpy()[:, 0]
        for _ in range(2):
            z = plant_step(robot, z, control, h / 2)
            d = tangent(curve, phase)
            off = z[:, :2] - closed_forms.curve_point(curve, phase)
            phase = phase + np.clip((d * off).sum(1) / (d * d).sum(1), -0.05, 0.05)
    skip = slice(1, None)
    problems = Problems(np.concatenate(states[skip]), np.concatenate(rates[skip]), np.concatenate(guesses[skip]))
    return problems, np.array(warm[skip])


def random_problems(count: int, curve: Curve, p: MpccParameters, rng: np.random.Generator) -> Problems:
    """Return random states near the curve, with a guess of straight on at the wanted speed."""
    gamma = rng.uniform(0, 2 * np.pi, count)
    d = tangent(curve, gamma)
    speed = np.hypot(d[:, 0], d[:, 1])
    state = np.c_[
        closed_forms.curve_point(curve, gamma) + rng.normal(0, 0.1, (count, 2)),
        np.arctan2(d[:, 1], d[:, 0]) + rng.normal(0, 0.3, count),
        PHASE_RATE * speed * rng.uniform(0.5, 1.5, count),
        gamma,
    ]
    rate = rng.uniform(0.1, 0.6, count)
    guess = np.zeros((count, p.stages, 2))
    guess[:, :, 1] = np.clip((p.drag * rate * speed + p.offset) / p.drive, p.throttle_min, p.throttle_max)[:, None]
    return Problems(state, rate, guess)


def accuracy(problems: Problems, solution: Solution, costs: np.ndarray, ipopt: Ipopt) -> dict[str, str]:
    """Return in words the cost of a solution relative to IPOPT's costs (n,) on a set."""
    controls = solution.control.astype(float)
    own_costs = [ipopt.cost(*problem) for problem in zip(problems.state, problems.phase_rate, controls, strict=True)]
    excess = np.array(own_costs) / costs - 1
    return {
        "cost above IPOPT's, median": f"{np.median(excess):.1e}",
        "cost above IPOPT's, 99th percentile": f"{np.percentile(excess, 99):.1e}",
        "at most 1 % above IPOPT's [% of the states]": number(100 * float(np.mean(excess <= 0.01))),
        "at most 0.1 % above IPOPT's [% of the states]": number(100 * float(np.mean(excess <= 0.001))),
        "better than IPOPT by 1 % [% of the states]": number(100 * float(np.mean(excess < -0.01))),
        "NaN": str(np.isnan(solution.control).any(axis=(1, 2)).sum()),
        "failures": str(int((solution.cost > 1e38).sum())),
    }
