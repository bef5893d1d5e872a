"""Trainings of BenchMARL and Stable-Baselines3 on `watch`, one setting after another changed, by their CPU time."""

import statistics
import tempfile
import time
import warnings
from dataclasses import dataclass, replace

from figures import Table

from speeds import Options, Part

SCENARIO, ROBOTS = "watch", 5


@dataclass(frozen=True)
class Case:
    """A training; a team step is one step of all robots of a world."""

    worlds: int
    """Worlds that are stepped together."""
    steps: int
    """Steps of each world in an iteration."""
    epochs: int
    """Passes over the data of an iteration."""
    minibatch: int
    """Team steps of a minibatch."""
    layers: tuple[int, ...] = (256, 256)
    """Sizes of the layers of actor and critic."""


DEFAULTS = Case(10, 600, 45, 400)
FEWER = replace(DEFAULTS, epochs=4)
WIDE = Case(256, 24, 4, 768)
SMALL = replace(WIDE, layers=(64, 64))
CASES = {
    "MAPPO with BenchMARL's defaults": DEFAULTS,
    "4 epochs": FEWER,
    "256 worlds, 8 minibatches": WIDE,
    "layers of 64": SMALL,
}


def benchmarl(case: Case, folder: str) -> tuple[float, float]:
    """Return the CPU time of an iteration of MAPPO after the first one, and that of collecting its data [s]."""
    from benchmarl.algorithms import MappoConfig
    from benchmarl.experiment import Callback, Experiment, ExperimentConfig
    from benchmarl.models import MlpConfig

    from training.torchrl.benchmarl import LissajousTaskClass

    config, model = ExperimentConfig.get_from_yaml(), MlpConfig.get_from_yaml()
    config.max_n_frames, config.max_n_iters, config.save_folder = None, 2, folder
    config.evaluation, config.render, config.create_json, config.loggers = False, False, False, []
    config.on_policy_n_envs_per_worker = case.worlds
    config.on_policy_collected_frames_per_batch = case.worlds * case.steps
    config.on_policy_n_minibatch_iters, config.on_policy_minibatch_size = case.epochs, case.minibatch
    model.num_cells = case.layers
    collected, trained = [], []

    class Clock(Callback):
        """Notes the CPU time of the process at the ends of the two halves of an iteration."""

        def on_batch_collected(self, batch) -> None:
            collected.append(time.process_time())

        def on_train_end(self, training_td, group) -> None:
            trained.append(time.process_time())

    training = Experiment(
        task=LissajousTaskClass(SCENARIO, {"threads": 1}),
        algorithm_config=MappoConfig.get_from_yaml(),
        model_config=model,
        seed=0,
        config=config,
    )
    training.callbacks = [Clock()]  # not an argument, which would be pickled
    training.run()
    return trained[1] - trained[0], collected[1] - trained[0]


def stable_baselines(case: Case) -> tuple[float, float]:
    """Return the same of an iteration of PPO of Stable-Baselines3, with as many robot steps in a minibatch."""
    from stable_baselines3 import PPO

    from training.sb3 import RobotVecEnv

    worlds = RobotVecEnv(SCENARIO, case.worlds, seed=0, threads=1)
    model = PPO("MlpPolicy", worlds, n_steps=case.steps, batch_size=ROBOTS * case.minibatch, n_epochs=case.epochs,
                policy_kwargs={"net_arch": list(case.layers)}, device="cpu")  # fmt: skip
    _, callback = model._setup_learn(2 * ROBOTS * case.worlds * case.steps)
    for _ in range(2):
        begin = time.process_time()
        model.collect_rollouts(model.env, callback, model.rollout_buffer, case.steps)
        collected = time.process_time()
        model.train()
    return time.process_time() - begin, collected - begin


def stepped(case: Case, folder: str) -> tuple[float, float]:
    """Return the time of the environment alone, TorchRL's with random actions, for the data of an iteration [s]."""
    from training.torchrl import LissajousTorchEnv

    env = LissajousTorchEnv(SCENARIO, case.worlds, seed=0, threads=1)
    env.rollout(2)
    begin = time.process_time()
    env.rollout(case.steps, break_when_any_done=False)
    return (time.process_time() - begin,) * 2


def tables(options: Options) -> dict[str, Table]:
    """Measure, and return the table `marl`."""
    import torch

    warnings.filterwarnings("ignore", category=DeprecationWarning)
    torch.set_num_threads(1)
    cases = {name: replace(case, steps=2, epochs=1, minibatch=case.worlds) if options.quick else case
             for name, case in CASES.items()}  # fmt: skip
    last = list(cases.values())[-1]
    times: dict[str, list[tuple[float, float]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(1 if options.quick else options.rounds):
            for name, case in cases.items():
                times.setdefault(name, []).append(benchmarl(case, folder))
            times.setdefault("PPO of Stable-Baselines3", []).append(stable_baselines(last))
            times.setdefault("`LissajousTorchEnv`, random actions", []).append(stepped(last, folder))
    rows = []
    for name, measured in times.items():
        case = cases.get(name, last)
        total, collecting = (statistics.median(column) for column in zip(*measured, strict=True))
        settings = [case.epochs, case.worlds * case.steps // case.minibatch, " x ".join(map(str, case.layers))]
        speed = f"{ROBOTS * case.worlds * case.steps / total:,.0f}"
        blank = [""] * len(settings) if collecting == total else [str(value) for value in settings]
        rows.append([name, str(case.worlds), *blank, speed, f"{100 * collecting / total:.0f}"])
    columns = ["", "worlds", "epochs", "minibatches", "layers", "robot steps per CPU second", "collecting [%]"]
    return {"marl": {"columns": columns, "rows": rows}}


PART = Part(
    "marl",
    "trainings of BenchMARL and Stable-Baselines3 on `watch`, and how their settings change the CPU time",
    tables,
    rounds=3,
    needs={"benchmarl": "marl", "stable_baselines3": "train"},
)
