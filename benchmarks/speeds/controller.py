"""Time and cost of a solve of the contouring controller, compared with CasADi + IPOPT on the same problems.

Both use one thread. The time of this package is the shortest of the rounds, that of IPOPT the median over the
problems, each of which is solved once.
"""

import time
from typing import TYPE_CHECKING

import numpy as np
from figures import Table

from baselines.benchmark.statistics import number
from baselines.mpcc.solver import Mpcc, MpccParameters, Solution
from lissajous_env.parameters.scenario import Curve
from speeds import Options, Part

if TYPE_CHECKING:
    from mpcc import Ipopt, Problems

STATES = 500
"""Number of problems in each set."""
_SEED = 0


def timed(mpcc: Mpcc, problems: "Problems", guess: bool, rounds: int) -> tuple[Solution, float]:
    """Solve a set, and return the solution and the shortest time per problem [s]."""
    solutions, times = [], []
    for _ in range(rounds):
        mpcc.reset()
        begin = time.perf_counter()
        solutions.append(mpcc.solve(problems.state, problems.phase_rate, problems.guess if guess else None))
        times.append((time.perf_counter() - begin) / len(problems.phase_rate))
    return solutions[-1], min(times)


def timed_ipopt(ipopt: "Ipopt", problems: "Problems") -> tuple[np.ndarray, float]:
    """Return the costs (n,) that IPOPT finds from the guesses, and the median of its times [s]."""
    costs, times = [], []
    for problem in zip(problems.state, problems.phase_rate, problems.guess, strict=True):
        begin = time.perf_counter()
        costs.append(ipopt.solve(*problem)[0])
        times.append(time.perf_counter() - begin)
    return np.array(costs), float(np.median(times))


def compare(problems: "Problems", curve: Curve, p: MpccParameters, options: Options) -> dict[str, str]:
    """Return the results of this package, and of IPOPT if `rivals` is set, on one set, in words."""
    from mpcc import Ipopt, accuracy

    count = len(problems.phase_rate)
    controller = Mpcc(curve, p, batch=count, threads=1)
    _, cold = timed(controller, problems, False, options.rounds)
    solution, guessed = timed(controller, problems, True, options.rounds)
    words = {
        "states": str(count),
        "solve without a guess [us]": number(cold * 1e6),
        "solve from the guess [us]": number(guessed * 1e6),
    }
    if not options.rivals:
        return words
    ipopt = Ipopt(curve, p)
    costs, ipopt_time = timed_ipopt(ipopt, problems)
    words |= {
        "IPOPT from the guess, median [us]": number(ipopt_time * 1e6),
        "IPOPT takes, times as long": number(ipopt_time / guessed),
    }
    return words | accuracy(problems, solution, costs, ipopt)


def tables(options: Options) -> dict[str, Table]:
    """Measure, and return the table `mpcc`."""
    from mpcc import RING, closed_loop, random_problems

    rng = np.random.default_rng(_SEED)
    curve, p = Curve(), MpccParameters()
    states, steps = (10, 20) if options.quick else (STATES, 600)
    runs = [closed_loop(Mpcc(curve, p, len(RING), threads=1), curve, steps) for _ in range(options.rounds)]
    met, warm = runs[0][0], np.min([run[1] for run in runs], axis=0)
    met = met[rng.permutation(len(met.phase_rate))[:states]]
    in_loop = compare(met, curve, p, options)
    near = compare(random_problems(states, curve, p, rng), curve, p, options)
    rows = [[name, words, near[name]] for name, words in in_loop.items()]
    rows.insert(1, ["warm solve in closed loop, mean [us]", number(float(warm.mean()) * 1e6), ""])
    return {"mpcc": {"columns": ["", "closed loop", "random"], "rows": rows}}


PART = Part(
    "controller",
    "a solve of the contouring controller beside CasADi + IPOPT, and what their solutions cost",
    tables,
    rounds=5,
    needs={"casadi": "bench"},
)
