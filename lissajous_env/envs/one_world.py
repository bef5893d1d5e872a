"""Base classes of the environments of one world: drawing, scores, and the specification for Gymnasium."""

import copy
from typing import Any

import gymnasium
import numpy as np
from gymnasium.envs.registration import EnvSpec

from lissajous_env.envs.batch import Batch
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import require
from lissajous_env.world.selection import fold_seed
from lissajous_env.world.simulation import Simulation

METADATA = {
    "name": "lissajous_v0",
    "render_modes": ["rgb_array", "human"],
    "render_fps": 10,
    "is_parallelizable": True,
}


class OneWorld:
    """Base of an environment whose batch has one world.

    Attributes:
        batch: The batch.
        scenario: Scenario of the episode; with a space, the first one of the split until the first reset.
        simulation: Simulation of the episode; with a space, each reset makes another one.
    """

    batch: Batch
    render_mode: str | None

    def _set_batch(self, batch: Batch, render_mode: str | None) -> None:
        """Set the batch, and check `render_mode`; subclasses call it at the end of `__init__`."""
        fits = render_mode is None or (isinstance(render_mode, str) and render_mode in METADATA["render_modes"])
        require(fits, "render_mode", "must be None, rgb_array or human", render_mode)
        self.batch, self.render_mode = batch, render_mode
        self._renderer: Any = None
        self._use_simulation()

    def _use_simulation(self) -> None:
        self.simulation: Simulation = self.batch.simulation
        self.scenario: Scenario = self.simulation.scenario
        self.close()

    def _begin(self, seed: int | None) -> None:
        """Begin an episode with a seed, or with one that follows from the previous seed."""
        self.batch.seed(None if seed is None else fold_seed(seed))
        self.batch.reset()
        if self.simulation is not self.batch.simulation:
            self._use_simulation()
        if self._renderer is not None:
            self._renderer.reset()

    def score(self) -> dict[str, Any]:
        """Return the score of the episode so far, with the columns of `lissajous_env.world.columns.NAMES`."""
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

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without the renderer, because pictures and windows cannot be pickled."""
        return self.__dict__ | {"_renderer": None}

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None


class Timed:
    """Base of a Gymnasium environment that ends its episodes itself: its `spec` states their number of steps."""

    simulation: Simulation
    _steps: int | None = None
    """Number of steps of an episode; None if it varies."""
    _spec: EnvSpec | None = None

    @property
    def score_names(self) -> tuple[str, ...]:
        """Names of the numbers in `score` of the infos."""
        return self.simulation.score_names

    @property
    def spec(self) -> EnvSpec | None:
        """Specification by which `gymnasium.make` made the environment."""
        return self._spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self._spec = copy.copy(spec)
        if self._spec is not None and self._steps is not None:
            self._spec.max_episode_steps = self._steps
