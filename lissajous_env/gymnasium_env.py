"""The Gymnasium environments: the whole team as one agent, in a batch of worlds or in one."""

from typing import Any

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from lissajous_env import library
from lissajous_env.actions import action_table
from lissajous_env.pettingzoo_env import LissajousParallelEnv
from lissajous_env.reward import TERMS
from lissajous_env.scenario import Scenario
from lissajous_env.simulation import Simulation, fold_seed


def _team_spaces(simulation: Simulation, discrete: bool) -> tuple[gymnasium.spaces.Box, gymnasium.Space]:
    layout, n = simulation.layout, simulation.num_robots
    low, high = np.tile(layout.low, (n, 1)), np.tile(layout.high, (n, 1))
    observation = gymnasium.spaces.Box(low, high, dtype=np.float32)
    if discrete:
        return observation, gymnasium.spaces.MultiDiscrete([len(action_table(simulation.scenario))] * n)
    return observation, gymnasium.spaces.Box(-1.0, 1.0, simulation.action_shape[1:], np.float32)


class LissajousVectorEnv(VectorEnv):
    """A batch of worlds as a Gymnasium `VectorEnv`; the agent is the team.

    Observations are (num_envs, N, D), actions (num_envs, N, action_size) or, discrete, (num_envs, N) rows of the
    action table; the reward is the mean over the robots. A world is terminated when all of its robots are. Infos hold
    `reward` (num_envs, N); when worlds end, `score`, an array of the score rows of the episodes that ended (None
    elsewhere) with its mask `_score`; and with SAME_STEP also `final_obs`.

    Args:
        scenario: Name of a scenario, or one that was made.
        num_envs: Worlds.
        device: Warp device.
        autoreset_mode: `NEXT_STEP` (the step after the end resets), `SAME_STEP` or `DISABLED`, or the enum.
        discrete_actions: Whether actions are rows of the table in `lissajous_env.actions`.
        threads: CPU threads; all cores by default.
        **overrides: Fields of the scenario, as in `lissajous_env.scenario`.
    """

    def __init__(
        self,
        scenario: str | Scenario = "experiment",
        num_envs: int = 1,
        *,
        device: Any = "cpu",
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        discrete_actions: bool = False,
        threads: int | None = None,
        **overrides: Any,
    ):
        modes = {mode.name: mode for mode in AutoresetMode}
        name = autoreset_mode.name if isinstance(autoreset_mode, AutoresetMode) else autoreset_mode
        if name not in modes:
            raise ValueError(f"autoreset_mode must be one of {', '.join(modes)}, got {autoreset_mode!r}")
        self.autoreset_mode = modes[name]
        made = library.scenario(scenario, **overrides)
        self.simulation = Simulation(made, num_envs, device=device, threads=threads)
        self.scenario = self.simulation.scenario
        self.num_envs = num_envs
        self.metadata = {"autoreset_mode": self.autoreset_mode, "render_modes": []}
        self._table = action_table(self.scenario) if discrete_actions else None
        self.single_observation_space, self.single_action_space = _team_spaces(self.simulation, discrete_actions)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._ended = np.zeros(num_envs, dtype=bool)
        self._started = False

    def reset(
        self, *, seed: int | list[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin an episode in every world, or in those of `options["reset_mask"]` (bool, (num_envs,)).

        A whole number as `seed` gives world k the seed + k; a list gives each its own.
        """
        mask = (options or {}).get("reset_mask")
        if mask is None:
            worlds = np.arange(self.num_envs)
        elif np.shape(mask) == (self.num_envs,) and np.asarray(mask).dtype == bool:
            worlds = np.flatnonzero(mask)
        else:
            raise ValueError(f"reset_mask must be bool of shape ({self.num_envs},), got {mask!r}")
        if isinstance(seed, (int, np.integer)):
            self.simulation.reset(worlds, [fold_seed(int(seed) + int(k)) for k in worlds])
        elif seed is not None:
            if np.shape(seed) != (self.num_envs,):
                raise ValueError(f"seed must be a number or one for each of the {self.num_envs} worlds, got {seed!r}")
            self.simulation.reset(worlds, [fold_seed(seed[k]) for k in worlds])
        else:
            self.simulation.reset(worlds)
        self._ended[worlds] = False
        self._started = True
        return self._observed(), {}

    def step(self, actions: Any) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Take a step in every world; worlds that ended are reset as `autoreset_mode` says."""
        if not self._started:
            raise ResetNeeded("step needs a running episode: call reset first")
        if self._table is not None:
            actions = self._looked_up(actions, self._table)
        sim, infos = self.simulation, {}
        begins = self._ended & (self.autoreset_mode is AutoresetMode.NEXT_STEP)
        sim.step(actions)
        if begins.any():
            # A world that ended stood still in the step above; what it returns is its new beginning.
            sim.reset(begins)
        robot_reward = sim.reward.numpy().copy()
        terminated = sim.terminated.numpy().all(axis=1)
        truncated = sim.truncated.numpy().any(axis=1) & ~terminated
        ended = sim.over
        infos["reward"], infos["_reward"] = robot_reward, np.ones(self.num_envs, dtype=bool)
        newly = ended & ~self._ended
        if newly.any():
            scores = np.full(self.num_envs, None, dtype=object)
            scores[newly] = sim.score(newly)
            infos["score"], infos["_score"] = scores, newly
        self._ended = ended.copy()
        if newly.any() and self.autoreset_mode is AutoresetMode.SAME_STEP:
            final = np.full(self.num_envs, None, dtype=object)
            sim.reset(newly)
            last = sim.final_observation.numpy()
            for k in np.flatnonzero(newly):
                final[k] = last[k].copy()
            infos["final_obs"], infos["_final_obs"] = final, newly
            infos["final_info"] = {"score": infos.pop("score"), "_score": infos.pop("_score")}
            infos["_final_info"] = newly
            self._ended[:] = False
        return self._observed(), robot_reward.mean(axis=1), terminated, truncated, infos

    def _looked_up(self, actions: Any, table: np.ndarray) -> np.ndarray:
        rows, shape, last = np.asarray(actions), (self.num_envs, self.simulation.num_robots), len(table) - 1
        if rows.shape != shape or rows.dtype.kind not in "iu" or rows.min() < 0 or rows.max() > last:
            raise ValueError(f"actions must be whole numbers from 0 to {last} of shape {shape}, got {actions!r}")
        return table[rows]

    def _observed(self) -> np.ndarray:
        host = self.simulation.observation.numpy()
        return host.copy() if self.simulation.device.is_cpu else host


class LissajousEnv(gymnasium.Env):
    """One world as a `gymnasium.Env`; the agent is the team, as in `LissajousVectorEnv`.

    The info holds `reward` (N,), `reward_terms` (N, 7) and, when the episode ends, `score`.
    """

    metadata = LissajousParallelEnv.metadata

    def __init__(self, scenario: str | Scenario = "experiment", render_mode: str | None = None, **settings: Any):
        self.parallel = LissajousParallelEnv(scenario, render_mode, **settings)
        self.render_mode = render_mode
        self.scenario = self.parallel.scenario
        discrete = settings.get("discrete_actions", False)
        self.observation_space, self.action_space = _team_spaces(self.parallel.simulation, discrete)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        """Begin an episode."""
        super().reset(seed=seed)
        observations, infos = self.parallel.reset(seed, options)
        return self._observed(), self._info(dict.fromkeys(observations, 0.0), infos)

    def step(self, action: Any) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Take one control step with the actions of all robots, (N, action_size) or, discrete, (N,)."""
        if np.shape(action)[:1] != (self.scenario.num_robots,):
            raise ValueError(f"action must have a row for each of {self.scenario.num_robots} robots, got {action!r}")
        rows = dict(zip(self.parallel.possible_agents, action, strict=True))
        live = {agent: rows[agent] for agent in self.parallel.agents}
        _, rewards, _, _, infos = self.parallel.step(live)
        info = self._info(rewards, infos)
        over = not self.parallel.agents
        terminated = bool(self.parallel.simulation.terminated.numpy().all())
        if over:
            info["score"] = self.parallel.score()
        return self._observed(), float(info["reward"].mean()), terminated, over and not terminated, info

    def render(self) -> Any:
        """Draw the world, as `LissajousParallelEnv.render`."""
        return self.parallel.render()

    def close(self) -> None:
        """Close the window, if there is one."""
        self.parallel.close()

    def _observed(self) -> np.ndarray:
        return self.parallel.simulation.observation.numpy()[0].copy()

    def _info(self, rewards: dict[str, float], infos: dict[str, dict]) -> dict[str, Any]:
        agents = self.parallel.possible_agents
        nothing = np.zeros(len(TERMS), np.float32)
        terms = [infos[agent]["reward_terms"] if agent in infos else nothing for agent in agents]
        reward = np.array([rewards.get(agent, 0.0) for agent in agents], dtype=np.float32)
        return {"reward": reward, "reward_terms": np.stack(terms)}


def vector_env(scenario: str | Scenario = "experiment", num_envs: int = 1, **settings: Any) -> LissajousVectorEnv:
    """Make the Gymnasium `VectorEnv` of a scenario; see `LissajousVectorEnv` for the settings."""
    return LissajousVectorEnv(scenario, num_envs, **settings)
