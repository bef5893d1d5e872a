"""Time and optimality of the MPCC against acados on the same problems: `python benchmarks/acados.py`.

Both sides solve problem (11)-(15) from the same first guess, on one thread, by turns: `warm`, where each follows the
states that five cars met in closed loop and starts from its own last solution, shifted by a stage, and `cold`, random
states near the curve with controls that pursue it (the guess that `Mpcc` makes itself). A time of acados is that of its
own clock inside `solve`, without Python; ours includes the launch from Python. Of each state the shortest time of the
rounds counts. A cost is (11a) of the controls, clipped to their bounds and rolled out in float64 from the state; the
best found is the smallest of all sides. Tolerance, globalisation and Hessian of acados are those that did best of the
ones tried. `--store` puts the tables into docs/figures.json.

acados is not on PyPI. Build it with `-DACADOS_WITH_DAQP=ON -DCMAKE_C_FLAGS="-O3 -march=native"`, install its
`interfaces/acados_template` with pip next to the extra `bench`, set ACADOS_SOURCE_DIR to its folder, and add the `lib`
in it to LD_LIBRARY_PATH. (The wheel `comma-deps-acados` has an older version, and its files overwrite CasADi's.)
"""

import tempfile
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import casadi as ca
import figures
import numpy as np
import warp as wp
from mpcc import RING, Model, Problems, closed_loop, random_problems
from timing import ratio_in_words

from baselines.benchmark.statistics import number
from baselines.mpcc.kernel import along_curve
from baselines.mpcc.model import MpccStruct, Table, advance, speeds_of, tabulate, vec5
from baselines.mpcc.solver import Mpcc, MpccParameters
from lissajous_env.device.curve import CurveStruct, curve_struct
from lissajous_env.device.structs import to_struct
from lissajous_env.parameters.scenario import Curve

try:
    from acados_template import AcadosOcp, AcadosOcpSolver
except ImportError as error:
    raise ImportError("benchmarks/acados.py requires acados_template; its docstring describes the build") from error

_HPIPM = {"qp_solver": "PARTIAL_CONDENSING_HPIPM"}
QP_SOLVERS: dict[str, dict[str, Any]] = {
    "HPIPM, 5 stages": {**_HPIPM, "qp_solver_cond_N": 5},
    "HPIPM, 15 stages": {**_HPIPM, "qp_solver_cond_N": 15},
    "HPIPM, condensed": {**_HPIPM, "qp_solver": "FULL_CONDENSING_HPIPM"},
    "DAQP, condensed": {"qp_solver": "FULL_CONDENSING_DAQP", "qp_solver_warm_start": 1},
}
"""Partial condensing to a number of stages, or full condensing, and the solver of the quadratic programs."""

# HPIPM's SPEED_ABS is faster still, but the residuals that it leaves are above what SQP requires to stop.
_SQP = {"nlp_solver_type": "SQP", "hpipm_mode": "SPEED", "nlp_solver_tol_stat": 3e-3, "nlp_solver_tol_eq": 1e-3}
METHODS: dict[str, tuple[dict[str, Any], tuple[str, ...]]] = {
    "SQP_RTI": ({"nlp_solver_type": "SQP_RTI", "hpipm_mode": "SPEED_ABS"}, tuple(QP_SOLVERS)),
    "SQP": ({**_SQP, "globalization": "MERIT_BACKTRACKING"}, tuple(QP_SOLVERS)),
    "SQP, exact Hessian": (
        {
            **_SQP,
            "globalization": "FUNNEL_L1PEN_LINESEARCH",
            "hessian_approx": "EXACT",
            "regularize_method": "PROJECT",
        },
        ("DAQP, condensed",),
    ),
}
"""One real-time iteration, and iterations to convergence with the Gauss-Newton or the exact Hessian."""

CONVERGED, ONE_START, ONE_ITERATION = "ours", "ours, one start", "ours, one start and iteration"


class Solved(NamedTuple):
    """Solutions of n problems: controls (n, M, 2), trajectories (n, M + 1, 5), times (n,) [s], failures (n,)."""

    control: np.ndarray
    trajectory: np.ndarray
    seconds: np.ndarray
    failed: np.ndarray


@dataclass
class Set:
    """Problems with first guesses; `fresh` (n,) marks those that start from it, others from the last solution."""

    problems: Problems
    fresh: np.ndarray


class MpccSolver:
    """One `Mpcc` of this package."""

    def __init__(self, curve: Curve, parameters: MpccParameters):
        self.mpcc = Mpcc(curve, parameters, threads=1)

    def solve(self, state: np.ndarray, phase_rate: float, guess: np.ndarray, fresh: bool):
        """Solve from the last solution, or afresh: its own first guess is `guess`."""
        if fresh:
            self.mpcc.reset()
        self.mpcc.state.assign(state[None].astype(np.float32))
        self.mpcc.phase_rate.fill_(phase_rate)
        begin = time.perf_counter()
        self.mpcc.launch()
        seconds = time.perf_counter() - begin
        control, trajectory = (array.numpy()[0].astype(float) for array in (self.mpcc.control, self.mpcc.trajectory))
        return control, trajectory, seconds, self.mpcc.cost.numpy()[0] > 1e38


