"""The paper's experiment: the results of Fig. 9 compared with simulated ones, with and without feedback.

Command: `python benchmarks/experiment.py --store`, which stores the rows without the fault as the table `experiment`
of docs/figures.json.
"""

import figures
import numpy as np
from rich.console import Console
from rich.table import Table

import baselines
import lissajous_env

COLUMNS = {
    "spacing_factor": "eta_1",
    "min_separation": "smallest distance [m]",
    "collisions": "collisions",
    "lateral_error_mean": "distance from the curve, mean [m]",
    "tracking_error_mean": "tracking error, mean [m]",
    "tracking_error_max": "tracking error, max [m]",
    "phase_error": "phase error [rad]",
}


def main() -> None:
    """Print one row for each policy, without and with the fault: minimum, mean and maximum over 16 seeds."""
    options = figures.parser(__doc__).parse_args()
    table = Table("policy", "fault", *COLUMNS.values(), title="experiment, 60 s, 16 seeds: min / mean / max")
    table.add_row("the paper's report", "no", "1.2429", "0.192", "1", "", "", "")
    columns = ("spacing_factor", "min_separation", "collisions", "phase_error")
    stored = [["the paper", "1.2429", "0.192", "1", ""]]
    for faults in ((), lissajous_env.scenario("experiment").faults.schedule):
        scenario = lissajous_env.scenario("experiment", **{"faults.schedule": faults})
        for name in ("kuramoto-mpcc", "open-loop-mpcc"):
            rows = lissajous_env.evaluate(baselines.make(name, scenario, num_worlds=16), scenario, range(16))
            values = [np.array([row[column] for row in rows], dtype=float) for column in COLUMNS]
            cells = [f"{v.min():.3g} / {v.mean():.3g} / {v.max():.3g}" for v in values]
            table.add_row(name, "yes" if faults else "no", *cells)
            if not faults:
                ends = (np.array([row[column] for row in rows], dtype=float) for column in columns)
                stored.append([f"`{name}`", *(f"{v.min():.3g} to {v.max():.3g}" for v in ends)])
    Console().print(table)
    if options.store:
        figures.store({"experiment": {"columns": ["", *(COLUMNS[column] for column in columns)], "rows": stored}})


if __name__ == "__main__":
    main()
