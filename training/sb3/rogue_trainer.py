"""`lissajous train --side rogues`: imitation of a rogue with foresight, against robots that do not learn; then PPO.

A rogue that starts in the wrong place is detected at once whatever it does, and one that hides well is detected much
later than a discounted return reaches. So imitation comes first (`lissajous_env.episodes.missed.foresight`), in the
states that the learner itself reaches, and PPO can follow, which in the time of more rounds of imitation gains less
than these. All rogues share one network.
"""

import math
import tempfile
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import torch
from rich.console import Console
from stable_baselines3.common.policies import ActorCriticPolicy
from torch import Tensor

from baselines.benchmark.progress import in_words
from baselines.exploitability.survival import survive
from baselines.policies.factories import named
from lissajous_env import Simulation
from lissajous_env.console.terminal import make_console
from lissajous_env.episodes.evaluation import EpisodeRunner
from lissajous_env.episodes.missed.foresight import Foresight, Labels, Visits
from lissajous_env.storage.folder import Folder
from training.learned import checkpoint
from training.learned.network import Network
from training.learned.rogue import rogue_card
from training.rogue_settings import RogueTraining
from training.sb3.ppo import RobotPPO
from training.sb3.rogue_env import RogueVecEnv

FIRST_EVALUATION_SEED = 20_000
_FIRST_SEED = 1_000_000
_SCRIPTS = "follow-gap", "flee"
"""Scripts that move the rogues in the first rounds, until the learner moves them."""
_RIVALS = "wander", "flee", "follow-gap"
"""Scripts to compare the evaluations with."""
_BATCH, _BATCHES, _LAST_BATCHES = 2048, 150, 900
"""Rows per minibatch of imitation, minibatches per round, and in the last one."""
_RATE = 1e-3
"""Learning rate of imitation."""
_MOST_GAIN, _LEAST_WEIGHT = 2.0, 0.02
"""Gain of an action above which the weight of a label is constant [s], and weight of one without a gain."""
_LABELLED = "imitation.rows", "imitation.actions", "imitation.weights"
"""Names of the arrays of imitation in a checkpoint."""
_CRITIC_STEPS = 100_000
"""Rogue steps of PPO in which only the critic learns."""


def train_rogues(settings: RogueTraining, console: Console | None = None) -> dict[str, Any]:
    """Train rogues until the last step, from the last checkpoint if `settings.out` has one; return the history.

    An interrupted imitation resumes after its last round; PPO resumes from its last evaluation, in new episodes.

    Raises:
        ValueError: the folder contains other files or results of other settings, or is in use by another process.
    """
    with checkpoint.hold(settings.out) as folder:
        return RogueTrainer(settings, console or make_console(), folder).run()


