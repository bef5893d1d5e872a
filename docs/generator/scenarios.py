"""The pages of the scenarios: all that the code says of one, with what the policies score on it."""

import dataclasses
import math
from pathlib import Path
from typing import Any

import lissajous_env
from benchmarks import figures
from docs.generator import replays
from docs.generator.files import table, write_changed
from docs.generator.pictures import picture_of
from lissajous_env.envs.actions import action_table
from lissajous_env.parameters.checks import meanings
from lissajous_env.parameters.scenario import PARTS, Scenario, Task
from lissajous_env.world.observation import layout
from lissajous_env.world.reward import FORMULAS
from lissajous_env.world.robots.table import model_of
from lissajous_env.world.score import MEANINGS

_BOUNDARY = {
    "open": "Nothing: a car may leave the rectangle, where it senses and is scored as inside; `outside_time` counts how "
    "long whole bodies were outside.",
    "wall": "A wall stops a car's centre, and takes the part of its velocity that goes into the wall.",
    "remove": "A car whose whole body is outside is removed: its agent is terminated.",
}
_COLLISION = {
    "count": "Collisions are counted and rewarded, and end nothing.",
    "stop": "Two robots that collide stay where they are for good; the episode goes on.",
    "remove": "Two robots that collide are removed: their agents are terminated.",
}


def make(folder: Path) -> None:
    """Write the page and the picture of each scenario, and the page that lists them."""
    made = [lissajous_env.scenario(name) for name in lissajous_env.scenarios()]
    stored = figures.load()
    for given in made:
        write_changed(folder / f"{given.name}.png", picture_of(given))
        write_changed(folder / f"{given.name}.md", page(given, stored, replays.made(given, folder)))
    write_changed(folder / "index.md", listing(made))


def listing(made: list[Scenario]) -> str:
    """Return the page that lists the scenarios."""
    rows = []
    for given in made:
        size = " x ".join(f"{2 * side:g}" for side in _sides(given))
        robots = f"{given.num_robots} {_plural(given)}"
        rows.append(
            [f"[`{given.name}`]({given.name}.md)", robots, size, f"{given.sensing_radius:.3g}", given.description]
        )
    names = "\n".join(given.name for given in made)
    return (
        "# Scenarios\n\nEach has a page of its own: numbers, observation, action, reward, what ends an episode, score, and "
        "what every policy scores on it. All pages are made from the code when the documentation is built.\n"
        + table(["scenario", "robots", "rectangle [m]", "sensor r_s [m]", "what"], rows)
        + "Any field can be changed when a scenario is made, and [a scenario of your own](../extending.md#a-scenario) is a "
        "short file.\n\n```{toctree}\n:hidden:\n\n" + names + "\n```\n"
    )


def page(given: Scenario, stored: dict[str, Any], replay: str) -> str:
    """Return the page of a scenario.

    Args:
        given: The scenario, unresolved.
        stored: Tables of docs/figures.json.
        replay: What shows a replay on the page; empty for none.
    """
    made = given.resolve()
    parts = [
        f"# {given.name}\n\n{given.description}\n\n![A moment of {given.name}]({given.name}.png)\n\n",
        f"{_caption(given)}\n\n```python\nimport lissajous_env\n\n",
        f'env = lissajous_env.parallel_env("{given.name}")\n```\n\n',
        _numbers(given, made),
        _observation(made),
        _action(made),
        _reward(made),
        _ends(made),
        _results(given, stored),
        replay,
        "## The score\n\nOne row for an episode; the columns are the same in every scenario, and a time that never came is "
        "empty.\n" + table(["column", "what"], [[f"`{name}`", what] for name, what in MEANINGS.items()]),
    ]
    return "".join(parts)


def _caption(given: Scenario) -> str:
    policy = replays.policy_for(given)
    return (
        f"Seed 1, driven by `{policy}`. Red are rogues, sand is what was not sensed for long, discs are sensors. "
        f"`lissajous run {given.name} {policy} --seed 1 --out {given.name}.gif` makes the film."
    )


def _numbers(given: Scenario, made: Scenario) -> str:
    sides = " x ".join(f"{2 * side:g}" for side in _sides(made))
    rows: list[tuple[str, str]] = [
        ("robots", f"{made.num_robots} {_plural(made)}, bodies of radius {made.robot.radius:g} m"),
        ("rectangle", f"{sides} m"),
        ("curve", "a Fourier series" if made.curve.harmonics else f"Lissajous, a:b = {made.curve.a}:{made.curve.b}"),
        ("formation", f"omega = {made.formation.phase_rate:g} rad/s, p = {made.p}, alpha = {made.alpha}"),
        ("sensor", f"r_s = {made.sensing_radius:.3g} m; (8) asks for {made.detection_radius:.3g} m"),
        (
            "T_max",
            f"{made.detection_time_bound:.3g} s: in formation, with the sensor of (8), every target is found by then",
        ),
        ("targets", f"{made.targets.count:,} from the start, then {made.targets.arrival_rate:g} a second"),
        ("rogues", f"no faster than {made.rogue_speed:g} m/s"),
        ("episode", f"{made.task.duration:g} s, {made.task.steps} steps of {made.task.step:g} s"),
    ]
    if made.robot.kind == "car":
        rows.insert(5, ("top speed", f"{made.robot.speed_max:.3g} m/s"))
    return (
        "## Numbers\n"
        + table(["what", "here"], rows)
        + "What differs from the defaults; `help(lissajous_env.Task)` and the "
        "other parts list every field, and [the API](../api/scenario.md) too.\n"
        + table(["field", "here", "default", "what it is"], differing(given))
    )


