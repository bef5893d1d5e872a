"""`lissajous train`: begin with a classical policy, then collect, update, validate and save.

All robots share one network, which plays teams of any size. It reads the action of that policy, its base, and corrects
it (residual learning: T. Johannink et al., ICRA 2019). It learns by PPO (J. Schulman et al., arXiv:1707.06347) with a
central critic (C. Yu et al., "The Surprising Effectiveness of PPO in Cooperative Multi-Agent Games", NeurIPS 2022),
which reads the true state of all robots and of up to 16 targets, or with a critic that reads what the robot perceives.
The cost of collisions and near collisions rises while there are more collisions than a limit, with the noise of
exploration, so that without it there are fewer. The best policy is chosen by validation, in worlds that no update uses;
the base alone is the first candidate.

Differs from these papers: a time limit is not a terminal state, so the value of the last state stands for that of the
next one; a robot is rewarded for the targets that it alone has in sight; the actor is not updated further with a
rollout once its policy differs too much from that of the rollout; and the noise of successive actions is correlated, so
that it moves a robot farther (J. Hollenstein, G. Martius, J. Piater, "Colored Noise in PPO", AAAI 2024).
"""

import contextlib
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import torch
from rich.console import Console
from torch import Tensor, nn

import baselines
from baselines.policies.base import UnsuitableScenarioError
from lissajous_env.console.terminal import make_console, print_line
from lissajous_env.parameters.assumptions import quietly
from training.learned import checkpoint
from training.learned.card import Card
from training.learned.networks import ABSENT, TeamNetwork
from training.learned.perception import BASE, OWN, TOKEN, unread_entries
from training.learned.policy import LearnedTeam
from training.settings import TrainingSettings
from training.validation import described, limit_of, mean_of, rating_of, validate
from training.worlds import TRUTH, Rollout, StepResult, Truth, Worlds

FIRST_SEED = 1_000_000
"""Seed of the first world of a training with seed 0, and difference between the first seeds of two trainings."""
_WARM_UP = 25
"""Rollouts at the beginning in which only the critic learns, so that its errors do not spoil the base."""
_NEAR = 0.25
"""Cost of a step in which robots almost collide, as a share of that of a collision: collisions alone are too rare."""
_BOUND = 0.01
"""Weight of the squared excess of the action means over [-1, 1]."""
_RESTRAINT = 0.2
"""Weight of the squared correction of a base: without it, noisy advantages let corrections grow by chance."""


def train(
    settings: TrainingSettings,
    console: Console | None = None,
    log: Callable[[dict[str, float]], Any] = lambda point: None,
) -> dict[str, Any]:
    """Train until the last step, from the last checkpoint if `settings.out` has one; return the history.

    Args:
        settings: Settings of the training.
        console: Console of the progress lines.
        log: Called with the numbers of each validation, such as `wandb.log`.

    Raises:
        ValueError: the folder contains other files or results of other settings, or is in use by another process.
        OSError: the disk is full; the last checkpoint is intact.
    """
    console = console or make_console()
    say = partial(print_line, console)
    torch.set_num_threads(settings.threads or 1)
    try:
        with quietly():
            training = Training(settings)
    except UnsuitableScenarioError as error:  # of the first worlds, before there is a folder
        rule = "must be none or a policy that can play the scenario (--base)"
        raise ValueError(f"base {rule}, got {settings.rival}: {error}") from error
    with checkpoint.locked(settings.out) as folder, quietly():
        began, diagnostics = time.monotonic(), {}
        card = Card.of(settings.make_scenario(), settings=settings.to_dict(), base=settings.corrected_base)
        code = checkpoint.code_of(settings.make_validation_scenarios(), [settings.rival])
        history = _resume_or_begin(settings, training, card, code, say)
        notes = {"training": history, "code": code}
        curve, rivals, numbers = history["curve"], history["rivals"], training.numbers
        began -= curve[-1]["seconds"] if curve else 0.0
        limit, against = limit_of(settings.collisions, rivals), history["rival"] or "before the training"
        while True:
            steps, every, done = numbers["steps"], settings.evaluate_every, numbers["steps"] >= settings.steps
            last = curve[-1]["steps"] if curve else -every
            if steps // every > last // every or (done and last < steps):
                network = training.actor.network()
                results = validate(settings, partial(LearnedTeam, network, card), rivals or history["first"])
                history["first"], means = history["first"] or results, mean_of(results)
                point = {"steps": steps, "seconds": round(time.monotonic() - began, 1)} | means | diagnostics
                curve.append(point)
                say(f"{point['steps']:,.0f} steps, {point['seconds']:.0f} s: {described(point, against)}")
                best = history["best"]
                if best is None or rating_of(point, limit) > rating_of(best, limit):
                    history["best"] = point
                    checkpoint.save(folder, network, card, notes=notes, subfolder=checkpoint.BEST)
                checkpoint.save(folder, network, card, state=training.save_state(), notes=notes)
                log(point)
            if done:
                say(f"{settings.out / checkpoint.BEST}: {described(history['best'], against)}")
                return history
            diagnostics = training.update(training.collect(), limit)


