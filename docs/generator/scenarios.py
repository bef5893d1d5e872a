"""Pages of the scenarios: everything that follows from the code, and the results of the policies."""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

import lissajous_env
from baselines.benchmark.types import Benchmark
from benchmarks import figures
from docs.generator import replays
from docs.generator.files import table, write_changed
from docs.generator.pictures import MOST_TARGETS, picture_of
from lissajous_env.console.scenarios import measured, value_of_feedback
from lissajous_env.envs.sides import action_table
from lissajous_env.parameters.scenario import PARTS, Scenario, Task
from lissajous_env.settings.checks import meanings
from lissajous_env.world.observation import layout
from lissajous_env.world.tally import FORMULAS

_HERE = Path(__file__).parent
_BOUNDARY = {
    "open": "A car may leave the rectangle; `outside_time` counts the time for which whole bodies were outside.",
    "wall": "A wall stops a car's body and removes the component of its velocity into the wall.",
    "remove": "A car whose whole body is outside is removed: its agent is terminated.",
}
_INSIDE = "Points remain on the curve, inside the rectangle."
_COLLISION = {
    "count": "Collisions are counted and enter the reward, but do not end the episode.",
    "stop": "Two robots that collide stop for good; the episode continues.",
    "remove": "Two robots that collide are removed: their agents are terminated.",
}
_LIMITS = {
    "steering_max": "rad", "throttle_min": "", "throttle_max": "", "phase_rate_max": "rad/s", "speed_min": "m/s",
    "speed_max": "m/s", "yaw_rate_max": "rad/s",
}  # fmt: skip
"""Fields of a robot that limit its actions, with their units."""


def make(folder: Path, replay_folder: Path) -> None:
    """Write the page, the picture and the replay of each scenario, and the list of scenarios."""
    scenarios = [lissajous_env.scenario(name) for name in lissajous_env.scenarios()]
    stored = figures.load()
    for scenario in scenarios:
        write_changed(folder / f"{scenario.name}.png", picture_of(scenario))
        replay = replays.write_replay(scenario, replay_folder)
        write_changed(folder / f"{scenario.name}.md", page(scenario, stored, replay))
    write_changed(folder / "index.md", listing(scenarios))


def listing(scenarios: Sequence[Scenario]) -> str:
    """Return the page that lists the scenarios."""
    rows = [
        [f"[`{scenario.name}`]({scenario.name}.md)", f"{scenario.num_robots} {_robots(scenario)}", _sides(scenario),
         f"{scenario.sensing_radius:.3g}", scenario.description]
        for scenario in scenarios
    ]  # fmt: skip
    fields = {
        "listing": table(["scenario", "robots", "rectangle [m]", "sensor r_s [m]", "description"], rows),
        "usual": ", ".join(f"`{name}`" for name in Benchmark().scenarios),
        "names": "\n".join(scenario.name for scenario in scenarios),
    }
    return Template((_HERE / "scenario_list.md").read_text(encoding="utf-8")).substitute(fields)


def page(scenario: Scenario, stored: dict[str, Any], replay: str) -> str:
    """Return the page of a scenario: the filled `scenario_page.md`.

    Args:
        scenario: The scenario, unresolved.
        stored: Tables of docs/figures.json.
        replay: Markdown that shows a replay on the page; empty for none.
    """
    resolved = scenario.resolve()
    task, actions, entries = resolved.task, action_table(resolved), layout(resolved)
    fields = {
        "name": scenario.name,
        "description": scenario.description,
        "policy": replays.policy_for(scenario),
        "fewer": f" {MOST_TARGETS:,} targets are drawn." if resolved.targets.count > MOST_TARGETS else "",
        "numbers": table(["quantity", "value"], numbers(resolved)),
        "differing": table(["field", "value", "default", "meaning"], differing(scenario)),
        "size": entries.size,
        "observation": table(["index", "name", "meaning [unit]", "range"], observation(resolved)),
        "action_size": resolved.action_size,
        "action": table(["index", "name", "meaning at -1 and 1", "range"], action(resolved)),
        "limits": ", ".join(_limits(resolved)) or "none",
        "table_size": len(actions),
        "table": _listed(actions),
        "formula": formula(task),
        "reward": table(["term", "formula", "weight", "meaning of the weight"], reward(task)),
        "duration": f"{task.duration:g}",
        "steps": task.steps,
        "step": f"{task.step:g}",
        "on_collision": _COLLISION[task.on_collision],
        "lost": _lost(resolved),
        "boundary": _INSIDE if resolved.robot.kind == "curve" else _BOUNDARY[task.boundary],
        "feedback": _feedback(resolved),
        "results": _results(scenario, stored),
        "replay": replay,
    }
    return Template((_HERE / "scenario_page.md").read_text(encoding="utf-8")).substitute(fields)


def numbers(scenario: Scenario) -> list[tuple[str, str]]:
    """Return names and values of the main quantities, with units."""
    shape = scenario.curve
    curve = "a Fourier series" if shape.harmonics else f"Lissajous, a:b = {shape.a}:{shape.b}"
    bound = "the undisturbed formation detects every target by then"
    without = "no bound, r_s is below bound (8)"
    overlap = f"bound (8), at which discs of ring neighbours overlap, is {scenario.detection_radius:.3g} m"
    return [
        ("robots", f"{scenario.num_robots} {_robots(scenario)}, bodies of radius {scenario.robot.radius:g} m"),
        *([("top speed", f"{scenario.robot.top_speed:.3g} m/s")] if scenario.robot.kind == "car" else []),
        ("rectangle", f"{_sides(scenario)} m"),
        ("curve", curve),
        ("formation", f"omega = {scenario.formation.phase_rate:g} rad/s, p = {scenario.p}, alpha = {scenario.alpha}"),
        ("sensor", f"r_s = {scenario.sensing_radius:.3g} m; {overlap}"),
        ("T_max", f"{scenario.detection_time_bound:.3g} s: {bound if scenario.detection_time_is_bounded else without}"),
        ("targets", f"{scenario.targets.count:,} from the start, then {scenario.targets.arrival_rate:g} per second"),
        ("top speed of targets", f" {scenario.rogue_speed:g} m/s"),
        ("episode", f"{scenario.task.duration:g} s, {scenario.task.steps} steps of {scenario.task.step:g} s"),
    ]


