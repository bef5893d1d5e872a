"""Algorithms of BenchMARL on a task with feedback: `python benchmarks/algorithms.py --store`.

Each algorithm trains on `watch` for a million decisions of robots, with 64 worlds and layers of 64, in five trainings
of seeds 0 to 4; all other settings are BenchMARL's defaults. Afterwards each policy plays the episodes of the test
seeds, with its most likely actions. A score is 0 for the best patrol, `lanes`, and 1 for the best tuned rule,
`greedy-cover`, on the same seeds; the interval is from 2,000 bootstrap resamples of trainings and episodes. A curve is
the same score after each quarter of the training.

The folder `--out` keeps each training: the same command goes on after an interruption. It requires
`pip install ".[train,marl]"`.
"""

import json
import sys
import tempfile
import time
import warnings
from pathlib import Path

import figures
import numpy as np

import baselines
import lissajous_env
from lissajous_env.storage.files import write_atomically
from lissajous_env.world.columns import task_score

SCENARIO, PATROL, RULE = "watch", "lanes", "greedy-cover"
ALGORITHMS = {"MAPPO": "MappoConfig", "IPPO": "IppoConfig", "MASAC": "MasacConfig", "VDN": "VdnConfig"}
WORLDS, STEPS, LAYERS = 64, 96, (64, 64)
SHARES = 0.25, 0.5, 0.75, 1.0
"""Shares of the training after which the policy is played."""
FIRST_SEED = 40_000
"""Seed of the first test episode; no training and no tuning uses these."""


def train(algorithm: str, seed: int, decisions: int, episodes: int) -> dict[str, list]:
    """Train once; return the scores and collisions of the test episodes, the curve and the time."""
    import benchmarl.algorithms
    import torch
    from benchmarl.experiment import Callback, Experiment, ExperimentConfig
    from benchmarl.models import MlpConfig

    from training.torchrl import ModulePolicy
    from training.torchrl.benchmarl import LissajousTaskClass

    torch.set_num_threads(1)
    scenario = lissajous_env.scenario(SCENARIO)
    frames = WORLDS * STEPS
    iterations = max(decisions // (frames * scenario.num_robots), 1)
    config, model = ExperimentConfig.get_from_yaml(), MlpConfig.get_from_yaml()
    config.max_n_frames, config.max_n_iters, config.evaluation, config.render = None, iterations, False, False
    config.create_json, config.loggers, model.num_cells = False, [], LAYERS
    config.on_policy_n_envs_per_worker = config.off_policy_n_envs_per_worker = WORLDS
    config.on_policy_collected_frames_per_batch = config.off_policy_collected_frames_per_batch = frames
    config.on_policy_n_minibatch_iters, config.on_policy_minibatch_size = 4, frames // 8
    config.off_policy_n_optimizer_steps, config.off_policy_train_batch_size = 64, 512
    config.off_policy_memory_size = 40 * frames
    curve: list[float] = []
    marks = [round(share * iterations) for share in SHARES]

    class Curve(Callback):
        """Plays the policy at the marks."""

        def on_train_end(self, training_td, group) -> None:
            if training.n_iters_performed + 1 in marks:
                curve.append(float(np.mean(played(policy_of(training), episodes)["score"])))

    def policy_of(training: Experiment) -> ModulePolicy:
        policy = ModulePolicy(training.policy, scenario, episodes)
        policy.kind = "velocity"
        return policy

    began = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        config.save_folder = folder
        training = Experiment(
            task=LissajousTaskClass(SCENARIO, {"threads": 1}),
            algorithm_config=getattr(benchmarl.algorithms, ALGORITHMS[algorithm]).get_from_yaml(),
            model_config=model,
            seed=seed,
            config=config,
        )
        training.callbacks = [Curve()]  # not an argument, which would be pickled
        training.run()
    seconds = time.process_time() - began
    return {**played(policy_of(training), episodes), "curve": curve, "seconds": [seconds]}


def played(policy: baselines.Policy, episodes: int) -> dict[str, list]:
    """Return the score and the collisions of each test episode of a policy."""
    scenario = lissajous_env.scenario(SCENARIO)
    rows = lissajous_env.evaluate(policy, scenario, range(FIRST_SEED, FIRST_SEED + episodes))
    return {name: [row[column] for row in rows]
            for name, column in (("score", task_score(scenario).name), ("collisions", "collisions"))}  # fmt: skip


def row_of(algorithm: str, trainings: list[dict[str, list]], patrol: np.ndarray, rule: np.ndarray) -> list[str]:
    """Return the row of an algorithm, from its trainings and the scores (E,) of patrol and rule."""
    scores = np.array([training["score"] for training in trainings])
    draw = np.random.default_rng(0)
    runs, seeds = draw.integers(0, len(scores), (2001, len(scores))), draw.integers(0, len(rule), (2001, len(rule)))
    runs[0], seeds[0] = np.arange(len(scores)), np.arange(len(rule))
    zero, one = patrol[seeds].mean(axis=1), rule[seeds].mean(axis=1)
    mean = np.array([scores[np.ix_(i, j)].mean() for i, j in zip(runs, seeds, strict=True)])
    first, *resampled = (mean - zero) / (one - zero)
    low, high = np.percentile(resampled, [2.5, 97.5])
    curves = np.array([training["curve"] for training in trainings])
    shown = (curves.mean(axis=0) - zero[0]) / (one[0] - zero[0])
    collisions = np.mean([training["collisions"] for training in trainings])
    seconds = np.mean([training["seconds"] for training in trainings])
    return [algorithm, f"{first:.2f} ({low:.2f} to {high:.2f})", f"{collisions:.1f}",
            *(f"{value:.2f}" for value in shown), f"{seconds / 60:.1f}"]  # fmt: skip


def main() -> None:
    parser = figures.parser(__doc__)
    parser.add_argument("--algorithms", nargs="+", choices=ALGORITHMS, default=list(ALGORITHMS))
    parser.add_argument("--decisions", type=int, default=1_000_000)
    parser.add_argument("--trainings", type=int, default=5)
    parser.add_argument("--episodes", type=int, default=64)
    parser.add_argument("--out", type=Path, default=Path("build/algorithms"))
    options = parser.parse_args()
    warnings.filterwarnings("ignore", category=DeprecationWarning)
    options.out.mkdir(parents=True, exist_ok=True)
    scenario, rows = lissajous_env.scenario(SCENARIO), []
    zero, one = (played(baselines.make(name, scenario, options.episodes), options.episodes) for name in (PATROL, RULE))
    for algorithm in options.algorithms:
        trainings = []
        for seed in range(options.trainings):
            file = options.out / f"{algorithm}-{options.decisions}-{options.episodes}-{seed}.json"
            if not file.exists():
                print(f"{algorithm}, seed {seed}", file=sys.stderr, flush=True)
                write_atomically(file, json.dumps(train(algorithm, seed, options.decisions, options.episodes)))
            trainings.append(json.loads(file.read_text()))
        rows.append(row_of(algorithm, trainings, np.array(zero["score"]), np.array(one["score"])))
    columns = ["algorithm", "score (95 % interval)", "collisions", *(f"at {share:.0%}" for share in SHARES)]
    rows += [[f"`{name}`", value, f"{np.mean(scores['collisions']):.1f}", *[""] * (len(SHARES) + 1)]
             for name, value, scores in ((RULE, "1", one), (PATROL, "0", zero))]  # fmt: skip
    table = {"columns": [*columns, "CPU minutes"], "rows": rows}
    figures.publish("algorithms", "algorithms of BenchMARL on watch", table, options.store)


if __name__ == "__main__":
    main()