class Acados:
    """The same problem as an acados solver, generated and compiled in a folder."""

    def __init__(self, model: Model, folder: Path, settings: Mapping[str, Any]):
        self.model, p = model, model.p
        ocp = AcadosOcp()
        ocp.model.name = folder.name
        ocp.model.x, ocp.model.u, ocp.model.p = ca.SX.sym("x", 5), ca.SX.sym("u", 2), ca.SX.sym("rate")
        ocp.model.disc_dyn_expr = model.advanced(ocp.model.x, ocp.model.u)
        errors = model.errors(ocp.model.x, ocp.model.p)
        ocp.model.cost_y_expr, ocp.model.cost_y_expr_e = ca.vertcat(errors, ocp.model.u), errors
        weights = [1, p.weight_lag, p.weight_lateral, p.weight_steering, p.weight_throttle]
        # acados halves the squares.
        ocp.cost.cost_type = ocp.cost.cost_type_e = "NONLINEAR_LS"
        ocp.cost.W, ocp.cost.W_e = 2 * np.diag(weights), 2 * np.diag(weights[:3])
        ocp.cost.yref, ocp.cost.yref_e = np.zeros(5), np.zeros(3)
        ocp.constraints.idxbu = np.arange(2)
        ocp.constraints.lbu, ocp.constraints.ubu = np.array(model.low), np.array(model.high)
        ocp.constraints.x0, ocp.parameter_values = np.zeros(5), np.zeros(1)
        options = ocp.solver_options
        options.N_horizon, options.tf = p.stages, p.stages * p.step
        options.cost_scaling = np.ones(p.stages + 1)
        options.integrator_type = "DISCRETE"
        for name, value in settings.items():
            setattr(options, name, value)
        ocp.code_gen_options.code_export_directory = str(folder)
        ocp.code_gen_options.json_file = f"{folder.name}.json"
        ocp.code_gen_options.ext_fun_compile_flags = "-O3 -march=native"
        self.solver = AcadosOcpSolver(ocp, verbose=False)

    def solve(self, state: np.ndarray, phase_rate: float, guess: np.ndarray, fresh: bool):
        """Solve from `guess`, rolled out from the state; the multipliers of the last solve are kept unless `fresh`."""
        if fresh:
            self.solver.reset()
        self.solver.set_flat("x", self.model.rollout(state, guess).ravel())
        self.solver.set_flat("u", np.ravel(guess))
        self.solver.set_flat("p", np.full(self.model.p.stages + 1, phase_rate))
        self.solver.set(0, "lbx", state)
        self.solver.set(0, "ubx", state)
        status = self.solver.solve()
        seconds = self.solver.get_stats("time_tot")
        control, trajectory = self.solver.get_flat("u").reshape(-1, 2), self.solver.get_flat("x").reshape(-1, 5)
        if not np.isfinite(control).all():
            control = guess
        return control, trajectory, seconds, status != 0


@wp.kernel
def pursue(
    p: MpccStruct,
    curve: CurveStruct,
    table: Table,
    state: wp.array(dtype=vec5),
    phase_rate: wp.array(dtype=float),
    control_out: wp.array3d(dtype=float),
):
    """Lay out the first guess of `Mpcc`."""
    k = wp.tid()
    z = state[k]
    for i in range(p.stages):
        u = along_curve(p, curve, table, z, phase_rate[k], True)
        control_out[k, i, 0] = u[0]
        control_out[k, i, 1] = u[1]
        z = advance(p, speeds_of(p), table, z, u)


def first_guesses(curve: Curve, p: MpccParameters, state: np.ndarray, phase_rate: np.ndarray) -> np.ndarray:
    """Return the controls (n, M, 2) from which `Mpcc` starts without a last solution."""
    control = wp.zeros((len(state), p.stages, 2), dtype=float, device="cpu")
    inputs = [to_struct(MpccStruct, p), curve_struct(curve, "cpu"), tabulate(curve, "cpu")]
    arrays = [wp.array(state, dtype=vec5, device="cpu"), wp.array(phase_rate, dtype=float, device="cpu")]
    wp.launch(pursue, len(state), inputs=[*inputs, *arrays], outputs=[control], device="cpu")
    return control.numpy().astype(float)


def problem_sets(curve: Curve, p: MpccParameters, steps: int, states: int) -> dict[str, Set]:
    """Return the two sets; the warm one has the five cars one after the other."""
    met, _ = closed_loop(Mpcc(curve, p, len(RING), threads=1), curve, steps + 1)
    by_car = met[np.arange(steps * len(RING)).reshape(steps, len(RING)).T.ravel()]
    near = random_problems(states, curve, p, np.random.default_rng(0))
    by_name = {}
    for name, problems, first in (("warm", by_car, np.arange(steps * len(RING)) % steps == 0), ("cold", near, None)):
        problems.guess = first_guesses(curve, p, problems.state, problems.phase_rate)
        by_name[name] = Set(problems, np.ones(len(problems.state), bool) if first is None else first)
    return by_name


