"""Stable-Baselines3: the batch of worlds as its `VecEnv`, one row for each robot of each world, and PPO on it."""

from collections import deque
from collections.abc import Sequence
from typing import Any, cast

import gymnasium
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.utils import ConstantSchedule, LinearSchedule
from stable_baselines3.common.vec_env import VecEnv
from torch import nn

import baselines
from lissajous_env import Scenario, Simulation
from lissajous_env.world.observation import layout
from lissajous_env.world.seeding import drawn_seeds
from training.learned.checkpoint import Card
from training.learned.network import Network
from training.sb3.critic import CentralCriticPolicy, WorldView
from training.settings import Train

_RECENT = 256
"""Episodes whose scores are kept."""

_FIRST_SEED = 1_000_000


class RobotVecEnv(VecEnv):
    """`Simulation` as a `VecEnv` with shared parameters: row k N + i is robot i of world k.

    A world whose robots are all done begins anew in the same step. A robot that ran out of time has its last
    observation in its info as `terminal_observation`, with `TimeLimit.truncated`; one that was removed ends as a
    termination does, and its row stands still until its world begins anew.

    Args:
        scenario: What is simulated.
        num_worlds: W; there are W N rows.
        card: Which entries of the observation a row holds, and what its action is added to; by default the whole
            observation, and nothing.
        residual_penalty: Reward that an action costs per step and mean square, where it is added to a base's.
        device: Warp device.
        seed: Seed of world 0; world k has seed + k, and draws its next seeds from it. Without one and a call of
            `seed`, the first reset draws seeds from the system.
        threads: CPU threads; all cores by default.
        central: Whether a row ends in what `WorldView` shows of the world, for a critic.
        short: Share of the worlds, the first ones, that begin anew after `short_time`.
        short_time: Time after which they do [s].
    """

    def __init__(
        self,
        scenario: Scenario,
        num_worlds: int = 1,
        card: Card | None = None,
        residual_penalty: float = 0.0,
        device: Any = "cpu",
        seed: int | None = None,
        threads: int | None = None,
        central: bool = False,
        short: float = 0.0,
        short_time: float = 3.0,
    ):
        self.simulation = Simulation(scenario, num_worlds, device=device, seed=seed or 0, threads=threads)
        self._seeded = seed is not None
        self.scenario = self.simulation.scenario
        self.card = card or Card.of(self.scenario)
        self.residual_penalty = residual_penalty
        self.base = None
        if self.card.base is not None:
            self.base = baselines.make(self.card.base, self.scenario, num_worlds, device)
        self.scores: deque[dict[str, Any]] = deque(maxlen=_RECENT)
        self.render_mode = None
        columns = self.card.columns(self.scenario)
        whole = len(columns) == self.simulation.layout.size
        self._columns = None if whole and (columns == np.arange(len(columns))).all() else columns
        self._view = WorldView(self.simulation) if central else None
        last_step = np.full(num_worlds, self.scenario.task.steps)
        last_step[: round(short * num_worlds)] = max(round(short_time / self.scenario.task.step), 1)
        self._last_step = np.minimum(last_step, self.scenario.task.steps)
        observation_space, action_space = row_spaces(self.scenario, self.card, self._view)
        super().__init__(num_worlds * self.simulation.num_robots, observation_space, action_space)

    def reset(self) -> np.ndarray:
        """Begin an episode in every world; returns the rows (W N, inputs)."""
        n, seeds = self.simulation.num_robots, None
        if self._seeds[0] is not None:
            seeds = np.array(self._seeds[::n], dtype=np.int64) % 2**31
        elif not self._seeded:
            seeds = drawn_seeds(self.simulation.num_worlds)
        self._seeded = True
        self.simulation.reset(seeds=seeds)
        self._reset_seeds()
        self._reset_options()
        self._done = np.zeros(self.num_envs, dtype=bool)
        if self.base is not None:
            self.base.reset()
            self._base_action = self.base.act(self.simulation.observation.numpy())
        return self._rows(self.simulation.observation.numpy())

    def save_state(self) -> dict[str, np.ndarray]:
        """Copy everything that changes while the worlds go on, by name."""
        saved = {f"world.{name}": array for name, array in self.simulation.save_state().items()}
        if self.base is not None:
            saved |= {f"base.{name}": array for name, array in self.base.save_state().items()}
            saved["base_action"] = self._base_action
        return saved

    def load_state(self, saved: dict[str, np.ndarray]) -> None:
        """Go on from what `save_state` returned."""
        self.simulation.load_state(named("world.", saved))
        self._seeded = True
        self._done = self.simulation.terminated.numpy().astype(bool).reshape(-1)
        if self.base is not None:
            self.base.load_state(named("base.", saved))
            self._base_action = saved["base_action"]

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions (W N, action_size) of the next step; numbers outside [-1, 1] are clipped.

        Raises:
            ValueError: actions of another shape, or that are not finite.
        """
        worlds, robots, size = self.simulation.action_shape
        given = np.asarray(actions)
        if given.shape != (worlds * robots, size) or given.dtype.kind not in "fiu":
            got = f"{given.shape} of {given.dtype}"
            raise ValueError(f"actions must be numbers of shape {(worlds * robots, size)}, got {got}")
        finite = np.isfinite(given)
        if not finite.all():
            row = int(np.flatnonzero(~finite.all(axis=1))[0])
            where = f"robot_{row % robots} in world {row // robots}"
            raise ValueError(f"action of {where} must be finite, got {given[row].tolist()}")
        clipped = np.clip(given, -1.0, 1.0).astype(np.float32, copy=False)
        self._actions = clipped.reshape(worlds, robots, size)

    def step_wait(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[dict[str, Any]]]:
        """Take the step: rows, rewards, dones, infos."""
        simulation, actions = self.simulation, self._actions
        if self.base is not None:
            actions = np.clip(self._base_action + self.card.residual * actions, -1.0, 1.0)
        simulation.step(actions)
        rewards = simulation.reward.numpy().reshape(-1).copy()
        if self.residual_penalty > 0:
            rewards -= self.residual_penalty * np.square(self._actions).mean(axis=2).reshape(-1)
        terminated = simulation.terminated.numpy().astype(bool).reshape(-1)
        over = simulation.over | (simulation.clock.step.numpy() >= self._last_step)
        ended = terminated | np.repeat(over, simulation.num_robots)
        dones = ended & ~self._done | np.repeat(over, simulation.num_robots)
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if dones.any():
            last = self._rows(simulation.observation.numpy())
            for k in np.flatnonzero(dones):
                infos[k]["terminal_observation"] = last[k]
                infos[k]["TimeLimit.truncated"] = not terminated[k]
        if over.any():
            self.scores.extend(simulation.score(simulation.over))
            simulation.reset(over)
            if self.base is not None:
                self.base.reset(over)
            ended = simulation.terminated.numpy().astype(bool).reshape(-1)
        self._done = ended
        if self.base is not None:
            self._base_action = self.base.act(simulation.observation.numpy())
        return self._rows(simulation.observation.numpy()), rewards, dones, infos

    def _rows(self, observation: np.ndarray) -> np.ndarray:
        if self._columns is not None:
            observation = observation[:, :, self._columns]
        if self.base is not None:
            # Of a last observation the base's action is the one of the step before: only its value is asked for.
            observation = np.concatenate([observation, self._base_action], axis=2)
        rows = observation.reshape(self.num_envs, -1)
        return rows.copy() if self._view is None else np.concatenate([rows, self._view.rows()], axis=1)

    def close(self) -> None:
        """Nothing is held that needs closing."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of the batch, once for each of the rows that are asked for."""
        return [getattr(self, attr_name) for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Set an attribute of the whole batch; rows do not have their own."""
        if indices is not None and len(list(self._get_indices(indices))) != self.num_envs:
            raise ValueError(f"{attr_name} must be set for all rows at once, got indices {indices!r}")
        setattr(self, attr_name, value)

    def env_method(self, method_name: str, *method_args: Any, indices: Any = None, **method_kwargs: Any) -> list[Any]:
        """Call a method of the batch once; its result is repeated for each of the rows that are asked for."""
        result = getattr(self, method_name)(*method_args, **method_kwargs)
        return [result for _ in self._get_indices(indices)]

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Rows are not wrapped one by one."""
        return [False for _ in self._get_indices(indices)]

    def seed(self, seed: int | None = None) -> Sequence[int | None]:
        """Give world k the seed + k N at the next reset (N rows share a world, and the seed of the first)."""
        return super().seed(seed)


def row_spaces(
    scenario: Scenario, card: Card, view: WorldView | None = None
) -> tuple[gymnasium.spaces.Box, gymnasium.spaces.Box]:
    """Observation and action space of a row."""
    ranges, columns = layout(scenario), card.columns(scenario)
    base = np.ones(card.action_size if card.base else 0, dtype=np.float32)
    more = np.full(0 if view is None else view.size, np.inf, dtype=np.float32)
    low = np.concatenate([ranges.low[columns], -base, -more])
    high = np.concatenate([ranges.high[columns], base, more])
    return gymnasium.spaces.Box(low, high), gymnasium.spaces.Box(-1.0, 1.0, (card.action_size,), np.float32)


def make_ppo(settings: Train, env: VecEnv, card: Card) -> PPO:
    """Make Stable-Baselines3's PPO with the settings."""
    rows = env.num_envs * settings.rollout
    central = {"actor_inputs": card.network_inputs} if settings.critic == "world" else {}
    model = PPO(
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
        use_sde=settings.noise_steps > 1,
        sde_sample_freq=settings.noise_steps,
        policy_kwargs={
            "net_arch": list(settings.layers),
            "activation_fn": {"relu": nn.ReLU, "tanh": nn.Tanh}[settings.activation],
            "log_std_init": settings.log_std,
            **central,
        },
        seed=settings.seed,
        device=settings.device,
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


def require_finite(model: Any, settings: Train, steps: int, cause: Exception | None = None) -> None:
    """Say what to do about a training that has diverged; torch itself prints the tensors.

    Args:
        model: What learns.
        settings: How.
        steps: How far it is [steps of a robot].
        cause: What torch raised.

    Raises:
        ValueError: weights, or the actions that they give for the latest rows, are not finite.
    """
    finite = all(bool(torch.isfinite(parameter).all()) for parameter in model.policy.parameters())
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


def named(prefix: str, arrays: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Arrays whose names begin with a prefix, by the rest of their names."""
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}


def save_model(model: PPO) -> dict[str, np.ndarray]:
    """Copy what training goes on from: weights, optimizer, random streams, the rows to act on next."""
    arrays = {f"model.{name}": tensor.detach().cpu().numpy() for name, tensor in model.policy.state_dict().items()}
    for k, moments in model.policy.optimizer.state_dict()["state"].items():
        arrays |= {f"optimizer.{k}.{name}": tensor.cpu().numpy() for name, tensor in moments.items()}
    _, keys, position, *_ = np.random.get_state(legacy=True)
    arrays["random.torch"] = torch.get_rng_state().numpy()
    arrays["random.numpy"] = np.append(keys, np.uint32(position)).astype(np.uint32)
    arrays["rows"] = np.asarray(model._last_obs)
    arrays["starts"] = np.asarray(model._last_episode_starts)
    return {name: np.array(array) for name, array in arrays.items()}


def load_model(model: PPO, arrays: dict[str, np.ndarray], steps: int, updates: int) -> None:
    """Go on from what `save_model` returned, in a model of the same settings."""
    model.policy.load_state_dict({name: torch.from_numpy(array) for name, array in named("model.", arrays).items()})
    optimizer = model.policy.optimizer.state_dict()
    for name, array in arrays.items():
        if name.startswith("optimizer."):
            _, k, moment = name.split(".")
            optimizer["state"].setdefault(int(k), {})[moment] = torch.from_numpy(array)
    model.policy.optimizer.load_state_dict(optimizer)
    torch.set_rng_state(torch.from_numpy(arrays["random.torch"]))
    keys, position = arrays["random.numpy"][:-1], int(arrays["random.numpy"][-1])
    np.random.set_state(("MT19937", keys, position, 0, 0.0))
    model._last_obs = arrays["rows"]
    model._last_episode_starts = arrays["starts"].astype(bool)
    model.num_timesteps, model._n_updates = steps, updates
