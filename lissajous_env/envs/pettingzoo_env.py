"""The PettingZoo environment of one world, with one agent per robot."""

import operator
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np

from lissajous_env.envs.actions import LARGE, ActionReader, action_space, action_table, check_agents
from lissajous_env.envs.agents import SpacesOfAgents, nothing_done
from lissajous_env.envs.recorded import followed, replay_of
from lissajous_env.envs.true_state import state_names, state_rows
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import shown
from lissajous_env.world.selection import drawn_seeds
from lissajous_env.world.simulation import Simulation, fold_seed

if TYPE_CHECKING:
    from lissajous_env.replay import Replay


class LissajousParallelEnv(SpacesOfAgents):
    """Robots that monitor a rectangle and detect targets, as a PettingZoo `ParallelEnv`.

    The agents are `robot_0` ... A failed robot remains an agent: it still observes, with `works` at 0 and actions
    without effect. Agents are terminated only if `task.on_collision` or `task.boundary` is `remove`. Every episode is
    truncated after `task.duration`. Without a seed, every run starts with a different random episode.
    Where `targets.rogues` is `agents`, these are the robots alone, and the caller writes the rogues' actions into
    `simulation.rogue_action`; `lissajous_env.parallel_env` makes an environment of both sides.
    `lissajous_env.world.observation` describes the observation. The reward of an agent is the sum of the terms in
    `reward_terms` of its info, in the order of `lissajous_env.world.reward.TERMS`.

    Args:
        scenario: Name of a scenario, or a `Scenario`.
        render_mode: None, `rgb_array`, or `human` for a window.
        discrete_actions: True for actions that are indices of `lissajous_env.envs.actions.action_table`.
        max_cycles: Number of steps of an episode, instead of `task.duration`.
        device: Warp device.
        record: True to record episodes for `replay`; a step takes up to 1 ms longer.
        **overrides: Fields of the scenario, as in `lissajous_env.parameters.scenario`.

    Raises:
        UnknownSettingError: an unknown keyword (a `ValueError` and a `TypeError`).
        ValueError: an invalid setting.
    """

    metadata = {  # noqa: RUF012 - PettingZoo declares it so
        "name": "lissajous_v0",
        "render_modes": ["rgb_array", "human"],
        "render_fps": 10,
        "is_parallelizable": True,
    }

    def __init__(
        self,
        scenario: str | Scenario = "experiment",
        render_mode: str | None = None,
        *,
        discrete_actions: bool = False,
        max_cycles: int | None = None,
        device: Any = "cpu",
        record: bool = False,
        **overrides: Any,
    ):
        known = isinstance(render_mode, str) and render_mode in self.metadata["render_modes"]
        if render_mode is not None and not known:
            raise ValueError(f"render_mode must be None, rgb_array or human, got {shown(render_mode)}")
        made = self._changed(scenario, max_cycles, overrides)
        self.render_mode = render_mode
        self.simulation = Simulation(made, num_worlds=1, device=device)
        self.scenario = self.simulation.scenario
        self.possible_agents = [f"robot_{i}" for i in range(self.scenario.num_robots)]
        self.agents: list[str] = []
        self._begun = False
        layout = self.simulation.layout
        self.observation_spaces = {
            agent: gymnasium.spaces.Box(layout.low, layout.high, dtype=np.float32) for agent in self.possible_agents
        }
        self.action_spaces = {agent: action_space(self.scenario, discrete_actions) for agent in self.possible_agents}
        self.state_space = gymnasium.spaces.Box(-np.inf, np.inf, (len(state_names(self.scenario)),), np.float32)
        self._discrete_actions = discrete_actions
        self._follower = followed(self.simulation, 0 if record else None)
        self._bind()

    def reset(self, seed: int | None = None, options: dict | None = None) -> tuple[dict, dict]:
        """Begin an episode with the given seed, or with one that follows from the previous seed.

        Without a seed, that of the first episode comes from the operating system; `score()["seed"]` contains it.
        """
        if seed is not None:
            self.simulation.reset(seeds=[fold_seed(seed)])
        elif not self._begun:
            self.simulation.reset(seeds=drawn_seeds(1))
        else:
            self.simulation.reset()
        self._seed_wrappers(seed)
        self._begun = True
        self.agents = list(self.possible_agents)
        if self._follower is not None:
            self._follower.look()
        self._begin_rendering()
        if self._on_device:
            self._fetch()
        observations = dict(zip(self.agents, self._observation.copy(), strict=True))
        infos = {agent: {"reward_terms": row} for agent, row in zip(self.agents, self._terms.copy(), strict=True)}
        return observations, infos

    def step(self, actions: dict[str, Any]) -> tuple[dict, dict, dict, dict, dict]:
        """Take one control step with an action for each live agent; numbers outside [-1, 1] are clipped.

        After the end of an episode, a step without actions returns empty dicts.

        Raises:
            ResetNeeded: before the first reset, or with actions after the end of an episode.
            ValueError: an agent is missing or unknown, or an action has a wrong shape or is not finite; the state is
                unchanged.
        """
        agents = self.agents
        if not agents:
            return nothing_done(self._begun, actions)
        if not self._read_at_once(actions):
            self._read(actions)
        if self._on_device:
            self.simulation.action.assign(self._action.reshape(self.simulation.action_shape))
        self.simulation.advance()
        if self._follower is not None:
            self._follower.look()
        if self._on_device:
            self._fetch()
        observation, terms = self._observation.copy(), self._terms.copy()
        rewards, terminated, truncated = self._reward.tolist(), self._terminated.tolist(), self._truncated.tolist()
        infos = [{"reward_terms": row} for row in terms]
        if len(agents) < len(self.possible_agents):
            live = [self._index[agent] for agent in agents]
            observation, rewards, terminated, truncated, infos = (
                [column[i] for i in live] for column in (observation, rewards, terminated, truncated, infos)
            )
        # The lengths are equal; a strict zip would double the time.
        results = (
            dict(zip(agents, observation)),  # noqa: B905
            dict(zip(agents, rewards)),  # noqa: B905
            dict(zip(agents, terminated)),  # noqa: B905
            dict(zip(agents, truncated)),  # noqa: B905
            dict(zip(agents, infos)),  # noqa: B905
        )
        if True in terminated or truncated[0]:
            self.agents = [agent for agent in agents if not (results[2][agent] or results[3][agent])]
        if self.render_mode == "human":
            self.render()
        return results

    def score(self) -> dict[str, Any]:
        """Return the score of the episode so far, with the columns of `lissajous_env.world.columns.NAMES`."""
        return self.simulation.score()[0]

    def state(self) -> np.ndarray:
        """Return the true state of the world, for centralized critics; see `lissajous_env.envs.true_state`."""
        return state_rows(self.simulation)[0]

    def render(self) -> np.ndarray | None:
        """Draw the world: return (H, W, 3) uint8 for `rgb_array`, or open a window and return None for `human`."""
        if self.render_mode is None:
            gymnasium.logger.warn("render was called on an environment without a render_mode")
            return None
        if self._renderer is None:
            from lissajous_env.render import Renderer

            self._renderer = Renderer(self.scenario)
        frame = self._renderer.draw(self.simulation)
        if self.render_mode == "rgb_array":
            return frame
        self._renderer.show(self.metadata["render_fps"])
        return None

    def replay(self, policy: str = "") -> "Replay":
        """Return the episode so far as a page, which notebooks display and `save` writes to a file.

        Args:
            policy: Name of the policy, for the page.

        Raises:
            ValueError: the environment was made without `record=True`, or there was no reset yet.
        """
        return replay_of(self._follower, policy, "record=True")

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None

    def _changed(self, scenario: str | Scenario, max_cycles: int | None, overrides: Mapping[str, Any]) -> Scenario:
        """Return the scenario with its fields overridden."""
        return named.with_cycles(named.scenario(scenario, **overrides), max_cycles)

    def _bind(self) -> None:
        """Set up the arrays of a step, which on the CPU are views of the simulation's memory."""
        sim, count = self.simulation, len(self.possible_agents)
        self._index = {agent: i for i, agent in enumerate(self.possible_agents)}
        table = action_table(self.scenario) if self._discrete_actions else None
        self._reader = ActionReader(self.scenario.action_size, table)
        self._rows = np.zeros(sim.action_shape[1:])  # float64, to clip values beyond float32
        self._on_device = not sim.device.is_cpu
        self._fetch()
        self._action = sim.action.numpy().reshape(-1)
        self._pick = operator.itemgetter(*self.possible_agents) if count > 1 and not self._discrete_actions else None
        self._shapes = [sim.action_shape[2:]] * count
        self._renderer = None

    def _read_at_once(self, actions: Any) -> bool:
        """Copy regular actions, one float32 array per agent; return False if the actions need individual checks."""
        if self._pick is None or type(actions) is not dict or len(actions) != len(self.agents):
            return False
        try:
            rows = self._pick(actions)
            np.concatenate(rows, out=self._action, casting="no")
            regular = [row.shape for row in rows] == self._shapes
        except (KeyError, TypeError, ValueError, AttributeError, RuntimeError):
            return False
        # The sum of squares is not finite if any number is not.
        return regular and bool(self._action.dot(self._action) < LARGE)

    def _read(self, actions: Any) -> None:
        """Check and copy the actions one by one.

        Raises:
            ValueError: an agent is missing or unknown, or an action has a wrong shape or is not finite.
        """
        check_agents(actions, self.agents)
        self._rows[:] = 0.0
        for agent in self.agents:
            self._reader.read(agent, actions[agent], self._rows[self._index[agent]])
        self._reader.check(self.possible_agents, self._rows)
        self._action[:] = self._rows.ravel()

    def _fetch(self) -> None:
        """Copy the results of a step to the host; on the CPU they are views of the simulation's memory."""
        sim = self.simulation
        arrays = sim.observation, sim.reward, sim.reward_terms, sim.terminated, sim.truncated
        self._observation, self._reward, self._terms, self._terminated, self._truncated = (
            array.numpy()[0] for array in arrays
        )

    def _begin_rendering(self) -> None:
        if self._renderer is not None:
            self._renderer.reset()
        if self.render_mode == "human":
            self.render()

    def __getstate__(self) -> dict[str, Any]:
        bound = (
            "_observation",
            "_reward",
            "_terminated",
            "_truncated",
            "_terms",
            "_renderer",
            "_reader",
            "_action",
            "_pick",
        )
        return {name: value for name, value in self.__dict__.items() if name not in bound}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        self.__dict__.update(saved)
        self._bind()
