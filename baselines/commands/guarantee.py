"""The command `lissajous guarantee`: critical speeds of evading targets."""

import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from rich.console import Console
from rich.text import Text

from baselines.benchmark.types import require_distinct_names
from lissajous_env.console.terminal import (
    DEFAULT_OUTPUT,
    Output,
    Overrides,
    ScenarioNames,
    parse_overrides,
    print_table,
)
from lissajous_env.device.devices import cores
from lissajous_env.episodes.guarantee import IdealFormation
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import whole_number
from lissajous_env.wording import require


def guarantee(
    scenarios: ScenarioNames = ("experiment", "ideal"),
    radii: int = 22,
    cells: int = 90,
    output: Output = DEFAULT_OUTPUT,
    overrides: Overrides = (),
) -> None:
    """Compute how fast a target must be to evade a formation for ever.

    The critical speed is printed for the scenario's sensing radius (in bold) and a range of others. It is the speed of
    targets that know the robots' future and may start anywhere.

    Example:
        lissajous guarantee evaders team

    Args:
        scenarios: names of scenarios, .toml files, or module:attribute; by default the paper's two curves.
        radii: number of sensing radii, from 0.3 to 1.35 times that of Eq. (8) of the paper, beside the scenario's own.
        cells: grid cells along the longer side of the rectangle; more of them are more precise and slower.
    """
    whole_number("radii", radii, 2, 200)
    whole_number("cells", cells, 10, 1000)
    changed = parse_overrides(overrides)
    chosen, guarantees = require_distinct_names([named.scenario(name, **changed) for name in scenarios]), {}
    for scenario in chosen:
        rule = "must be empty: the radii are multiples of that of Eq. (8), which is for Lissajous curves"
        require(scenario.detection_radius > 0, f"curve.harmonics of {scenario.name}", rule, scenario.curve.harmonics)
        IdealFormation(scenario, cells=cells).against(scenario.rogue_speed)  # refuses a scenario before any is computed
    for scenario in chosen:
        guarantees[scenario.name] = formation_guarantees(scenario, radii, cells)
        _print(output.console(), scenario, guarantees[scenario.name], cells)
    output.print_json(guarantees)


def formation_guarantees(scenario: Scenario, radii: int, cells: int) -> list[dict[str, float]]:
    """Return critical speeds and guaranteed times for the sensing radius, and 0.3 to 1.35 times that of Eq. (8)."""

    def of_share(share: float) -> dict[str, float]:
        points = IdealFormation(scenario, share * scenario.detection_radius, cells)
        times = {"guaranteed_time": points.guaranteed_time(scenario.rogue_speed)}
        return {"radius": points.radius, "critical_speed": points.critical_speed()} | times

    own = scenario.sensing_radius / scenario.detection_radius  # one of the range, apart from rounding errors, or not
    shares = np.unique(np.append(np.linspace(0.3, 1.35, radii), own).round(12))
    with ThreadPoolExecutor(cores()) as threads:
        return list(threads.map(of_share, shares.tolist()))


def _print(console: Console, scenario: Scenario, rows: Sequence[dict[str, float]], cells: int) -> None:
    """Print a row for each sensing radius, computed with this number of cells along the longer side."""
    speed, own, required = scenario.rogue_speed, scenario.sensing_radius, scenario.detection_radius
    words = f"N = {scenario.num_robots}, T_max = {scenario.detection_time_bound:.3g} s, sensing radius {own:.3g} m"
    console.print(Text.assemble((scenario.name, "bold"), f"  {words}, Eq. (8) requires {required:.3g} m"))
    columns = ["sensing\nradius [m]", "over that\nof Eq. (8)", "evaded for ever\nfrom [m/s]"]
    columns += [f"at {speed:g} m/s undetected\nfor at most [s]"]
    highest = IdealFormation(scenario, cells=cells).fastest_rogue
    print_table(console, columns, [
        [
            Text(f"{row['radius']:.3g}", "bold" if math.isclose(row["radius"], own) else ""),
            f"{row['radius'] / required:.2f}",
            f"{row['critical_speed']:.3g}" if row["critical_speed"] < math.inf else f"> {highest:.3g}",
            f"{row['guaranteed_time']:.1f}" if row["guaranteed_time"] < math.inf else "for ever",
        ]
        for row in rows
    ])  # fmt: skip
    console.print()
