"""`lissajous train --side rogues`: imitation of a rogue with foresight, against robots that do not learn.

A rogue that starts in the wrong place is detected at once whatever it does, and the detection of one that hides well is
beyond the horizon of a discounted return. So rogues imitate one that knows the robots' future, in the states that the
learner itself reaches (`lissajous_env.episodes.missed.foresight`). All rogues share one network.
"""

import time
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from rich.console import Console
from torch import Tensor, nn

from baselines.policies.registry import as_factory
from lissajous_env import Scenario, Simulation
from lissajous_env.console.terminal import make_console, print_line
from lissajous_env.episodes.evaluation import EpisodeRunner, evaluate
from lissajous_env.episodes.missed.foresight import Foresight, Labels, Moment
from lissajous_env.storage.folder import Folder
from lissajous_env.wording import require
from lissajous_env.world.columns import DETECTION_TIME
from training.learned import checkpoint
from training.learned.networks import RogueNetwork
from training.learned.rogue import rogue_card
from training.settings import RogueTraining
from training.trainer import FIRST_SEED, load_state, save_state
from training.validation import VALIDATION_SEED

_SCRIPTS = "follow-gap", "flee"
"""Scripts that move the rogues in the first rounds; in later rounds, the last checkpoint moves them."""
_RIVALS = "wander", "flee", "follow-gap"
"""Scripts with which the evaluation is compared."""
_LAYERS = 64, 64
"""Sizes of the hidden layers."""
_BATCH, _BATCHES, _LAST_BATCHES = 2048, 150, 900
"""Rows per minibatch; minibatches per round, and in the last round."""
_RATE, _GRADIENT = 1e-3, 0.5
"""Learning rate, and the norm to which gradients are clipped."""
_MOST_GAIN, _LEAST_WEIGHT = 2.0, 0.02
"""Gain of an action above which the weight of its label is constant [s], and weight of a label without gain."""
_LABELLED = "imitation.rows", "imitation.actions", "imitation.weights"
"""Names of the arrays of labels in a checkpoint."""


def train_rogues(settings: RogueTraining, console: Console | None = None) -> dict[str, Any]:
    """Train rogues until the last round, from the last checkpoint if `settings.out` has one; return the history.

    Raises:
        ValueError: the folder contains other files or results of other settings, or is in use by another process.
    """
    with checkpoint.locked(settings.out) as folder:
        return RogueTrainer(settings, console or make_console(), folder).run()


