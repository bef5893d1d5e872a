"""The program of the collision filter, solved by CasADi and by HiGHS."""

import casadi as ca
import numpy as np
from scipy.optimize import linprog

from baselines.safety.filter import SafetyParameters
from baselines.safety.quadratic_program import TOLERANCE

QUIET = {"print_iter": False, "print_header": False, "print_info": False, "print_time": False, "error_on_fail": False}
WEIGHT = SafetyParameters().throttle_weight


def program_by_casadi(rows, top, wanted, slack):
    """Solve the program with every row relaxed by `slack`, by CasADi's active-set solver in float64."""
    u = ca.SX.sym("u", 2)
    scale = 1 / np.linalg.norm(rows[:, :2], axis=1).clip(1e-6)  # the solver likes its rows of length one
    cost = (u[0] - wanted[0]) ** 2 + WEIGHT * (u[1] - wanted[1]) ** 2
    solver = ca.qpsol(
        "program", "qrqp", {"x": u, "f": cost, "g": ca.mtimes(ca.DM(scale[:, None] * rows[:, :2]), u)}, QUIET
    )
    low = scale * (rows[:, 2] - slack)
    found = np.array(solver(lbx=[-1, -1], ubx=[1, top], lbg=low, ubg=np.inf)["x"]).ravel()
    return found, solver.stats()["success"] and (rows[:, 2] - slack - rows[:, :2] @ found).max() < 1e-6


def least_violation_by_linprog(rows, top):
    """Smallest s with g.u >= c - s in the box, by HiGHS."""
    constraint = np.c_[-rows[:, :2], -np.ones(len(rows))]
    return linprog([0, 0, 1], constraint, -rows[:, 2], bounds=[(-1, 1), (-1, top), (0, None)]).x[2]


def cost_of(u, wanted):
    return (u[0] - wanted[0]) ** 2 + WEIGHT * (u[1] - wanted[1]) ** 2


def agrees_with_independent_solvers(rows, top, wanted, action):
    """Whether the program is feasible, and whether CasADi could judge; fails where an action is not its solution."""
    rows, wanted, action = (np.asarray(each, dtype=float) for each in (rows, wanted, action))
    least = least_violation_by_linprog(rows, top)
    assert (rows[:, 2] - rows[:, :2] @ action).max() <= least + 2 * float(TOLERANCE)
    # The filter may leave twice its tolerance missing: its cost lies between those of the two programs.
    exact, found = program_by_casadi(rows, top, wanted, least + 1e-8)
    looser, also = program_by_casadi(rows, top, wanted, least + 2 * float(TOLERANCE))
    if found and also:
        cost, low, high = (cost_of(each, wanted) for each in (action, looser, exact))
        assert low - 5e-4 * (1 + low) <= cost <= high + 5e-4 * (1 + high)
    return least < 1e-9, found and also