def differing(scenario: Scenario) -> list[list[str]]:
    """Return field, value, default and meaning (with unit) of every field that differs from its default."""
    rows = []
    for part, kind in PARTS.items():
        values, words = getattr(scenario, part), meanings(kind)
        for field in dataclasses.fields(values):
            value = getattr(values, field.name)
            if value != field.default:
                rows.append([f"`{part}.{field.name}`", _short(value), _short(field.default), words[field.name]])
    return rows


def observation(scenario: Scenario) -> list[list[Any]]:
    """Return index, name, meaning (with unit) and range of every entry."""
    return [
        [k, f"`{name}`", meaning, f"[{low:g}, {high:g}]"]
        for k, (name, low, high, meaning) in enumerate(zip(*layout(scenario), strict=True))
    ]


def action(scenario: Scenario) -> list[list[Any]]:
    """Return index, name, meaning and range of every component."""
    model = scenario.model
    sent = (f"component {m} of the message to both ring neighbours" for m in range(scenario.messages.size))
    words = (*(model.meanings or model.actions), *sent)
    return [[k, name, what, "[-1, 1]"] for k, (name, what) in enumerate(zip(scenario.action_names, words, strict=True))]


def reward(task: Task) -> list[list[str]]:
    """Return name, formula, weight and meaning of each term."""
    words = meanings(Task)
    return [
        [f"`{term}`", f"`{formula}`", f"{getattr(task, f'reward_{term}'):g}", words[f"reward_{term}"]]
        for term, formula in FORMULAS.items()
    ]


def formula(task: Task) -> str:
    """Return the sum of the terms with non-zero weights, with numbers for weights and step."""
    used = {term: weight for term in FORMULAS if (weight := getattr(task, f"reward_{term}"))}
    terms = [
        FORMULAS[term].replace(f"reward_{term}", f"{weight:g}").replace("step", f"{task.step:g}")
        for term, weight in used.items()
    ]
    return " + ".join(terms).replace("+ -", "- ") or "0"


def _limits(scenario: Scenario) -> list[str]:
    robot, words = scenario.robot, " ".join(scenario.model.meanings)
    return [f"{name} = {getattr(robot, name):.4g} {unit}".strip() for name, unit in _LIMITS.items() if name in words]


def _feedback(scenario: Scenario) -> str:
    """Return what reacting to targets is worth in a scenario."""
    entry, value = measured().get(scenario.name), value_of_feedback(scenario)
    if entry is not None:
        interval = f"{entry['low']:.3g} to {entry['high']:.3g}"
        all_interval = f"{entry['sees_all_low']:.3g} to {entry['sees_all_high']:.3g}"
        return (
            f"The value of feedback is {value:.3g} ({interval}), with {entry['policy']}; a rule that sees all targets, "
            f"which is no bound, reaches {entry['sees_all']:.3g} ({all_interval}) (`python benchmarks/feedback.py`)."
        )
    if value is None:
        return "The value of feedback has not been measured."
    return (
        "The value of feedback is 1: targets appear independently of everything and leave when they are first "
        "observed, so no observation says where an undetected one is, and a patrol on a timetable is as good as any "
        "policy. The scenario compares guarantees, coordination and faults."
    )


def _lost(scenario: Scenario) -> str:
    gone = [f"robot {robot + 1} at {time:g} s" for robot, time in scenario.faults.removed]
    gone += [f"{scenario.faults.lost}, drawn at random"] if scenario.faults.lost else []
    return (
        f"\n* Robots that fail for good ({', '.join(gone)}) remain agents whose actions have no effect." if gone else ""
    )


def _results(scenario: Scenario, stored: dict[str, Any]) -> str:
    results = stored.get(f"results {scenario.name}")
    if results is None:
        return f"There are none yet: `python benchmarks/results.py --scenarios {scenario.name} --store` computes them."
    seeds = f"seeds 0 to {results['episodes'] - 1}" if results["episodes"] > 1 else "only seed 0"
    fields = {"seeds": seeds, "results": table(results["columns"], results["rows"])}
    return Template((_HERE / "scenario_results.md").read_text(encoding="utf-8")).substitute(fields)


def _sides(scenario: Scenario) -> str:
    curve = scenario.curve
    return " x ".join(f"{2 * side:g}" for side in (curve.half_width, curve.half_height, curve.half_depth) if side > 0)


def _robots(scenario: Scenario) -> str:
    return "points on the curve" if scenario.robot.kind == "curve" else f"{scenario.robot.kind}s"


def _short(value: Any) -> str:
    words = f"{value:.6g}" if isinstance(value, float) and math.isfinite(value) else str(value)
    return words if len(words) < 80 else f"{len(value)} rows, the first {value[0]}"


def _listed(rows: np.ndarray) -> str:
    """Return the rows of a table of actions, as the product of the values of each component where they are one."""
    choices = [sorted(set(column)) for column in rows.T.tolist()]
    if math.prod(map(len, choices)) != len(rows):
        return ", ".join("(" + ", ".join(f"{value:.3g}" for value in row) + ")" for row in rows.tolist())
    return " x ".join("{" + ", ".join(f"{value:g}" for value in values) + "}" for values in choices)