class RogueTrainer:
    """A training of rogues in a locked folder."""

    def __init__(self, settings: RogueTraining, console: Console, folder: Folder):
        self.settings, self.folder, self.say = settings, folder, partial(print_line, console)
        torch.set_num_threads(1)
        torch.manual_seed(settings.seed)
        self.scenario = settings.make_scenario()
        self.card = rogue_card(self.scenario, settings.to_dict())
        self.code = checkpoint.code_of([self.scenario], [settings.against])
        sizes = [len(self.card.inputs), *_LAYERS]
        hidden = [part for pair in pairwise(sizes) for part in (nn.Linear(*pair), nn.ReLU())]
        self.actor = nn.Sequential(*hidden, nn.Linear(sizes[-1], self.card.action_size)).to(settings.device)
        self.optimizer = torch.optim.Adam(self.actor.parameters(), lr=_RATE, eps=1e-5)
        self.normalization = np.zeros(sizes[0], np.float32), np.ones(sizes[0], np.float32)
        """Mean and standard deviation (D,) of the entries of a row in the first round."""
        self.history: dict[str, Any] = {"rounds": 0, "seconds": 0.0, "scores": None, "rivals": {}}
        self._labelled: list[Tensor] = []
        """Rows, actions and weights of all rounds."""
        if (settings.out / checkpoint.FILE).exists():
            with checkpoint.resuming(settings, self.card, self.code) as (description, arrays):
                self.history |= description["rogues"]
                self.normalization = arrays["normal.mean"], arrays["normal.spread"]
                if self.history["scores"] is None:
                    self._labelled = [torch.from_numpy(arrays[name]).to(settings.device) for name in _LABELLED]
                load_state(self.actor, self.optimizer, arrays)

    def run(self) -> dict[str, Any]:
        """Train until the last round."""
        settings, history = self.settings, self.history
        if history["scores"] is not None:
            self.say(f"{settings.out} is finished: {history['rounds']:,} rounds")
            return history
        self.say(f"rogues on {settings.scenario} against {settings.against}, to {settings.out}")
        for name in _RIVALS:
            if name not in history["rivals"]:
                history["rivals"][name] = self._evaluated(name)
                self.say(f"{name}: {_words(history['rivals'][name])}")
        self._imitate()
        history["scores"] = self._evaluated(str(settings.out))
        self._save()
        self.say(f"after {history['seconds']:.0f} s: {_words(history['scores'])}")
        return history

    def _imitate(self) -> None:
        """In each round, label the states that the rogues reach by foresight, and fit the network to all labels."""
        settings, foresight, history = self.settings, Foresight(self.scenario), self.history
        for k in range(history["rounds"], settings.rounds):
            began, is_last = time.monotonic(), k == settings.rounds - 1
            labels = foresight.label(self._visit(k))
            rule = "must be large enough that a rogue is undetected for a step"
            require(len(labels.rows) > 0, "starts", rule, settings.starts)
            if k == 0:
                spread = np.maximum(labels.rows.std(axis=0), 1e-3)
                self.normalization = labels.rows.mean(axis=0), spread.astype(np.float32)
            before, new = self._labelled, self._tensors(labels)
            self._labelled = [torch.cat(parts) for parts in zip(before, new, strict=True)] if before else new
            error = self._fit(is_last)
            history["seconds"] += time.monotonic() - began
            history["rounds"] += 1
            self._save()
            if k < 2 or k % 4 == 3 or is_last:
                self.say(f"round {k + 1} of {settings.rounds}: {len(self._labelled[0]):,} rows, error {error:.3f}")

    def _visit(self, k: int) -> list[Moment]:
        """Play an episode in each world in round k, and record the rogues."""
        settings, moments = self.settings, []
        scenario = settings.make_scenario(_SCRIPTS[k] if k < len(_SCRIPTS) else str(settings.out))
        simulation = Simulation(scenario, settings.worlds, device=settings.device, threads=settings.threads)
        runner = EpisodeRunner(as_factory(settings.against)(scenario, settings.worlds, settings.device), simulation)
        seed = FIRST_SEED * (1 + settings.seed) + k * settings.worlds
        runner.play(range(seed, seed + settings.worlds), lambda taken: moments.append(Moment.of(simulation)))
        return moments

    def _tensors(self, labels: Labels) -> list[Tensor]:
        """Return rows that are normalized, actions and weights of labels."""
        mean, spread = self.normalization
        arrays = (labels.rows - mean) / spread, labels.actions, np.clip(labels.gains, 0.0, _MOST_GAIN) + _LEAST_WEIGHT
        return [torch.from_numpy(array.astype(np.float32)).to(self.settings.device) for array in arrays]

    def _fit(self, is_last: bool) -> float:
        """Fit the network to the labels of all rounds by weighted least squares; return the mean error."""
        rows, actions, weights = self._labelled
        weights, batches, errors = weights / weights.mean(), _LAST_BATCHES if is_last else _BATCHES, []
        for k, chosen in zip(range(batches), _minibatches(len(rows)), strict=False):
            self.optimizer.param_groups[0]["lr"] = _RATE * (1 - k / batches if is_last else 1.0)
            error = (self.actor(rows[chosen]) - actions[chosen]).square().mean(1)
            loss = (weights[chosen] * error).mean()
            self.optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(self.actor.parameters(), _GRADIENT)
            self.optimizer.step()
            errors.append(loss.item())
        return float(np.mean(errors))

    def network(self) -> RogueNetwork:
        """Copy the policy into a network for rows that are not normalized."""
        mean, spread = self.normalization
        arrays = {}
        for name, tensor in self.actor.state_dict().items():
            k, kind = name.split(".")
            arrays[f"{int(k) // 2}.{kind}"] = tensor.cpu().numpy()  # every other layer of the actor is a ReLU
        arrays["0.weight"] = arrays["0.weight"] / spread
        arrays["0.bias"] = arrays["0.bias"] - arrays["0.weight"] @ mean
        return RogueNetwork(arrays)

    def _save(self) -> None:
        """Write a checkpoint with the state of the training, with its labels unless it is finished."""
        mean, spread = self.normalization
        state = save_state(self.actor, self.optimizer) | {"normal.mean": mean, "normal.spread": spread}
        if self.history["scores"] is None:
            state |= {name: part.cpu().numpy() for name, part in zip(_LABELLED, self._labelled, strict=True)}
        notes = {"rogues": self.history | {"seconds": round(self.history["seconds"], 1)}, "code": self.code}
        checkpoint.save(self.folder, self.network(), self.card, state=state, notes=notes)

    def _evaluated(self, rogues: str) -> dict[str, float]:
        settings, scenario = self.settings, self.settings.make_scenario(rogues)
        seeds = range(VALIDATION_SEED, VALIDATION_SEED + settings.episodes)
        return undetected_times(settings.against, scenario, seeds, settings.device)


def undetected_times(policy: str, scenario: Scenario, seeds: Sequence[int], device: Any = "cpu") -> dict[str, float]:
    """Play an episode for each seed and return means over episodes of the undetected times of its rogues [s].

    These are the mean, the 95 % quantile and the longest time of an episode, that of the best start.

    Args:
        policy: Name of the policy of the robots, or its folder.
        scenario: The scenario, with the rogues.
        seeds: Seed of each episode.
        device: Warp device.
    """
    rows = evaluate(as_factory(policy)(scenario, min(16, len(seeds)), device), scenario, seeds, device)
    columns = {"mean": DETECTION_TIME.name, "quantile": "detection_time_p95", "longest": "detection_time_max"}
    return {name: float(np.nanmean([row[column] for row in rows])) for name, column in columns.items()}


def _minibatches(count: int) -> Iterator[Tensor]:
    """Yield the indices of shuffled minibatches without end."""
    while True:
        yield from torch.randperm(count).split(_BATCH)


def _words(scores: Mapping[str, float]) -> str:
    mean, quantile, longest = (scores[name] for name in ("mean", "quantile", "longest"))
    return f"undetected for {mean:.2f} s on average, 95 % at most {quantile:.2f} s, best start {longest:.1f} s"