class RogueTrainer:
    """A training of rogues in a locked folder."""

    def __init__(self, settings: RogueTraining, console: Console, folder: Folder):
        self.settings, self.console, self.folder = settings, console, folder
        torch.set_num_threads(1)
        self.scenario = settings.make_scenario()
        self.card = rogue_card(self.scenario, settings.to_dict())
        robots = named(settings.against)(self.scenario, settings.worlds, settings.device)
        self.env = RogueVecEnv(self.scenario, settings.worlds, robots, settings.device, threads=settings.threads)
        self.model = RobotPPO(settings.learner(), self.env, self.card)  # type: ignore[arg-type]
        self.history: dict[str, Any] = {"steps": 0, "updates": 0, "seconds": 0.0, "curve": [], "rivals": {}}
        self.best: Network | None = None
        self._labelled: list[Tensor] = []
        """Rows, actions and weights of all rounds of imitation."""
        if (settings.out / checkpoint.FILE).exists():
            self._resume()

    def run(self) -> dict[str, Any]:
        """Train until the last step."""
        settings, history = self.settings, self.history
        if history["curve"] and history["steps"] >= settings.steps:
            self._say(f"{settings.out} is finished: {history['steps']:,} of {settings.steps:,} steps")
            return history
        self._say(f"rogues on {settings.scenario} against {settings.against}, to {settings.out}")
        for name in _RIVALS:
            if name not in history["rivals"]:
                history["rivals"][name] = self._evaluated(name)
                self._say(f"{name}: {_words(history['rivals'][name])}")
        if not history["curve"]:
            self._imitate()
            self.evaluate_and_save()
        self._reinforce()
        best = max(history["curve"], key=lambda point: point["mean"])
        self._say(f"best rogue, after {best['steps']:,} steps of PPO: {_words(best)}")
        return history

    def network(self) -> Network:
        """Copy the policy as a network that reads rows which are not normalized."""
        learned = self.model.network()
        if self.env.normal is None:
            return learned
        mean, spread = self.env.normal
        weight = learned.weights[0] / spread
        weights = (weight.astype(np.float32), *learned.weights[1:])
        biases = ((learned.biases[0] - weight @ mean).astype(np.float32), *learned.biases[1:])
        return Network(weights, biases, learned.activation)

    def evaluate_and_save(self) -> None:
        """Evaluate the current rogue and write a checkpoint, whose weights are those of the best one so far."""
        history, network = self.history, self.network()
        with tempfile.TemporaryDirectory() as folder:
            checkpoint.save(folder, network, self.card)
            scores = self._evaluated(folder)
        best = max((point["mean"] for point in history["curve"]), default=-math.inf)
        if self.best is None or scores["mean"] > best:
            self.best = network
        history["curve"].append({"steps": history["steps"], "seconds": round(history["seconds"], 1), **scores})
        self._save(self.best, {})
        self._say(f"{history['steps']:>10,} steps of PPO, {in_words(history['seconds'])}: {_words(scores)}")

    def _save(self, network: Network, arrays: Mapping[str, np.ndarray]) -> None:
        """Write a checkpoint with the weights of a network, the state of the training and more arrays."""
        history = self.history
        counters = {name: history[name] for name in ("steps", "updates")} | {"seconds": round(history["seconds"], 1)}
        notes = {"counters": counters, "rogues": {name: history[name] for name in ("curve", "rivals")}}
        state = self.model.save_state() | dict(arrays)
        del state["rows"]  # episodes begin anew
        if self.env.normal is not None:
            state |= {"normal.mean": self.env.normal[0], "normal.spread": self.env.normal[1]}
        checkpoint.save(self.folder, network, self.card, state=state, notes=notes)

    def _imitate(self) -> None:
        """Fit the policy to the actions with foresight, in the states that it reaches."""
        settings, foresight = self.settings, Foresight(self.scenario)
        for k in range(self.history["updates"], settings.rounds):
            began = time.monotonic()
            labels = foresight.label(self._visit(k))
            if not len(labels.rows):
                raise ValueError(
                    f"starts must be large enough that a rogue is undetected for a step, got {settings.starts}"
                )
            if self.env.normal is None:
                spread = np.maximum(labels.rows.std(axis=0), 1e-3)
                self.env.normal = labels.rows.mean(axis=0), spread.astype(np.float32)
            known, new = self._labelled, self._tensors(labels)
            self._labelled = [torch.cat(parts) for parts in zip(known, new, strict=True)] if known else list(new)
            error = self._fit(self._labelled, last=k == settings.rounds - 1)
            self.history["seconds"] += time.monotonic() - began
            self.history["updates"] += 1
            rows = {name: part.cpu().numpy() for name, part in zip(_LABELLED, self._labelled, strict=True)}
            self._save(self.network(), rows)
            if k < 2 or k % 4 == 3 or k == settings.rounds - 1:
                self._say(
                    f"imitation, round {k + 1} of {settings.rounds}: {len(self._labelled[0]):,} rows, error {error:.3f}"
                )

    def _visit(self, k: int) -> Visits:
        """Play an episode in each world, by a script at first, then by the learner, and record the rogues' states."""
        settings, visits = self.settings, Visits()
        scenario = settings.make_scenario(_SCRIPTS[k]) if k < len(_SCRIPTS) else self.scenario
        simulation = Simulation(scenario, settings.worlds, device=settings.device, threads=settings.threads)
        first = k * settings.worlds  # number of the first episode
        driver: Any = named(settings.against)(scenario, settings.worlds, settings.device)
        if k >= len(_SCRIPTS):
            driver = _WithRogues(driver, simulation, self._act)
        seed = _FIRST_SEED * (1 + settings.seed) + first
        runner = EpisodeRunner(driver, simulation)
        runner.play(range(seed, seed + settings.worlds), lambda taken: visits.look(simulation))
        return visits

    def _act(self, rows: np.ndarray) -> np.ndarray:
        """Return the learner's actions (V, 2) for rows (V, D)."""
        assert self.env.normal is not None
        mean, spread = self.env.normal
        actions, _ = self.model.policy.predict((rows - mean) / spread, deterministic=True)
        return actions

    def _tensors(self, labels: Labels) -> tuple[Tensor, ...]:
        assert self.env.normal is not None
        mean, spread = self.env.normal
        weights = np.clip(labels.gains, 0.0, _MOST_GAIN) + _LEAST_WEIGHT
        arrays = (labels.rows - mean) / spread, labels.actions, weights
        return tuple(torch.from_numpy(each.astype(np.float32)).to(self.model.policy.device) for each in arrays)

    def _fit(self, data: list[Tensor], last: bool) -> float:
        """Take steps of the optimizer on minibatches of the labels of all rounds; return the mean error."""
        model, batches = self.model, _LAST_BATCHES if last else _BATCHES
        model.policy.set_training_mode(True)
        data = [*data[:2], data[2] / data[2].mean()]
        errors = []
        while len(errors) < batches:
            for batch in model.minibatches(data, _BATCH):
                for group in model.policy.optimizer.param_groups:
                    group["lr"] = _RATE * (1 - len(errors) / batches if last else 1.0)
                errors.append(model.minimize(_weighted_error, batch))
                if len(errors) == batches:
                    break
        return torch.stack(errors).mean().item()

    def _reinforce(self) -> None:
        """Update the rogue by PPO until the last step."""
        settings, history, model = self.settings, self.history, self.model
        env, due = self.env, settings.evaluate_every
        model.reset()
        while history["steps"] < settings.steps:
            began, before = time.monotonic(), history["steps"]
            done = before / settings.steps
            model.set_noise(done)
            model.learn(1 - done, critic_only=before < _CRITIC_STEPS)
            model.require_finite(before)
            history["steps"] += max(model.rows_learned, 1)
            history["updates"] += 1
            history["seconds"] += time.monotonic() - began
            if history["steps"] // due > before // due or history["steps"] >= settings.steps:
                self.evaluate_and_save()
        env.close()

    def _evaluated(self, rogues: str) -> dict[str, float]:
        settings, scenario = self.settings, self.settings.make_scenario(rogues)
        seeds = range(FIRST_EVALUATION_SEED, FIRST_EVALUATION_SEED + settings.evaluation_episodes)
        return survive(settings.against, scenario, seeds, settings.device).summary()

    def _resume(self) -> None:
        network, card, text = checkpoint.read(self.settings.out)
        if differences := self.settings.differences(card.settings):
            rule = "must be an empty folder or contain a training with the same settings"
            raise ValueError(f"out {rule}, got {self.settings.out}: {'; '.join(differences)}")
        arrays = checkpoint.read_state(self.settings.out, text)
        with checkpoint.resuming(self.settings.out, text):
            if "normal.mean" in arrays:
                self.env.normal = arrays.pop("normal.mean"), arrays.pop("normal.spread")
            if _LABELLED[0] in arrays:
                self._labelled = [torch.from_numpy(arrays.pop(name)).to(self.model.policy.device) for name in _LABELLED]
            self.model.load_state(arrays | {"rows": self.model.observation})
            self.history |= {**text["counters"], **text["rogues"]}
        self.best = network if self.history["curve"] else None

    def _say(self, text: str) -> None:
        self.console.print(text, highlight=False, markup=False, soft_wrap=True)


