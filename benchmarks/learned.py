"""Learned policies against the rules, in worlds that no training and no tuning opened: `python benchmarks/learned.py`.

    python benchmarks/learned.py --trainings runs/0 runs/1 runs/2 runs/3 runs/4 --store
    python benchmarks/learned.py --scenario intercept --trainings runs/5 runs/6 runs/7 --store
    python benchmarks/learned.py --space watch-v1 --trainings runs/0 runs/1 runs/2 runs/3 runs/4 --store
    python benchmarks/learned.py --ablations runs/* --store
    python benchmarks/learned.py --curves runs/* --store
    python benchmarks/learned.py --herding greedy-herd greedy-cover runs/5 runs/6 --store

The first two commands add the best policies of some trainings to the comparison on a scenario, and name the training
whose validation is best. The third one plays the scenarios of a space, in its split `test` and its shifts, with the
best policy, its rival and some trainings. The fourth one compares complete trainings by the options in which they
differ from the defaults, by their policies after the last step, with the rule on the same scenario. The fifth one has
their validations, and those of earlier trainings, which `benchmarks/curves.jsonl` contains. Rows of these two tables
replace stored ones with the same options; the others remain. The last one tells how policies keep targets that flee in
sight on `watch`: a row for each of them, in the order of the command.
"""

import itertools
import json
import warnings
from collections import defaultdict
from pathlib import Path
from typing import Any

import figures
import numpy as np

import baselines
import lissajous_env
import training
from lissajous_env.world.columns import task_score
from lissajous_env.world.targets.motion import FLEEING
from training.learned import checkpoint
from training.learned.networks import TeamNetwork
from training.learned.policy import LearnedTeam, find
from training.settings import TrainingSettings
from training.validation import limit_of, rating_of

POLICIES = {
    "watch": ("learned-watch", "greedy-herd", "greedy-cover", "a-cmommt", "follow", "lanes"),
    "intercept": ("learned-intercept", "divided-pursuit", "voronoi-pursuit", "lead-pursuit", "pure-pursuit", "lanes"),
}
"""Policies of each scenario: the learned one, the best rule, and other rules."""
TITLES = {"observed_fraction": "targets in sight", "detection_rate": "detections [1/min]"}
SEEDS = range(10_000, 11_024)
FEWER_SEEDS = SEEDS[:256]
"""Seeds of the comparison of many trainings by their options."""
HERDING_SEEDS = range(40_000, 40_128)
CORNER = 2.0
"""Distance from both walls below which a target is in a corner [m]."""
SPACES = {
    "watch-v1": ("learned-watch", "greedy-herd"),
    "intercept-v1": ("learned-intercept", "divided-pursuit"),
    "hotspots-v1": ("index-learned", "lanes"),
}
"""Policies that are compared on each space: the best one and its rival."""
CURVES = Path(__file__).with_name("curves.jsonl")
"""Validations of the trainings that were stored, a line each."""
VALIDATED = "steps", "worth", "collisions", "seconds"
"""Numbers of a point of a curve."""
SHARES = 0.125, 0.25, 0.5, 0.75, 1.0
"""Shares of the steps of a training at which its validations are shown."""
SCENARIOS, EPISODES = 24, 8
"""Number of scenarios of each split of a space, and of the worlds of each of these."""


def play(policy: Any, scenario: Any, seeds: range) -> np.ndarray:
    """Return the score, the collisions and the distance [m] of each world, (3, W)."""
    rows = lissajous_env.evaluate(policy, scenario, seeds)
    columns = task_score(lissajous_env.scenario(scenario)).name, "collisions", "distance_mean"
    return np.array([[row[name] for name in columns] for row in rows]).T


def interval(values: np.ndarray, digits: int) -> str:
    """Return the mean of values (T, W) of T trainings in W worlds, with its 95 % interval over both."""
    return _words(values.mean(), _drawn(values), digits)


def gain(values: np.ndarray, base: np.ndarray) -> str:
    """Return the ratio of the means of values (T, W) and of a base, (T, W) or (W,), with its interval over both."""
    drawn = _drawn(np.stack([values, np.broadcast_to(base, values.shape)]))
    return _words(values.mean() / base.mean(), drawn[0] / drawn[1], 3)


