"""`lissajous train` with RLlib over a cluster; a killed training resumes from its last checkpoint."""

import logging
import time
from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from rich.console import Console

from baselines.benchmark import cluster
from lissajous_env.console.terminal import make_console
from lissajous_env.storage.folder import Folder
from training.events import open_rows
from training.learned import checkpoint
from training.learned.history import SCORES, History
from training.learned.network import Network
from training.rllib import ppo
from training.rllib import state as kept
from training.settings import TrainingSettings
from training.trainer import Trainer

_LEARNING = {"entropy": "entropy", "vf_explained_var": "explained_variance"}
"""RLlib's names of the diagnostics in a history."""


def train(settings: TrainingSettings, console: Console | None = None) -> History:
    """Train until the last step, from the last checkpoint if `settings.out` has one.

    `out` then contains the same files as with engine sb3. RLlib's own checkpoints, which are pickles, are neither
    written nor read.

    Raises:
        ValueError: settings are not supported by RLlib, the folder contains other results or is in use by another
            process, or weights are no longer finite.
        ConnectionError: there is no cluster at the address.
        KeyboardInterrupt: Ctrl-C; a checkpoint has been written.
    """
    cluster.check(settings.device, settings.address)
    console = console or make_console()
    if settings.algorithm != "ppo":
        raise ValueError(f"algorithm of engine ray must be ppo, got {settings.algorithm}")
    if settings.teacher not in (None, "none"):
        raise ValueError(f"teacher of engine ray must be none, because it does not imitate, got {settings.teacher}")
    if settings.critic == "world":
        raise ValueError("critic of engine ray must be robot, got world")
    if settings.chosen_noise_steps != 1:
        raise ValueError(f"noise_steps of engine ray must be 1, got {settings.noise_steps}")
    for name, value in {"critic_steps": 0, "short": 0.0, "averaging": 0.0}.items():
        if getattr(settings, name) != value:
            raise ValueError(f"{name} of engine ray must be {value}, got {getattr(settings, name)}")
    if settings.imitated is not None:
        console.print("engine ray does not imitate; --start can continue from a training that did")
    with checkpoint.hold(settings.out) as folder:
        return RllibTrainer(settings, console, folder).run()


class RllibTrainer(Trainer):
    """A training with RLlib."""

    def __init__(self, settings: TrainingSettings, console: Console, folder: Folder):
        super().__init__(settings, console, folder)
        if settings.threads:
            torch.set_num_threads(settings.threads)
        self._state: dict[str, np.ndarray] | None = None
        self._start: Network | None = None
        if (settings.out / checkpoint.FILE).exists():
            self._go_on()
        else:
            self._start = self._network_to_start_from()

    def run(self) -> History:
        """Train until the last step."""
        settings, history = self.settings, self.history
        if history.steps >= settings.steps:
            return super().run()
        logging.getLogger("ray.rllib").setLevel(logging.ERROR)
        with cluster.connected(settings.address) as ray:
            cores = int(ray.cluster_resources().get("CPU", 0))
            if settings.workers > cores:
                raise ValueError(f"workers must be at most the {cores} CPUs of the Ray cluster, got {settings.workers}")
            scenario = settings.make_cautious_scenario()
            self.algorithm = ppo.make_ppo(settings, scenario, self.card, self._start, history.updates)
            try:
                if self._state is not None:
                    with checkpoint.resuming(settings.out, self._text):
                        kept.load_ppo(self.algorithm, self._state, history.updates)
                return super().run()
            finally:
                self.algorithm.stop()

    def network(self) -> Network:
        """Copy the current policy."""
        try:
            return ppo.policy_of(self.algorithm, self.settings.activation)
        except ValueError as error:
            raise ValueError(f"learning_rate must be low enough that weights stay finite: {error}") from error

    def save(self) -> None:
        """Write a checkpoint; a training resumed from it plays other episodes than one that was not interrupted."""
        state = kept.save_ppo(self.algorithm)
        checkpoint.save(self.folder, self.network(), self.card, state=state, notes=self.history.notes)

    def _learn(self) -> None:
        history, robots = self.history, self.scenario.num_robots
        log = self.folder.make_folder("tensorboard")
        with open_rows(log, history.steps) as self._writer:
            self.display.begin("PPO")
            while history.steps < self.settings.steps:
                if self.due():
                    self.evaluate_and_save()
                self.stop_if_asked()
                began = time.monotonic()
                result = self.algorithm.train()
                history.seconds += time.monotonic() - began
                history.steps = kept.steps_sampled(self.algorithm) * robots
                history.updates = self.algorithm.iteration
                self.network()  # raises if the training has diverged
                self._show(result)
            self.evaluate_and_save()

    def log(self, values: Mapping[str, float | None]) -> None:
        """Write values to TensorBoard."""
        for name, value in values.items():
            if value is not None:
                self._writer.add_scalar(name, value, self.history.steps)
        self._writer.flush()

    def _show(self, result: dict[str, Any]) -> None:
        score = result.get("env_runners", {}).get("score", {})
        shown = {name: float(score[of.name]) for name, of in SCORES.items() if of.name in score}
        learned = result.get("learners", {}).get(ppo.MODULE, {})
        losses = {name: float(learned[name]) for name in ("policy_loss", "vf_loss", "entropy") if name in learned}
        for folder, values in {"rollout": shown, "train": losses}.items():
            self.log({f"{folder}/{name}": value for name, value in values.items()})
        self.history.learned({ours: learned[name] for name, ours in _LEARNING.items() if name in learned})
        self.display.update(shown)

    def _go_on(self) -> None:
        _, card, text = checkpoint.read(self.settings.out)
        self._check_same(card)
        self._state = checkpoint.read_state(self.settings.out, text)
        self._text = text
        self.keep(History.read(text))