def differing(given: Scenario) -> list[list[str]]:
    """Field, value, default and meaning, with its unit, of every field that differs from its default."""
    rows = []
    for part, of in PARTS.items():
        values, words = getattr(given, part), meanings(of)
        for field in dataclasses.fields(values):
            value = getattr(values, field.name)
            if value != field.default:
                about = words[field.name].replace("\n\n", " ").replace("\n", " ")
                rows.append([f"`{part}.{field.name}`", _short(value), _short(field.default), about])
    return rows


def _observation(made: Scenario) -> str:
    entries = layout(made)
    rows = [
        [k, f"`{name}`", meaning, f"[{low:g}, {high:g}]"]
        for k, (name, low, high, meaning) in enumerate(zip(*entries, strict=True))
    ]
    return (
        f"## Observation\n\nA row of {entries.size} numbers (float32) for each robot, "
        f"`Box(low, high, ({entries.size},))`. Lengths and speeds are in the units in brackets. Directions are those of the "
        "rectangle, not of the robot. `print(env.simulation.layout)` shows the same table.\n"
        + table(["index", "name", "what [unit]", "range"], [[r[0], r[1], r[2], r[3]] for r in rows])
        + "A robot that a fault stopped senses nothing, but hears. A list that is not full ends in zeros. `env.state()` is the truth, "
        "which no policy sees.\n\n"
    )


def _action(made: Scenario) -> str:
    model = model_of(made.robot.kind)
    names = model.meanings or model.actions
    limits = {"steering_max": "rad", "throttle_min": "", "throttle_max": "", "phase_rate_max": "rad/s"}
    here = [
        f"{name} = {getattr(made.robot, name):.4g} {unit}".strip()
        for name, unit in limits.items()
        if any(name in each for each in names)
    ]
    rows = [[k, name, what, "[-1, 1]"] for k, (name, what) in enumerate(zip(model.actions, names, strict=True))]
    return (
        f"## Action\n\n`Box(-1, 1, ({model.action_size},))` for each robot; numbers outside are clipped.\n"
        + table(["index", "name", "what, at -1 and 1", "range"], rows)
        + f"Here {', '.join(here)}. With `discrete_actions=True` it is `Discrete({len(action_table(made))})`, a row of "
        f"{_listed(action_table(made))}.\n\n"
    )


def _reward(made: Scenario) -> str:
    words, task = meanings(Task), made.task
    rows, used = [], []
    for term, formula in FORMULAS.items():
        weight = getattr(task, f"reward_{term}")
        rows.append([f"`{term}`", f"`{formula}`", f"{weight:g}", words[f"reward_{term}"].replace("\n", " ")])
        if weight:
            used.append(formula.replace(f"reward_{term}", f"{weight:g}").replace("step", f"{task.step:g}"))
    formula = " + ".join(used).replace("+ -", "- ")
    return (
        "## Reward\n\nA robot's reward of a step is the sum of eight terms, each with its weight:\n\n"
        f"```text\nreward = {formula}\n```\n\nWeights that are 0 are left out there; `task.reward_TERM` sets them, and `infos` "
        "hold the terms under `reward_terms`, in this order.\n"
        + table(["term", "formula", "weight here", "what the weight is"], rows)
        + "A term [of your own](../extending.md#a-reward-a-score-column-an-observation) is a function.\n\n"
    )


def _ends(made: Scenario) -> str:
    removed = [f"robot {robot + 1} at {time:g} s" for robot, time in made.faults.removed]
    words = [
        f"An episode is **truncated** after {made.task.duration:g} s, {made.task.steps} steps; nothing else ends it.",
        _COLLISION[made.task.on_collision] + " (`task.on_collision`)",
        "A robot that a fault stops stays, observes and is truncated with the others; its actions have no effect.",
    ]
    if removed or made.faults.lost:
        who = ", ".join(removed) or f"{made.faults.lost}, drawn at random"
        words.append(f"Robots that are lost for good ({who}) stay as agents that act without effect.")
    boundary = _BOUNDARY[made.task.boundary] if made.robot.kind != "curve" else "Points stay on the curve, inside."
    return (
        "## What ends an episode\n\n"
        + "\n".join(f"* {each}" for each in words)
        + f"\n\n## At the boundary\n\n{boundary} (`task.boundary`) Targets stay inside.\n\n"
    )


def _results(given: Scenario, stored: dict[str, Any]) -> str:
    kept = stored.get(f"results {given.name}")
    if kept is None:
        words = f"None are kept yet: `python benchmarks/results.py --scenarios {given.name} --store` plays them.\n\n"
        return "## What the policies score\n\n" + words
    episodes = kept["episodes"]
    seeds = f"seeds 0 to {episodes - 1}" if episodes > 1 else "seed 0 alone"
    return (
        f"## What the policies score\n\n`python benchmarks/results.py --store` on {seeds}: interquartile mean and 95 % interval; "
        "of collisions the mean. Few seeds: where intervals overlap, play more, on the same seeds for all, as "
        "[the comparison](../comparison.md) does.\n" + table(kept["columns"], kept["rows"])
    )


def _sides(given: Scenario) -> list[float]:
    curve = given.curve
    return [side for side in (curve.half_width, curve.half_height, curve.half_depth) if side > 0]


def _plural(given: Scenario) -> str:
    return "points on the curve" if given.robot.kind == "curve" else f"{given.robot.kind}s"


def _short(value: Any) -> str:
    words = f"{value:.6g}" if isinstance(value, float) and math.isfinite(value) else str(value)
    return words if len(words) < 80 else f"{len(value)} rows, the first {value[0]}"


def _listed(rows: Any) -> str:
    if rows.shape[1] == 1:
        return ", ".join(f"{row[0]:g}" for row in rows)
    each = [sorted(set(column)) for column in rows.T.tolist()]
    return " x ".join("{" + ", ".join(f"{value:g}" for value in values) + "}" for values in each)
