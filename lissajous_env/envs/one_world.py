"""Parts of the environments of one world: drawing, replays, scores, and their specification for Gymnasium."""

import copy
from typing import TYPE_CHECKING, Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec

from lissajous_env.envs.batch import Batch
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import shown
from lissajous_env.world.selection import fold_seed
from lissajous_env.world.simulation import Simulation

if TYPE_CHECKING:
    from lissajous_env.episodes.recording import Follower
    from lissajous_env.replay import Replay

NEEDS_RESET = "step needs a running episode: call reset first"
METADATA = {
    "name": "lissajous_v0",
    "render_modes": ["rgb_array", "human"],
    "render_fps": 10,
    "is_parallelizable": True,
}


class OneWorld:
    """Part of an environment of a batch of one world.

    Attributes:
        batch: The batch.
        scenario: Scenario of the episode; of a space, before the first reset, the first one of the split.
        simulation: World of the episode; of a space, each reset makes another one.
    """

    batch: Batch
    render_mode: str | None

    def _start(self, batch: Batch, render_mode: str | None, record: bool) -> None:
        """Use a batch, and check the settings of drawing and recording."""
        known = isinstance(render_mode, str) and render_mode in METADATA["render_modes"]
        if render_mode is not None and not known:
            raise ValueError(f"render_mode must be None, rgb_array or human, got {shown(render_mode)}")
        self.batch, self.render_mode, self._record = batch, render_mode, record
        self._renderer: Any = None
        self._use_simulation()

    def _use_simulation(self) -> None:
        self.simulation: Simulation = self.batch.simulation
        self.scenario: Scenario = self.simulation.scenario
        self._follower = followed(self.simulation, 0 if self._record else None)
        self.close()

    def _begin(self, seed: int | None) -> None:
        """Begin an episode with a seed, or with one that follows from the previous seed."""
        self.batch.seed(None if seed is None else fold_seed(seed))
        self.batch.reset()
        if self.simulation is not self.batch.simulation:
            self._use_simulation()
        if self._follower is not None:
            self._follower.look()
        if self._renderer is not None:
            self._renderer.reset()

    @property
    def score_names(self) -> tuple[str, ...]:
        """Names of the numbers in `score` of an info of Gymnasium."""
        return self.simulation.score_names

    def score(self) -> dict[str, Any]:
        """Return the score of the episode so far, with the columns of `lissajous_env.world.columns.NAMES`.

        Of a space, it also contains the name of the `scenario`.
        """
        return self.batch.score(np.ones(1, dtype=bool))[0]

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
        self._renderer.show(METADATA["render_fps"])
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


class Timed:
    """Part of a Gymnasium environment: its `spec` states the number of steps of an episode, which ends by itself."""

    _steps: int | None = None
    """Number of steps of an episode; None if it varies."""
    _spec: EnvSpec | None = None

    @property
    def spec(self) -> EnvSpec | None:
        """Specification by which `gymnasium.make` made the environment."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = copy.copy(spec)
        if self._spec is not None and self._steps is not None:
            self._spec.max_episode_steps = self._steps


def followed(simulation: Simulation, world: int | None) -> "Follower | None":
    """Return a recorder of a world of a simulation, or None for no world.

    Raises:
        ValueError: there is no such world.
    """
    if world is None:
        return None
    if isinstance(world, bool) or not isinstance(world, int) or not 0 <= world < simulation.num_worlds:
        raise ValueError(f"record must be None or a world from 0 to {simulation.num_worlds - 1}, got {shown(world)}")
    from lissajous_env.episodes.recording import Follower

    return Follower(simulation, world)


def replay_of(follower: "Follower | None", policy: str, how: str, ended: bool = False) -> "Replay":
    """Return the current episode as a page or, if `ended`, the latest complete one if there is one.

    Raises:
        ValueError: nothing was recorded; the message contains `how` to enable it.
    """
    if follower is None:
        raise ValueError(f"replay requires an environment that was made with {how}")
    from lissajous_env.replay import Replay

    return Replay(follower.recording(policy, ended))