def _words(value: float, drawn: np.ndarray, digits: int) -> str:
    low, high = np.percentile(drawn, [2.5, 97.5])
    return f"{value:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def _drawn(values: np.ndarray, count: int = 4000) -> np.ndarray:
    """Return means over drawn trainings and drawn worlds (..., count) of values (..., T, W)."""
    draw = np.random.default_rng(0)
    trainings, worlds = values.shape[-2:]
    means = []
    for _ in range(count):
        indices = draw.integers(0, trainings, trainings)[:, None], draw.integers(0, worlds, worlds)
        means.append(values[..., indices[0], indices[1]].mean(axis=(-2, -1)))
    return np.stack(means, axis=-1)


def on_scenario(scenario: str, trainings: list[str]) -> figures.Table:
    """Return the table of a scenario: the trainings, the included policy, also without its training, and the rules."""
    names, count = POLICIES[scenario], len(SEEDS)
    played = {f"`{name}`": play(baselines.make(name, scenario, count), scenario, SEEDS)[:, None] for name in names}
    base = played[f"`{names[1]}`"][0, 0]
    network, card, _ = checkpoint.read(find(names[0]))
    zeros = TeamNetwork({name: 0 * array for name, array in network.arrays.items()})
    begun = play(LearnedTeam(zeros, card, scenario, count), scenario, SEEDS)[:, None]
    played = {f"`{names[0]}`": played.pop(f"`{names[0]}`"), "the same before its training": begun} | played
    if trainings:
        folders = [Path(folder) / checkpoint.BEST for folder in trainings]
        scores = [play(training.load(folder, scenario, count), scenario, SEEDS) for folder in folders]
        for folder, score in zip(trainings, scores, strict=True):
            print(folder, score.mean(axis=1).round(4), gain(score[None, 0], base), flush=True)
        played = {f"the best of each of {len(scores)} trainings": np.stack(scores, axis=1)} | played
    rows = [[name, interval(score[0], 3), gain(score[0], base), interval(score[1], 2), f"{score[2].mean():.0f}"]
            for name, score in played.items()]  # fmt: skip
    title = TITLES[task_score(lissajous_env.scenario(scenario)).name]
    columns = ["policy", title, f"over `{names[1]}`", "collisions", "distance of a robot [m]"]
    return {"columns": columns, "rows": rows}


def on_space(name: str, trainings: list[str]) -> figures.Table:
    """Return the table of the split `test` and the shifts of a space: its best policy, the rival, and the trainings."""
    rows, (best, rival), space = [], SPACES[name], lissajous_env.scenario_space(name)
    better = task_score(space.base).better
    for split in ("test", *space.shifts):
        scores, learned = [], []
        for scenario in itertools.islice(space.scenarios(split), SCENARIOS):
            seeds = range(SEEDS[0], SEEDS[0] + EPISODES)
            scores.append([play(baselines.make(name, scenario, EPISODES), scenario, seeds) for name in (best, rival)])
            loaded = (training.load(Path(folder) / checkpoint.BEST, scenario, EPISODES) for folder in trainings)
            learned.append([play(policy, scenario, seeds).mean(axis=1) for policy in loaded])
        # Scenarios are drawn as trainings are above.
        both = np.moveaxis(np.array(scores), (1, 2), (0, 1))
        first, second = both[:, 0] if better > 0 else both[::-1, 0]
        seen, collided = ([f"{values[k].mean():.{3 - k}f}" for values in both] for k in (0, 1))
        rows.append([f"`{split}`", *seen, gain(first, second), *collided])
        if trainings:
            means = np.moveaxis(np.array(learned), (1, 2), (1, 0))
            rows[-1] += [gain(means[0], both[1, 0].mean(axis=1)), f"{means[1].mean():.2f}"]
        print(*rows[-1], flush=True)
    columns = [f"`{name}`", f"`{best}`", f"`{rival}`", "ratio", "collisions", f"of `{rival}`"]
    more = [f"ratio of {len(trainings)} trainings", "their collisions"] if trainings else []
    return {"columns": columns + more, "rows": rows}