def solve_all(side: MpccSolver | Acados, problem_set: Set) -> Solved:
    """Solve the problems of a set one after the other."""
    problems, solutions = problem_set.problems, []
    for k, fresh in enumerate(problem_set.fresh):
        guess = problems.guess[k] if fresh else np.concatenate([solutions[-1][0][1:], solutions[-1][0][-1:]])
        solutions.append(side.solve(problems.state[k], problems.phase_rate[k], guess, bool(fresh)))
    return Solved(*map(np.array, zip(*solutions, strict=True)))


def violation(model: Model, solved: Solved) -> float:
    """Return the largest difference of a predicted state from the model's, or of a control from its bounds."""
    starts, ends = solved.trajectory[:, :-1].reshape(-1, 5), solved.trajectory[:, 1:].reshape(-1, 5)
    controls = solved.control.reshape(-1, 2)
    gaps = np.abs(np.array(model.advance(starts.T, controls.T)).T - ends).max()
    return float(max(gaps, np.abs(controls - np.clip(controls, model.low, model.high)).max()))


def measured(model: Model, sides: Mapping[str, MpccSolver | Acados], problem_set: Set, rounds: int) -> figures.Table:
    """Run the sides by turns; the table of times and costs."""
    turns: list[dict[str, Solved]] = []
    for _ in range(rounds):
        turns.append({name: solve_all(side, problem_set) for name, side in sides.items()})
    # The start of a car is not warm.
    counted = np.ones(len(problem_set.fresh), bool) if problem_set.fresh.all() else ~problem_set.fresh
    states, rates = problem_set.problems.state[counted], problem_set.problems.phase_rate[counted]
    costs = {}
    for name, solved in turns[-1].items():
        controls = np.clip(solved.control[counted], model.low, model.high)
        costs[name] = np.array([model.cost(*problem) for problem in zip(states, rates, controls, strict=True)])
    best = np.min(list(costs.values()), axis=0)
    times = {name: np.array([turn[name].seconds[counted] for turn in turns]) * 1e6 for name in sides}
    rows = []
    for name in sides:
        excess, shortest = costs[name] / best - 1, times[name].min(axis=0)
        rows.append(
            [
                name,
                number(float(np.median(shortest))),
                number(float(np.percentile(shortest, 99))),
                "" if name == CONVERGED else _ratio(times[CONVERGED], times[name]),
                f"{np.median(excess):.1e}",
                f"{np.percentile(excess, 99):.1e}",
                number(100 * float(np.mean(excess <= 0.01))),
                f"{violation(model, turns[-1][name]):.0e}",
                str(int(turns[-1][name].failed[counted].sum())),
            ]
        )
    titles = ["solver", "median [us]", "99th percentile [us]", "times as long as ours", "cost above the best, median"]
    titles += ["cost above the best, 99th percentile", "at most 1 % above the best [% of the states]"]
    return {"columns": [*titles, "largest violation", "failures"], "rows": rows}


def _ratio(own: np.ndarray, others: np.ndarray) -> str:
    return ratio_in_words(np.median(own, axis=1).tolist(), np.median(others, axis=1).tolist())


def main(arguments: Sequence[str] | None = None) -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--steps", type=int, default=100, help="control steps of each of the five cars")
    parser.add_argument("--states", type=int, default=500, help="random states")
    options = parser.parse_args(arguments)
    if min(options.rounds, options.steps - 1, options.states) < 1:
        parser.error("--rounds and --states must be at least 1 and --steps at least 2")
    warnings.filterwarnings("ignore", message="CasADi version")
    curve, p = Curve(), MpccParameters()
    model = Model(curve, p)
    one_start = replace(p, poor=1e6)
    sides: dict[str, MpccSolver | Acados] = {
        CONVERGED: MpccSolver(curve, p),
        ONE_START: MpccSolver(curve, one_start),
        ONE_ITERATION: MpccSolver(curve, replace(one_start, max_iterations=1)),
    }
    with tempfile.TemporaryDirectory() as folder:
        for method, (settings, solvers) in METHODS.items():
            for solver in solvers:
                place = Path(folder) / f"solver_{len(sides)}"
                sides[f"{method}, {solver}"] = Acados(model, place, {**settings, **QP_SOLVERS[solver]})
        tables = {}
        for name, problem_set in problem_sets(curve, p, options.steps, options.states).items():
            tables[f"acados_{name}"] = measured(model, sides, problem_set, options.rounds)
            figures.show(name, tables[f"acados_{name}"])
    if options.store:
        figures.store(tables)


if __name__ == "__main__":
    main()
