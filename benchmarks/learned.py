"""`learned-watch` against the rules, in worlds that no training and no tuning opened: `python benchmarks/learned.py`.

    python benchmarks/learned.py --trainings runs/0 runs/1 runs/2 runs/3 runs/4 --store
    python benchmarks/learned.py --spaces --store

The first command adds the best policies of some trainings to the comparison on `watch`, and names the training whose
validation is best. The second one plays the scenarios of `watch-v1`, in its split `test` and its shifts, with the
included policy and its base.
"""

import itertools
import warnings
from pathlib import Path
from typing import Any

import figures
import numpy as np

import baselines
import lissajous_env
import training
from training.learned import checkpoint
from training.validation import limit_of, rank_of

SHIPPED, BASE, SCENARIO = "learned-watch", "greedy-cover", "watch"
RULES = (BASE, "a-cmommt", "follow", "lanes")
SEEDS = range(10_000, 10_256)
SPACE, SPLITS, SCENARIOS, EPISODES = "watch-v1", ("test", "larger", "longer", "faster"), 24, 8
"""Space, its splits, and the number of scenarios of each, with the worlds of each of these."""


def play(policy: Any, scenario: Any, seeds: range) -> np.ndarray:
    """Return the share of targets in sight, the collisions and the distance [m] of each world, (3, W)."""
    rows = lissajous_env.evaluate(policy, scenario, seeds)
    return np.array([[row[name] for name in ("observed_fraction", "collisions", "distance_mean")] for row in rows]).T


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
        of = draw.integers(0, trainings, trainings)[:, None], draw.integers(0, worlds, worlds)
        means.append(values[..., of[0], of[1]].mean(axis=(-2, -1)))
    return np.stack(means, axis=-1)


def on_watch(trainings: list[str]) -> figures.Table:
    """Return the table of `watch`: the included policy, the trainings and the rules."""
    played = {f"`{name}`": play(baselines.make(name, SCENARIO, len(SEEDS)), SCENARIO, SEEDS)[:, None]
              for name in (SHIPPED, *RULES)}  # fmt: skip
    if trainings:
        folders = [Path(folder) / checkpoint.BEST for folder in trainings]
        each = [play(training.load(folder, SCENARIO, len(SEEDS)), SCENARIO, SEEDS) for folder in folders]
        for folder, of in zip(trainings, each, strict=True):
            print(folder, of.mean(axis=1).round(4), gain(of[None, 0], played[f"`{BASE}`"][0, 0]), flush=True)
        played = {f"the best of each of {len(each)} trainings": np.stack(each, axis=1)} | played
    base = played[f"`{BASE}`"][0, 0]
    rows = [[name, interval(of[0], 3), gain(of[0], base), interval(of[1], 2), f"{of[2].mean():.0f}"]
            for name, of in played.items()]  # fmt: skip
    columns = ["policy", "targets in sight", f"over `{BASE}`", "collisions", "distance of a robot [m]"]
    return {"columns": columns, "rows": rows}


def on_spaces() -> figures.Table:
    """Return the table of the splits of `watch-v1`: the included policy and its base."""
    rows = []
    for split in SPLITS:
        scores = []
        for made in itertools.islice(lissajous_env.scenario_space(SPACE).scenarios(split), SCENARIOS):
            seeds = range(SEEDS[0], SEEDS[0] + EPISODES)
            scores.append([play(baselines.make(name, made, EPISODES), made, seeds) for name in (SHIPPED, BASE)])
        # Scenarios are drawn as trainings are above.
        ours, base = np.moveaxis(np.array(scores), (1, 2), (0, 1))
        seen = [f"{of[0].mean():.3f}" for of in (ours, base)]
        collided = [f"{of[1].mean():.2f}" for of in (ours, base)]
        rows.append([f"`{split}`", *seen, gain(ours[0], base[0]), *collided])
        print(*rows[-1], flush=True)
    columns = [f"`{SPACE}`", f"`{SHIPPED}`", f"`{BASE}`", "ratio", "collisions", f"of `{BASE}`"]
    return {"columns": columns, "rows": rows}


def preferred(trainings: list[str]) -> str:
    """Return the training whose validation is best, with its collisions in units of the limit of a training."""
    texts = {folder: checkpoint.read_text(Path(folder) / checkpoint.BEST)["training"] for folder in trainings}
    return max(trainings, key=lambda of: rank_of(texts[of]["best"], limit_of(None, texts[of]["rivals"])))


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--trainings", nargs="+", default=[], metavar="FOLDER", help="folders of trainings on watch")
    parser.add_argument("--spaces", action="store_true", help="play the splits of watch-v1 instead of watch")
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    if options.trainings:
        print(f"best validation: {preferred(options.trainings)}")
    if options.spaces:
        figures.publish("learned-spaces", "watch-v1", on_spaces(), options.store)
    else:
        figures.publish("learned", f"{len(SEEDS)} worlds of watch", on_watch(options.trainings), options.store)


if __name__ == "__main__":
    main()
