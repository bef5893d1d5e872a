"""Stable-Baselines3's PPO, its networks as plain arrays, and what a training of it goes on from."""

from functools import partial
from typing import Any, cast

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.utils import ConstantSchedule, LinearSchedule
from torch import nn

from lissajous_env.device.devices import cores
from training.learned.card import Card
from training.learned.named_arrays import prefixed, within
from training.learned.network import Network
from training.sb3.critic import CentralCriticPolicy
from training.sb3.rollouts import RobotPPO
from training.sb3.vec_env import RobotVecEnv
from training.settings import TrainingSettings

_FIRST_SEED = 1_000_000


def make_ppo(settings: TrainingSettings, env: RobotVecEnv, card: Card) -> RobotPPO:
    """Make Stable-Baselines3's PPO with the settings."""
    rows = env.num_envs * settings.rollout
    central = {"actor_inputs": card.network_inputs} if settings.has_central_critic else {}
    model = RobotPPO(
        CentralCriticPolicy if central else "MlpPolicy",
        env,
        learning_rate=LinearSchedule(settings.learning_rate, settings.learning_rate / 50, 1.0),
        n_steps=settings.rollout,
        batch_size=min(settings.batch_size, rows),
        n_epochs=settings.epochs,
        gamma=settings.gamma,
        gae_lambda=settings.gae_lambda,
        clip_range=ConstantSchedule(settings.clip_range),
        ent_coef=settings.entropy,
        vf_coef=settings.value_weight,
        max_grad_norm=settings.gradient_max,
        use_sde=settings.chosen_noise_steps > 1,
        sde_sample_freq=settings.chosen_noise_steps,
        policy_kwargs={
            "net_arch": list(settings.layers),
            "activation_fn": {"relu": partial(nn.ReLU, inplace=True), "tanh": nn.Tanh}[settings.activation],
            "optimizer_kwargs": {"eps": 1e-5, "fused": True},
            "log_std_init": settings.log_std,
            **central,
        },
        seed=settings.seed,
        device=settings.device,
        threads=settings.threads or cores(),
    )
    # PPO seeds the worlds with the number itself; they begin far from the seeds that evaluations are played on.
    env.seed(_FIRST_SEED * (1 + settings.seed))
    return model


def policy_layers(model: PPO) -> list[nn.Linear]:
    """Linear layers of a model's policy, from the observation to the mean of the action."""
    hidden = [layer for layer in model.policy.mlp_extractor.policy_net if isinstance(layer, nn.Linear)]
    return [*hidden, cast(nn.Linear, model.policy.action_net)]


def critic_parameters(policy: nn.Module) -> list[str]:
    """Names of a policy's parameters that the critic alone uses."""
    return [name for name, _ in policy.named_parameters() if "value_net" in name]


def to_network(model: PPO, activation: str) -> Network:
    """Copy a model's policy, the mean of its action, as plain arrays."""
    layers = policy_layers(model)
    return Network(
        tuple(layer.weight.detach().cpu().numpy().copy() for layer in layers),
        tuple(layer.bias.detach().cpu().numpy().copy() for layer in layers),
        activation,
    )


def from_network(model: PPO, network: Network) -> None:
    """Give a model's policy the weights of a network of the same layers."""
    with torch.no_grad():
        for layer, weight, bias in zip(policy_layers(model), network.weights, network.biases, strict=True):
            layer.weight.copy_(torch.tensor(weight))
            layer.bias.copy_(torch.tensor(bias))


def require_finite(model: Any, settings: TrainingSettings, steps: int, cause: Exception | None = None) -> None:
    """Say what to do about a training that has diverged; torch itself prints the tensors.

    Args:
        model: What learns.
        settings: How.
        steps: How far it is [steps of a robot].
        cause: What torch raised.

    Raises:
        ValueError: weights, the spread of the noise, or the actions for the latest rows are not finite.
    """
    finite = all(bool(torch.isfinite(parameter).all()) for parameter in model.policy.parameters())
    spread = model.policy.log_std.detach().exp()
    finite = finite and bool((torch.isfinite(spread) & (spread > 0)).all())
    if finite and model._last_obs is not None:
        rows = torch.as_tensor(np.asarray(model._last_obs), dtype=torch.float32, device=model.device)
        with torch.no_grad():
            features = model.policy.mlp_extractor.forward_actor(rows)
            finite = bool(torch.isfinite(model.policy.action_net(features)).all())
    if not finite:
        raise ValueError(
            f"learning_rate must be low enough that weights and actions stay finite, got {settings.learning_rate:g}: "
            f"after {steps:,} steps they are not; the last checkpoint is as it was"
        ) from cause


def save_model(model: PPO) -> dict[str, np.ndarray]:
    """Copy what training goes on from: weights, optimizer, random streams, the rows to act on next."""
    weights = {name: tensor.detach().cpu().numpy() for name, tensor in model.policy.state_dict().items()}
    arrays = prefixed("model", weights)
    for k, moments in model.policy.optimizer.state_dict()["state"].items():
        arrays |= prefixed(f"optimizer.{k}", {name: tensor.cpu().numpy() for name, tensor in moments.items()})
    _, keys, position, *_ = np.random.get_state(legacy=True)
    arrays["random.torch"] = torch.get_rng_state().numpy()
    arrays["random.numpy"] = np.append(keys, np.uint32(position)).astype(np.uint32)
    arrays["rows"] = np.asarray(model._last_obs)
    arrays["starts"] = np.asarray(model._last_episode_starts)
    return {name: np.array(array) for name, array in arrays.items()}


def load_model(model: PPO, arrays: dict[str, np.ndarray], steps: int, updates: int) -> None:
    """Go on from what `save_model` returned, in a model of the same settings."""
    model.policy.load_state_dict({name: torch.from_numpy(array) for name, array in within("model", arrays).items()})
    optimizer = model.policy.optimizer.state_dict()
    for name, array in within("optimizer", arrays).items():
        k, moment = name.split(".")
        optimizer["state"].setdefault(int(k), {})[moment] = torch.from_numpy(array)
    model.policy.optimizer.load_state_dict(optimizer)
    torch.set_rng_state(torch.from_numpy(arrays["random.torch"]))
    keys, position = arrays["random.numpy"][:-1], int(arrays["random.numpy"][-1])
    np.random.set_state(("MT19937", keys, position, 0, 0.0))
    model._last_obs = arrays["rows"]
    model._last_episode_starts = arrays["starts"].astype(bool)
    model.num_timesteps, model._n_updates = steps, updates
