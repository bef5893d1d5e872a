"""RLlib's PPO on `LissajousMultiAgentEnv`, with one module `robot` for all robots."""

import contextlib
import math
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import torch
from ray.rllib.algorithms.algorithm import Algorithm
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.callbacks.callbacks import RLlibCallback
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.apis.value_function_api import ValueFunctionAPI
from ray.rllib.core.rl_module.multi_rl_module import MultiRLModuleSpec
from ray.rllib.core.rl_module.rl_module import RLModuleSpec
from ray.rllib.core.rl_module.torch import TorchRLModule
from torch import nn

from lissajous_env import Scenario
from lissajous_env.device.devices import silent_stderr
from training.learned.card import Card
from training.learned.history import SCORES
from training.learned.network import Network
from training.rllib.env import LissajousMultiAgentEnv
from training.settings import TrainingSettings

MODULE = "robot"
"""Name of the module of all robots."""
_RECENT = 256
"""Number of latest episodes over which scores are averaged."""


class RobotModule(TorchRLModule, ValueFunctionAPI):
    """Module of two perceptrons, for the mean of a robot's action and for the value, and a learned standard deviation.

    `model_config` contains `layers`, `activation`, `log_std` and `start`, the initial `Network` or None.
    """

    def setup(self) -> None:
        """Make the networks with orthogonal weights, which are small in the policy's last layer."""
        config = self.model_config
        inputs, outputs = self.observation_space.shape[0], self.action_space.shape[0]
        self.policy = _perceptron(inputs, config["layers"], outputs, config["activation"], 0.01)
        self.value = _perceptron(inputs, config["layers"], 1, config["activation"], 1.0)
        self.log_std = nn.Parameter(torch.full((outputs,), float(config["log_std"])))
        if config["start"] is not None:
            self.policy.load_state_dict(config["start"].to_torch("cpu").state_dict())

    def _forward(self, batch: dict[str, Any], **kwargs: Any) -> dict[str, Any]:
        mean = self.policy(batch[Columns.OBS])
        return {Columns.ACTION_DIST_INPUTS: torch.cat([mean, self.log_std.expand_as(mean)], dim=-1)}

    def compute_values(self, batch: dict[str, Any], embeddings: Any = None) -> torch.Tensor:
        """Return the values (B,) of the observations."""
        return self.value(batch[Columns.OBS]).squeeze(-1)


def _perceptron(inputs: int, layers: tuple[int, ...], outputs: int, activation: str, gain: float) -> nn.Sequential:
    sizes = [inputs, *layers, outputs]
    made: list[nn.Module] = []
    for k, (before, after) in enumerate(pairwise(sizes)):
        linear = nn.Linear(before, after)
        nn.init.orthogonal_(linear.weight, gain if k == len(layers) else math.sqrt(2.0))
        nn.init.zeros_(linear.bias)
        made += [linear, {"relu": nn.ReLU, "tanh": nn.Tanh}[activation]()]
    return nn.Sequential(*made[:-1])


class Scores(RLlibCallback):
    """Callback that logs the columns of `SCORES` over the latest episodes as RLlib's metrics `score`."""

    def on_episode_end(self, *, metrics_logger: Any = None, env: Any = None, env_index: int, **kwargs: Any) -> None:
        """Log the score of an ended episode."""
        score = env.envs[env_index].unwrapped.score()
        for column in SCORES.values():
            if math.isfinite(value := score[column.name]):
                metrics_logger.log_value(("score", column.name), value, window=_RECENT)


def make_ppo(
    settings: TrainingSettings, scenario: Scenario, card: Card, start: Network | None = None, iteration: int = 0
) -> Algorithm:
    """Return RLlib's PPO with the settings, on the Ray cluster to which this process is connected.

    Args:
        settings: Settings of the training.
        scenario: Scenario to learn in; a step of RLlib is one of all its robots.
        card: Inputs and base of the policy.
        start: Initial network.
        iteration: Number of completed iterations, which changes the seeds of a resumed training.
    """
    worlds = -(-settings.num_worlds // settings.workers)
    rows = settings.workers * worlds * settings.rollout
    last = max(settings.steps // scenario.num_robots, 1)
    model = {
        "layers": settings.layers,
        "activation": settings.activation,
        "log_std": settings.log_std,
        "start": start,
    }
    config = (
        PPOConfig()
        .environment(
            LissajousMultiAgentEnv,
            env_config={
                "scenario": scenario,
                "card": card,
                "residual_penalty": settings.residual_penalty if card.base else 0.0,
            },
            disable_env_checking=True,
            # The environment clips actions.
            normalize_actions=False,
            clip_actions=False,
        )
        .env_runners(
            num_env_runners=settings.workers,
            num_envs_per_env_runner=worlds,
            rollout_fragment_length=settings.rollout,
            # Wait for slow workers: a timeout would discard their episodes.
            sample_timeout_s=600.0,
        )
        .learners(num_learners=0, num_gpus_per_learner=1 if settings.device == "cuda" else 0)
        .multi_agent(policies={MODULE}, policy_mapping_fn=_shared)
        .rl_module(
            rl_module_spec=MultiRLModuleSpec(
                rl_module_specs={MODULE: RLModuleSpec(module_class=RobotModule, model_config=model)}
            )
        )
        .training(
            lr=[[0, settings.learning_rate], [last, settings.learning_rate / 50]],
            gamma=settings.gamma,
            lambda_=settings.gae_lambda,
            clip_param=settings.clip_range,
            entropy_coeff=settings.entropy,
            vf_loss_coeff=settings.value_weight,
            vf_clip_param=math.inf,
            use_kl_loss=False,
            grad_clip=settings.gradient_max,
            grad_clip_by="global_norm",
            num_epochs=settings.epochs,
            minibatch_size=min(settings.batch_size, rows),
            train_batch_size_per_learner=rows,
        )
        .fault_tolerance(
            restart_failed_env_runners=True,
            delay_between_env_runner_restarts_s=1.0,
            # Wait this long in each iteration for workers that are restarting.
            env_runner_health_probe_timeout_s=2.0,
        )
        .callbacks(Scores)
        .debugging(seed=_first_seed(settings.seed, iteration), log_level="ERROR")
    )
    # Ray's native code prints warnings about RLlib's own workers; errors are raised.
    with silent_stderr():
        algorithm = config.build_algo()
    with contextlib.suppress(OSError):
        # RLlib creates an empty folder in the user's home directory and never uses it.
        Path(str(algorithm.logdir)).rmdir()
    return algorithm


def to_network(weights: Mapping[str, Any], activation: str) -> Network:
    """Return the policy's network from the state of a module, `RobotModule.get_state()`.

    Raises:
        ValueError: a weight is not finite.
    """
    layers = sorted({int(name.split(".")[1]) for name in weights if name.startswith("policy.")})
    array = {name: np.asarray(value, dtype=np.float32).copy() for name, value in weights.items()}
    return Network(
        tuple(array[f"policy.{k}.weight"] for k in layers),
        tuple(array[f"policy.{k}.bias"] for k in layers),
        activation,
    )


def policy_of(algorithm: Algorithm, activation: str) -> Network:
    """Copy the current policy of an algorithm, the mean of its action."""
    group = algorithm.learner_group
    assert group is not None
    return to_network(group.get_weights([MODULE])[MODULE], activation)


def _shared(agent: Any, episode: Any, **_: Any) -> str:
    return MODULE


def _first_seed(seed: int, iteration: int) -> int:
    return int(np.random.SeedSequence((seed, iteration)).generate_state(1)[0] >> 1)