class _WithRogues:
    """Policy of the robots that also moves the rogues of its simulation, so that an `EpisodeRunner` plays both."""

    def __init__(self, driver: Any, simulation: Simulation, act: Callable[[np.ndarray], np.ndarray]):
        self.num_worlds, self._driver, self._simulation, self._act = driver.num_worlds, driver, simulation, act
        step = simulation.step
        self._actions = np.zeros(simulation.rogue_action.shape, np.float32)
        simulation.step = lambda action: step(action, self._actions)  # type: ignore[method-assign]

    def reset(self, worlds: Any = None) -> None:
        """Reset the policy of the robots."""
        self._driver.reset(worlds)

    def act(self, observation: Any) -> Any:
        """Store the rogues' actions and return those of the robots."""
        live = self._simulation.rogue_present.numpy().astype(bool)
        if live.any():
            self._actions[live] = self._act(self._simulation.rogue_observation.numpy()[live])
        return self._driver.act(observation)


def _weighted_error(policy: ActorCriticPolicy, rows: Tensor, wanted: Tensor, weights: Tensor) -> tuple[Tensor, Tensor]:
    """Return the weighted sum over rows of the squared error, mean over the components of an action, twice."""
    error = (policy.get_distribution(rows).mode() - wanted).square().mean(1)
    total = (weights * error).sum()
    return total, total


def _words(scores: Mapping[str, float]) -> str:
    mean, quantile, longest = (scores[name] for name in ("mean", "quantile", "longest"))
    return f"undetected for {mean:.2f} s on average, 95 % at most {quantile:.2f} s, best start {longest:.1f} s"