def _resume_or_begin(
    settings: TrainingSettings, training: "Training", card: Card, code: dict[str, Any], say: Callable[[str], None]
) -> dict[str, Any]:
    """Load the last checkpoint if there is one, otherwise validate the rival; return the history."""
    if (settings.out / checkpoint.FILE).exists():
        with checkpoint.resuming(settings, card, code) as (description, arrays):
            training.load_state(arrays)
            say(f"{settings.out} has {training.numbers['steps']:,.0f} of {settings.steps:,} steps")
            return description["training"]
    history: dict[str, Any] = {"rival": None, "rivals": [], "first": None, "curve": [], "best": None}
    if settings.rival is not None:
        with contextlib.suppress(UnsuitableScenarioError):  # such as a rectangle that is too small for a partition
            history["rivals"] = validate(settings, partial(baselines.make, settings.rival), None)
            history["rival"] = settings.rival
            say(f"{settings.rival}: {described(mean_of(history['rivals']))}")
    if unread := unread_entries(settings.make_scenario()):
        say(f"warning: the network does not read the entries that {', '.join(unread)} add to the observation")
    first = _WARM_UP * settings.rollout * training.worlds.count
    if training.actor.corrects and settings.steps <= first:
        say(f"warning: only the critic learns in the first {first:,} steps: {settings.steps:,} do not change the rule")
    return history


