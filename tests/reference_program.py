"""The program of the collision filter, solved by CasADi and by HiGHS."""

from functools import lru_cache

import casadi as ca
import numpy as np
from scipy.optimize import linprog

from baselines.policies.safety.filter import SafetyParameters
from baselines.policies.safety.quadratic_program import TOLERANCE

QUIET = {"print_iter": False, "print_header": False, "print_info": False, "print_time": False, "error_on_fail": False}
WEIGHT = SafetyParameters().throttle_weight


@lru_cache
def solver_of(count):
    """Active-set solver of programs with so many rows; to make one takes longer than to solve its program."""
    return ca.conic("program", "qrqp", {"h": ca.Sparsity.diag(2), "a": ca.Sparsity.dense(count, 2)}, QUIET)


def program_by_casadi(rows, top, wanted, slack):
    """Solve the program with every row relaxed by `slack`, by CasADi's active-set solver in float64."""
    scale = 1 / np.linalg.norm(rows[:, :2], axis=1).clip(1e-6)  # the solver likes its rows of length one
    weights, solver = np.array([1.0, WEIGHT]), solver_of(len(rows))
    cost = {"h": ca.diag(2 * weights), "g": -2 * weights * wanted[:2]}
    box = {"lbx": [-1, -1], "ubx": [1, top]}
    low = scale * (rows[:, 2] - slack)
    found = solver(**cost, **box, a=scale[:, None] * rows[:, :2], lba=low, uba=np.inf)
    u = np.array(found["x"]).ravel()
    return u, solver.stats()["success"] and (rows[:, 2] - slack - rows[:, :2] @ u).max() < 1e-6


def least_violation_by_linprog(rows, top):
    """Smallest s with g.u >= c - s in the box, by HiGHS."""
    constraint = np.c_[-rows[:, :2], -np.ones(len(rows))]
    return linprog([0, 0, 1], constraint, -rows[:, 2], bounds=[(-1, 1), (-1, top), (0, None)]).x[2]


def cost_of(u, wanted):
    return (u[0] - wanted[0]) ** 2 + WEIGHT * (u[1] - wanted[1]) ** 2


def agrees_with_independent_solvers(rows, top, wanted, action):
    """Return if the program is feasible, and if CasADi could judge; fail where an action is not its solution."""
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