def on_ablations(trainings: list[str]) -> figures.Table:
    """Return the table of the policies after the last step, one row for trainings that differ only in their seeds.

    They are compared with the rule with which the validations of the first training were compared.
    """
    rules, rows, groups = {}, [], grouped(trainings)
    rule = next(iter(groups.values()))[0][1]["training"]["rival"]
    for (_, options, steps), members in groups.items():
        settings = members[0][1]["card"].settings
        scenario = lissajous_env.scenario(settings["scenario"], **settings["overrides"])
        if scenario not in rules:
            rules[scenario] = play(baselines.make(rule, scenario, len(FEWER_SEEDS)), scenario, FEWER_SEEDS)
        loaded = (training.load(folder, scenario, len(FEWER_SEEDS)) for folder, _ in members)
        scores, base = np.stack([play(policy, scenario, FEWER_SEEDS) for policy in loaded], axis=1), rules[scenario]
        print(options, (scores[0].mean(axis=1) / base[0].mean()).round(3), scores[1].mean(axis=1).round(2), flush=True)
        numbers = interval(scores[0], 3), gain(scores[0], base[0]), f"{scores[1].mean():.2f}", f"{base[1].mean():.2f}"
        rows.append([f"`{options}`" if options else "defaults", f"{steps / 1e6:g}", str(len(members)), *numbers])
    columns = ["options", "million steps", "trainings", "targets in sight", f"over `{rule}`", "collisions"]
    return {"columns": [*columns, f"of `{rule}`"], "rows": rows}


def on_curves(trainings: list[str], stores: bool) -> figures.Table:
    """Return the table of the validations of trainings, relative to a rule, one row for those of several seeds.

    They are those of `CURVES` and those in the folders of complete trainings, which are added to it if `stores`.
    """
    entries = [json.loads(line) for line in CURVES.read_text(encoding="utf-8").splitlines()] if CURVES.exists() else []
    for (scenario, options, steps), members in grouped(trainings).items():
        for _, described in members:
            history, seed = described["training"], described["card"].settings["seed"]
            entry = {"scenario": scenario, "options": options, "steps": steps, "seed": seed}
            entry |= {"version": described["versions"]["lissajous-env"], "rival": history["rival"]}
            curve = [[point[name] for name in VALIDATED] for point in history["curve"]]
            entries.append(entry | {"curve": curve})
    rows = defaultdict(dict)
    for entry in entries:  # a training that was repeated replaces the earlier one
        rows[entry["scenario"], entry["options"], entry["rival"], entry["steps"]][entry["seed"]] = entry
    if stores:
        lines = (json.dumps(entry) for members in rows.values() for _, entry in sorted(members.items()))
        CURVES.write_text("\n".join(lines) + "\n", encoding="utf-8")
    cells = [_curve_row(*key, [entry["curve"] for entry in members.values()]) for key, members in rows.items()]
    at = [f"at {share:.1%}".replace(".0%", "%").replace("%", " %") for share in SHARES]
    columns = ["trainings on", "relative to", "million steps", "seeds", *at, "minutes each"]
    return {"columns": columns, "rows": cells}


def _curve_row(scenario: str, options: str, rival: str, steps: int, curves: list[list[list[float]]]) -> list[str]:
    """Return the row of some trainings from their curves, lists of points with the numbers `VALIDATED`."""
    shares, worth, minutes = [], VALIDATED.index("worth"), VALIDATED.index("seconds")
    for share in SHARES:
        worths = [min(curve, key=lambda point: abs(point[0] - share * steps))[worth] for curve in curves]
        shares.append(f"{np.mean(worths):.3f} ({min(worths):.3f} to {max(worths):.3f})")
    name = f"`{scenario}`" + (f", `{options}`" if options else "")
    spent = np.mean([curve[-1][minutes] for curve in curves]) / 60
    return [name, f"`{rival}`", f"{steps / 1e6:g}", str(len(curves)), *shares, f"{spent:.0f}"]