class Training:
    """State of a training: networks, optimizer, worlds and running numbers."""

    def __init__(self, settings: TrainingSettings):
        torch.manual_seed(settings.seed)
        self.settings = settings
        self.worlds = Worlds(settings, settings.worlds, FIRST_SEED * (1 + settings.seed))
        size = self.worlds.batch.scenario.action_size
        self.actor = TeamModule(settings, len(TOKEN), size, settings.heads, settings.corrected_base is not None)
        self.critic = TeamModule(settings, len(TRUTH if settings.critic == "central" else TOKEN), 1)
        self.networks = nn.ModuleList([self.actor, self.critic])
        self.optimizer = torch.optim.Adam(self.networks.parameters(), settings.learning_rate, eps=1e-5)
        self.numbers: dict[str, float] = {"penalty": settings.penalty, "variance": 1.0}
        self.numbers |= dict.fromkeys(("steps", "rollouts", "collided", "counted"), 0.0)
        """`steps` of robots and `rollouts` so far; `penalty`, the factor of the costs of collisions; `variance` of the
        returns over the last `counted` steps, at most 300; `collided`, a team's collisions per episode with the noise
        of exploration, averaged over about 200 steps."""
        self._returns = np.zeros(self.worlds.count)
        self._noise = torch.randn(self.worlds.count, size)
        self._perception, self._truth = self.worlds.perception(), self.worlds.truth()

    def schedule(self) -> tuple[float, float]:
        """Return the standard deviation of the actions, whose logarithm changes linearly, and the learning rate."""
        settings, done = self.settings, min(self.numbers["steps"] / self.settings.steps, 1.0)
        deviation = settings.noise * (settings.noise_end / settings.noise) ** done
        return deviation, settings.learning_rate * max(1 - done, 0.05)

    def collect(self) -> Rollout:
        """Play T steps in all worlds, with noise, and compute advantages and returns."""
        settings, worlds, deviation = self.settings, self.worlds, self.schedule()[0]
        transitions, steps, values = [], [], []
        for _ in range(settings.rollout):
            perception = [torch.from_numpy(part) for part in self._perception]
            with torch.no_grad():
                mean = self.actor(perception)
            fresh = torch.randn_like(mean)
            self._noise = settings.correlation * self._noise + (1 - settings.correlation**2) ** 0.5 * fresh
            action = mean + deviation * self._noise
            likelihood = -0.5 * ((action - mean) / deviation).square().sum(-1)
            critic_inputs, value = self._values()
            values.append(value)
            step = worlds.step(action.numpy())
            self._truth = worlds.truth()
            transitions.append((perception, critic_inputs, action, likelihood, torch.from_numpy(step.acted)))
            steps.append((self._reward(step, self._truth), step))
            worlds.begin(step.over)
            if step.over.any():
                self._truth = worlds.truth()
            self._perception = worlds.perception()
            self.numbers["steps"] += float(step.acted.sum())
        values.append(self._values()[1])
        advantages = self._advantages(steps, np.stack(values))
        of_actor, of_critic, *others = zip(*transitions, strict=True)
        perception, critic_inputs = (list(map(torch.stack, zip(*one, strict=True))) for one in (of_actor, of_critic))
        actions, likelihood, acted = (torch.stack(part) for part in others)
        returns = advantages + torch.from_numpy(np.stack(values[:-1]))
        return Rollout(perception, critic_inputs, actions, likelihood, acted, advantages, returns, deviation)

    def _reward(self, step: StepResult, truth: Truth) -> np.ndarray:
        """Return the rewards (B,) of a step that led to a true state, and update the running numbers."""
        settings, task, numbers = self.settings, self.worlds.batch.scenario.task, self.numbers
        own = task.reward_observation * task.step * truth.alone
        cost = step.collided + _NEAR * task.reward_collision * truth.nearness * step.acted
        reward = step.reward + numbers["penalty"] * cost
        reward = reward + settings.credit * own + (1 - settings.credit) * step.observed
        # Two robots take part in a collision.
        per_team = 0.5 * (step.collided / (task.reward_collision or 1.0)).sum() / len(step.over)
        rate = per_team * self.worlds.steps
        numbers["collided"] += (rate - numbers["collided"]) / 200
        self._returns = self._returns * settings.gamma + reward
        numbers["variance"] += (self._returns.var() - numbers["variance"]) / (1 + min(numbers["counted"], 300))
        self._returns *= 1 - np.repeat(step.over, self.worlds.side.slots)
        numbers["counted"] += 1
        return reward

    def _values(self) -> tuple[list[Tensor], np.ndarray]:
        """Return tokens and presence, which the critic reads besides the robots' own numbers, and its values (B,)."""
        perceived, truth = self._perception, self._truth
        parts = (truth.tokens, truth.present) if self.settings.critic == "central" else perceived[1:]
        own, *critic_inputs = [torch.from_numpy(part) for part in (perceived[0], *parts)]
        with torch.no_grad():
            return critic_inputs, self.critic([own, *critic_inputs])[:, 0].numpy()

    def _advantages(self, steps: Sequence[tuple[np.ndarray, StepResult]], values: np.ndarray) -> Tensor:
        """Return generalized advantages (T, B), for rewards divided by the standard deviation of the returns."""
        settings, unit = self.settings, np.sqrt(self.numbers["variance"] + 1e-8)
        advantages, later = np.zeros_like(values[:-1]), np.zeros_like(values[0])
        for t in reversed(range(len(steps))):
            reward, step = steps[t]
            over = np.repeat(step.over, self.worlds.side.slots)
            following = np.where(over, values[t], values[t + 1]) * (1 - step.ended)
            error = reward / unit + settings.gamma * following - values[t]
            later = error + settings.gamma * settings.gae_lambda * later * ~over * (1 - step.ended)
            advantages[t] = later
        return torch.from_numpy(advantages)

    def update(self, rollout: Rollout, limit: float = 0.0) -> dict[str, float]:
        """Update the critic, and the actor until its policy differs too much from the rollout's; return diagnostics.

        Args:
            rollout: Steps with the present policy.
            limit: Collisions per episode above which their cost rises.
        """
        settings, numbers = self.settings, self.numbers
        self.optimizer.param_groups[0]["lr"] = self.schedule()[1]
        updates_actor, divergence = numbers["rollouts"] >= _WARM_UP * self.actor.corrects, 0.0
        for _ in range(settings.epochs):
            for chosen in torch.randperm(rollout.acted.shape[1]).split(max(settings.minibatch // settings.rollout, 1)):
                acted, inputs = rollout.acted[:, chosen], [part[:, chosen] for part in rollout.critic_inputs]
                value = self.critic([rollout.perception[0][:, chosen], *inputs])[..., 0]
                loss = (0.5 * (value - rollout.returns[:, chosen]).square() * acted).mean()
                if updates_actor:
                    of_actor, divergence = self._actor_loss(rollout, chosen)
                    updates_actor = divergence < settings.divergence
                    loss = loss + of_actor if updates_actor else loss
                self.optimizer.zero_grad()
                loss.backward()
                for network in self.networks:
                    nn.utils.clip_grad_norm_(network.parameters(), 0.5)
                # A network on which the loss does not depend has no gradient, so that its momentum does not change it.
                self.optimizer.step()
        numbers["rollouts"] += 1
        excess = np.clip(numbers["collided"] / max(limit, 0.05) - 1, -1, 1)
        numbers["penalty"] = float(np.clip(numbers["penalty"] * np.exp(0.02 * excess), 0.01, 100))
        errors, returns = (part[rollout.acted > 0] for part in (rollout.advantages, rollout.returns))
        explained = 1 - (errors.var() / returns.var().clamp(min=1e-12)).item()
        return {"approx_kl": divergence, "explained_variance": explained, "penalty": numbers["penalty"]}

    def _actor_loss(self, rollout: Rollout, chosen: Tensor) -> tuple[Tensor, float]:
        """Return the actor's loss on the chosen robots, and its divergence (approximate KL) from the rollout's."""
        settings = self.settings
        perception, acted = [part[:, chosen] for part in rollout.perception], rollout.acted[:, chosen]
        mean = self.actor(perception)
        likelihood = -0.5 * ((rollout.actions[:, chosen] - mean) / rollout.deviation).square().sum(-1)
        change = likelihood - rollout.likelihood[:, chosen]
        ratio = change.exp()
        divergence = ((ratio - 1 - change) * acted).sum() / acted.sum().clamp(min=1)
        advantage = rollout.advantages[:, chosen]
        of_robots = advantage[acted > 0]  # without slots that have no robot, and robots that were removed
        if len(of_robots) > 1:
            advantage = (advantage - of_robots.mean()) / (of_robots.std() + 1e-8)
        gain = torch.min(ratio * advantage, ratio.clamp(1 - settings.clip, 1 + settings.clip) * advantage)
        cost = _BOUND * (mean.abs() - 1).clamp(min=0).square().sum(-1)
        if self.actor.corrects:
            base_action = perception[0][..., BASE][..., : mean.shape[-1]]
            cost = cost + _RESTRAINT * (mean[..., :2] - base_action).square().sum(-1)
        return ((cost - gain) * acted).mean(), divergence.item()

    def save_state(self) -> dict[str, np.ndarray]:
        """Copy what a resumed training needs, as arrays by name."""
        arrays = save_state(self.networks, self.optimizer) | {"numbers": np.array([*self.numbers.values()])}
        if self.settings.space is None:
            arrays |= {f"worlds.{name}": array for name, array in self.worlds.save_state().items()}
            arrays |= {"returns": self._returns, "noise": self._noise.numpy()}
        return arrays

    def load_state(self, arrays: dict[str, np.ndarray]) -> None:
        """Resume from what `save_state` returned: in the same episodes or, of a space, in new ones."""
        load_state(self.networks, self.optimizer, arrays)
        self.numbers.update(zip(self.numbers, arrays["numbers"].tolist(), strict=True))
        if self.settings.space is None:
            self.worlds.load_state(_within("worlds", arrays))
            self._returns, self._noise = arrays["returns"], torch.from_numpy(arrays["noise"])
        else:
            # Seeds that no earlier part of the training has begun with.
            self.worlds.restart(FIRST_SEED * (1 + self.settings.seed) + 200_000 + int(self.numbers["rollouts"]))
        self._perception, self._truth = self.worlds.perception(), self.worlds.truth()


class TeamModule(nn.Module):
    """`TeamNetwork` in PyTorch: the mean of a robot's action, or a critic's value.

    Args:
        settings: Sizes of the layers.
        token: Size of a token.
        outputs: Size of the output.
        heads: Number of attention heads; 0 for the mean of the tokens' features.
        corrects: Add the action of the base, the own numbers `BASE`, to the outputs, which are zeros at first.
    """

    def __init__(self, settings: TrainingSettings, token: int, outputs: int, heads=0, corrects=False):
        super().__init__()
        self.corrects = corrects
        features, hidden = settings.features, settings.hidden
        self.own, self.token = nn.Linear(len(OWN), 64), nn.Linear(token, features)
        self.query = nn.Linear(64, heads * features) if heads else None
        self.trunk = nn.Linear(64 + max(heads, 1) * features, hidden)
        self.last, self.action = nn.Linear(hidden, hidden), nn.Linear(hidden, outputs)
        nn.init.orthogonal_(self.action.weight, 0.0 if corrects else 0.01)
        nn.init.zeros_(self.action.bias)

    @torch.autocast("cpu", torch.bfloat16)
    def forward(self, perception: Sequence[Tensor]) -> Tensor:
        """Return the outputs (..., outputs) for own numbers (..., A), tokens (..., K, F), and presence (..., K)."""
        own, tokens, present = perception
        own, features = torch.relu(self.own(own)), torch.relu(self.token(tokens))
        if self.query is None:
            pooled = (features * present[..., None]).mean(-2)
        else:
            query, present = self.query(own).unflatten(-1, (-1, features.shape[-1])), present[..., None, :]
            score = query @ features.mT + (present - 1) * ABSENT
            weight = (torch.softmax(score, -1) * present).to(features.dtype)
            pooled = (weight @ features).flatten(-2)
        hidden = torch.relu(self.trunk(torch.cat([own, pooled], -1)))
        outputs = self.action(torch.relu(self.last(hidden))).float()
        if self.corrects:
            outputs = outputs + nn.functional.pad(perception[0][..., BASE], (0, outputs.shape[-1] - 2))
        return outputs

    def network(self) -> TeamNetwork:
        """Copy the weights into a network that needs no PyTorch."""
        return TeamNetwork({name: tensor.numpy() for name, tensor in self.state_dict().items()})


def save_state(module: nn.Module, optimizer: torch.optim.Optimizer) -> dict[str, np.ndarray]:
    """Copy a module, its optimizer, and the state of torch's random generator, by name."""
    tensors = {f"model.{name}": tensor for name, tensor in module.state_dict().items()}
    for k, moments in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{k}.{name}": tensor for name, tensor in moments.items()}
    tensors["random"] = torch.get_rng_state()
    return {name: np.array(tensor.cpu().numpy()) for name, tensor in tensors.items()}


def load_state(module: nn.Module, optimizer: torch.optim.Optimizer, arrays: dict[str, np.ndarray]) -> None:
    """Resume from what `save_state` returned; other names are ignored."""
    module.load_state_dict({name: torch.from_numpy(array) for name, array in _within("model", arrays).items()})
    state: dict[str, Any] = optimizer.state_dict()
    for name, array in _within("optimizer", arrays).items():
        k, moment = name.split(".")
        state["state"].setdefault(int(k), {})[moment] = torch.from_numpy(array)
    optimizer.load_state_dict(state)
    torch.set_rng_state(torch.from_numpy(arrays["random"]))


def _within(part: str, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return the arrays of one set, without the name of the set."""
    start = f"{part}."
    return {name.removeprefix(start): array for name, array in arrays.items() if name.startswith(start)}
