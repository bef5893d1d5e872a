"""Train a team with BenchMARL: MAPPO, or another of its algorithms, on any scenario.

    python examples/benchmarl_mappo.py --iterations 50 --scenario intruders --out runs/mappo
    python examples/benchmarl_mappo.py --algorithm qmix --set task.duration=20 state=True

Rewards and scores of the episodes are written as CSV files into a folder in `--out`.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import tyro
from benchmarl.algorithms import IppoConfig, MappoConfig, QmixConfig
from benchmarl.experiment import Experiment, ExperimentConfig
from benchmarl.models import MlpConfig

from lissajous_env.console.terminal import Overrides, parse_overrides
from training.torchrl.benchmarl import LissajousTaskClass

ALGORITHMS = {"mappo": MappoConfig, "ippo": IppoConfig, "qmix": QmixConfig}


@dataclass(frozen=True)
class Settings:
    """Settings of the example."""

    scenario: str = "intruders"
    """Name of the scenario."""
    algorithm: Literal["mappo", "ippo", "qmix"] = "mappo"
    """mappo or ippo, with continuous actions, or qmix, with discrete ones."""
    iterations: int = 50
    """Iterations, in each of which every world plays one episode."""
    worlds: int = 32
    """Environments that are stepped together."""
    out: Path = Path("runs")
    """Folder for the results; each run creates its own folder in it."""
    seed: int = 0
    """Seed of the worlds and of the learner."""
    device: str = "cpu"
    """Device of the worlds and of the learner: `cpu` or `cuda`."""


def experiment(settings: Settings, **overrides: Any) -> Experiment:
    """Return the experiment, whose `run()` trains; the overrides are of scenario fields, and `state`.

    Raises:
        ValueError: the scenario or an override is invalid.
    """
    task = LissajousTaskClass(settings.scenario, overrides)
    frames = settings.worlds * task.scenario.task.steps
    config = ExperimentConfig.get_from_yaml()
    config.sampling_device = config.train_device = config.buffer_device = settings.device
    config.max_n_frames, config.max_n_iters = None, settings.iterations
    config.gamma, config.lr = 0.99, 3e-4
    config.on_policy_n_envs_per_worker = config.off_policy_n_envs_per_worker = settings.worlds
    config.on_policy_collected_frames_per_batch = config.off_policy_collected_frames_per_batch = frames
    config.on_policy_n_minibatch_iters, config.on_policy_minibatch_size = 4, -(-frames // 8)
    config.off_policy_n_optimizer_steps, config.off_policy_memory_size = 64, 20 * frames
    config.evaluation_interval, config.evaluation_episodes = 10 * frames, settings.worlds
    # The CSV logger would write uncompressed videos of hundreds of MB.
    config.render, config.loggers = False, ["csv"]
    settings.out.mkdir(parents=True, exist_ok=True)
    config.save_folder = str(settings.out)
    return Experiment(
        task=task,
        algorithm_config=ALGORITHMS[settings.algorithm].get_from_yaml(),
        model_config=MlpConfig.get_from_yaml(),
        seed=settings.seed,
        config=config,
    )


def main(settings: tyro.conf.OmitArgPrefixes[Settings], overrides: Overrides = ()) -> None:
    """Train a team with BenchMARL.

    Args:
        settings: settings of the example.
        overrides: scenario fields to change, such as --set task.duration=20 targets.count=5
    """
    experiment(settings, **parse_overrides(overrides)).run()


if __name__ == "__main__":
    tyro.cli(main)