def herding(policies: list[str]) -> figures.Table:
    """Return shares of the fleeing targets of `watch` for each policy, means over the steps of the episodes."""
    rows = []
    for policy in policies:
        scenario = lissajous_env.scenario("watch")
        simulation = lissajous_env.Simulation(scenario, len(HERDING_SEEDS), seed=HERDING_SEEDS[0])
        acting = baselines.make(policy, scenario, num_worlds=len(HERDING_SEEDS))
        half = np.array([scenario.curve.half_width, scenario.curve.half_height])
        shares = []
        while not simulation.over.all():
            simulation.step(acting.act(simulation.observation))
            flees = simulation.targets.motion.numpy() == int(FLEEING)
            is_in_corner = (half - np.abs(simulation.targets.position.numpy()) < CORNER).all(axis=-1)
            in_sight = simulation.targets.in_sight.numpy() == 1
            shares.append([mask[flees].mean() for mask in (is_in_corner, in_sight, is_in_corner & in_sight)])
        name = f"`{policy}`" if not Path(policy).is_dir() else named_training(policy)
        rows.append([name, *(f"{share:.3f}" for share in np.mean(shares, axis=0))])
    columns = ["policy", "fleeing targets in corners", "in sight", "in sight in corners"]
    return {"columns": columns, "rows": rows}


def named_training(folder: str) -> str:
    """Return the options of a training with its seed, in words."""
    settings = checkpoint.read_description(folder)["card"].settings
    words, steps = options_of(settings)
    return f"`{words}`, {steps / 1e6:g} million steps, seed {settings['seed']}"


def grouped(trainings: list[str]) -> dict[tuple[str, str, int], list[tuple[str, dict[str, Any]]]]:
    """Return the complete trainings, each with its description, by their scenario, options and steps."""
    groups = defaultdict(list)
    for folder in trainings:
        description = checkpoint.read_description(folder)
        settings = description["card"].settings
        if description["training"]["curve"][-1]["steps"] >= settings["steps"]:
            groups[(settings["scenario"], *options_of(settings))].append((folder, description))
    return groups


def options_of(settings: dict[str, Any]) -> tuple[str, int]:
    """Return the options of `lissajous train` in which settings differ from the defaults, and the steps."""
    usual = TrainingSettings(scenario=settings["scenario"]).to_dict()
    words = [f"--{name.replace('_', '-')} {value}" for name, value in settings.items()
             if name not in (*TrainingSettings.may_change, "seed", "overrides") and value != usual[name]]  # fmt: skip
    changed = [f"{name}={value}" for name, value in settings["overrides"].items()]
    return " ".join(words + (["--set", *changed] if changed else [])), settings["steps"]


def preferred(trainings: list[str]) -> str:
    """Return the training whose validation is best, with its collisions in units of the limit of a training."""

    def rating(folder: str) -> float:
        history = checkpoint.read_description(Path(folder) / checkpoint.BEST)["training"]
        return rating_of(history["best"], limit_of(None, history["rivals"]))

    return max(trainings, key=rating)


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--trainings", nargs="+", default=[], metavar="FOLDER", help="folders of trainings")
    parser.add_argument("--scenario", default="watch", choices=list(POLICIES), help="scenario of the comparison")
    parser.add_argument("--space", choices=list(SPACES), help="play the splits of a space instead of a scenario")
    parser.add_argument("--ablations", nargs="+", metavar="FOLDER", help="folders of trainings to compare by settings")
    parser.add_argument("--curves", nargs="+", metavar="FOLDER", help="folders of trainings whose validations to show")
    parser.add_argument("--herding", nargs="+", metavar="POLICY", help="policies whose targets that flee to describe")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    if options.trainings:
        print(f"best validation: {preferred(options.trainings)}")
    if options.ablations:
        table = figures.merged("ablations", on_ablations(options.ablations))
        figures.publish("ablations", f"{len(FEWER_SEEDS)} worlds", table, options.store)
    elif options.curves:
        table = figures.merged("curves", on_curves(options.curves, options.store))
        figures.publish("curves", "validations", table, options.store)
    elif options.herding:
        figures.publish("herding", f"{len(HERDING_SEEDS)} worlds", herding(options.herding), options.store)
    elif options.space:
        figures.publish(options.space, "test and shifts", on_space(options.space, options.trainings), options.store)
    else:
        table = on_scenario(options.scenario, options.trainings)
        figures.publish(POLICIES[options.scenario][0], f"{len(SEEDS)} worlds", table, options.store)


if __name__ == "__main__":
    main()
