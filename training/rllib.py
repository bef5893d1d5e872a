"""`lissajous train --engine ray`: RLlib's PPO over a cluster; a kill costs what was learned since the last checkpoint.

`LissajousMultiAgentEnv` is the environment, for trainings of one's own.
"""

import logging
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import torch
from ray.rllib.algorithms.algorithm import Algorithm
from rich.console import Console
from torch.utils.tensorboard.writer import SummaryWriter

from baselines import cluster
from lissajous_env.folder import Folder
from training import checkpoint, rllib_checkpoint, rllib_ppo
from training.course import Course
from training.network import Network
from training.rllib_env import LissajousMultiAgentEnv
from training.settings import Train
from training.trainer import Trainer

__all__ = ["LissajousMultiAgentEnv", "train"]


def train(settings: Train, console: Console | None = None) -> Course:
    """Train to the end, from the last good checkpoint where `settings.out` has one.

    `out` then holds the policy, as every training writes it, the best one under `best`, RLlib's own state under `rllib`
    and what TensorBoard shows under `tensorboard`.

    Raises:
        ValueError: settings that RLlib cannot train with, a folder that holds the results of others or is in use by
            another process, or weights that are no longer finite.
        ConnectionError: nothing answers at the address.
        KeyboardInterrupt: Ctrl-C; everything up to then is in the checkpoint.
    """
    cluster.check(settings.device)
    console = console or Console()
    if settings.algorithm != "ppo":
        raise ValueError(f"algorithm of engine ray must be ppo, got {settings.algorithm}")
    if settings.teacher not in (None, "none"):
        raise ValueError(f"teacher of engine ray must be none, for it does not imitate, got {settings.teacher}")
    for name, value in {"critic": "robot", "critic_steps": 0, "noise_steps": 1, "short": 0.0, "averaging": 0.0}.items():
        if getattr(settings, name) != value:
            raise ValueError(f"{name} of engine ray must be {value}, got {getattr(settings, name)}")
    if settings.imitated is not None:
        console.print("engine ray does not imitate first; --start takes the network of a training that did")
    with checkpoint.hold(settings.out, "rllib/") as folder:
        return ClusterTrainer(settings, console, folder).run()


class ClusterTrainer(Trainer):
    """One training in its folder; RLlib's algorithm takes the place of model and worlds."""

    def __init__(self, settings: Train, console: Console, folder: Folder):
        super().__init__(settings, console, folder)
        if settings.threads:
            torch.set_num_threads(settings.threads)
        self._states = folder.make_folder("rllib")
        self._restored = self._find_state()
        self._start = self._network_to_start_from() if self._restored is None else None

    def run(self) -> Course:
        """Train to the end."""
        settings, course = self.settings, self.course
        if course.steps >= settings.steps:
            return super().run()
        logging.getLogger("ray.rllib").setLevel(logging.ERROR)
        with cluster.connected(settings.address) as ray:
            cores = int(ray.cluster_resources().get("CPU", 0))
            if settings.workers > cores:
                raise ValueError(f"workers must be at most the {cores} CPUs of the Ray cluster, got {settings.workers}")
            self.algorithm = rllib_ppo.make_ppo(settings, self.scenario, self.card, self._start, course.updates)
            try:
                if self._restored is not None:
                    self.algorithm.restore_from_path(self._restored.resolve())
                    # Killed between the state and the policy, the policy is the one of the checkpoint before.
                    self._export(self.network())
                return super().run()
            finally:
                self.algorithm.stop()

    def network(self) -> Network:
        """Copy the policy that has been learned so far."""
        try:
            return rllib_ppo.policy_of(self.algorithm, self.settings.activation)
        except ValueError as error:
            raise ValueError(f"learning_rate must be low enough that weights stay finite: {error}") from error

    def save(self) -> None:
        """Write a checkpoint: RLlib's state, from which the training goes on, then the policy."""
        notes = {"settings": self.settings.to_dict(), "course": vars(self.course)}
        rllib_checkpoint.save(self._states, lambda path: _save(self.algorithm, path), notes)
        self._export(self.network())

    def _learn(self) -> None:
        course, robots = self.course, self.scenario.num_robots
        # What an earlier process logged after its last checkpoint is taken back.
        log = str(self.folder.make_folder("tensorboard"))
        with SummaryWriter(log, purge_step=course.steps + 1) as self._writer:
            while course.steps < self.settings.steps:
                began = time.monotonic()
                result = self.algorithm.train()
                course.seconds += time.monotonic() - began
                course.steps = rllib_ppo.steps_sampled(self.algorithm) * robots
                course.updates = self.algorithm.iteration
                self.network()  # raises where the training has diverged
                self._show(result)
                if self.due() and course.steps < self.settings.steps:
                    self.evaluate_and_save()
                self.stop_if_asked()
            self.evaluate_and_save()

    def log(self, values: Mapping[str, float | None]) -> None:
        """Write values to TensorBoard."""
        for name, value in values.items():
            if value is not None:
                self._writer.add_scalar(name, value, self.course.steps)
        self._writer.flush()

    def _show(self, result: dict[str, Any]) -> None:
        score = result.get("env_runners", {}).get("score", {})
        recent = {"detection_time": "detection_time_mean", "return": "return_mean"}
        recent |= {name: name for name in ("collisions", "detected_fraction")}
        shown = {name: float(score[column]) for name, column in recent.items() if column in score}
        learned = result.get("learners", {}).get(rllib_ppo.MODULE, {})
        losses = {name: float(learned[name]) for name in ("policy_loss", "vf_loss", "entropy") if name in learned}
        for folder, values in {"rollout": shown, "train": losses}.items():
            self.log({f"{folder}/{name}": value for name, value in values.items()})
        self.display.update(shown)

    def _export(self, network: Network) -> None:
        checkpoint.save(self.folder, network, self.card, notes=self.course.notes)

    def _find_state(self) -> Path | None:
        """Take up the course of the newest good checkpoint, and return the folder of its state."""
        found = rllib_checkpoint.newest(self._states, lambda text: self.console.print(text, markup=False))
        if found is None:
            if (self.settings.out / checkpoint.FILE).exists():
                raise ValueError(
                    f"out must be a folder that holds no training of another engine, got {self.settings.out}"
                )
            return None
        path, notes = found
        self._check_same(notes["settings"])
        self.course = Course(**notes["course"])
        return path


def _save(algorithm: Algorithm, path: Path) -> None:
    algorithm.save_to_path(path.resolve())
