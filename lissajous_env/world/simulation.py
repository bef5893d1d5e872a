"""The simulation: a batch of worlds of one scenario, on one device."""

from typing import Any, cast

import numpy as np
import warp as wp

from lissajous_env.device.copies import Copyable
from lissajous_env.device.devices import as_device, compile_quietly, copy_in, cores
from lissajous_env.device.locks import Turn, in_turn
from lissajous_env.device.program import Program, Stage
from lissajous_env.device.stage import ARRAY, BIN, FIELD_ROW, ROBOT, ROW, TARGET
from lissajous_env.device.work import task_count
from lissajous_env.parameters import named
from lissajous_env.parameters.extensions import RewardTerm
from lissajous_env.parameters.rogues import AGENTS
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.settings.checks import LAST_SEED, is_whole, whole_number
from lissajous_env.wording import require
from lissajous_env.world.clock import initial_of
from lissajous_env.world.columns import number_names, plain, score_of
from lissajous_env.world.episode import episodes_of
from lissajous_env.world.extension_stages import ExtensionStages
from lissajous_env.world.observation import Layout, layout
from lissajous_env.world.robots.nearby import bins_of
from lissajous_env.world.selection import checked_seeds, chosen_worlds, world_mask
from lissajous_env.world.stages import stages_of
from lissajous_env.world.state import RUNNING
from lissajous_env.world.tally import TERMS
from lissajous_env.world.values import constants_of, state_of

_ROBOT_WORK, _TARGET_WORK = 500, 40
"""Rough time that a robot and a target add to a step [ns], from which the number of threads is computed."""
_TASK_WORK = 100_000
"""Time of a step below which waking a thread for it does not pay [ns]."""


class Simulation(Copyable):
    """A batch of worlds of one scenario.

    Attributes (Warp arrays on the device, the same objects for the life of the simulation; W worlds, N robots):
        observation: (W, N, D) float32, one row per robot; `lissajous_env.world.observation` documents the entries.
        final_observation: (W, N, D) rows at the end of each world's previous episode.
        reward: (W, N) float32; `reward_terms` (W, N, terms) contains its terms, named by `reward_term_names`.
        score_names: Names of the numbers in a row of `score_numbers`.
        speed_unit: Unit of observed speeds [m/s].
        terminated: (W, N) bool, robots that a collision or the edge of the rectangle removed.
        truncated: (W, N) bool, True when the time is over.
        action: `action_shape`, the actions of the next step, as `step` and `take` store them.
        limited_action: `action_shape`, the actions of the latest step, clipped; zeros where one was not finite.
        invalid: (W,) int32, 1 where an action of the episode was not finite and was replaced by zero.
        invalid_at: (W,) int32, the step in which that happened first, counted from 1; 0 for none.
        rogues: State of the rogues, among it `observation` and `action`; None without `targets.rogues`.

    World k depends on its own seed and actions alone: it is the same, bit for bit, in any batch, on any number of
    threads. A world whose episode has ended does not move, with reward 0, until it is reset. Write into copies of
    `observation` alone: a step clears the slots of a row only up to the first empty one, because those after it are.

    Args:
        scenario: Name of a scenario, or a `Scenario`.
        num_worlds: W.
        device: `cpu`, `cuda` or `cuda:k`.
        seed: Seed of world 0; world k has seed + k.
        threads: CPU threads that share the worlds of a large batch; by default all cores that the process may use.
        **overrides: Fields of the scenario, as in `lissajous_env.scenario`.

    Raises:
        ValueError: the number of worlds is below 1 or exceeds the device's memory, the device is not available, or the
            seed is out of range.
    """

    clock: Any
    robots: Any
    links: Any
    messages: Any
    targets: Any
    tracks: Any
    cells: Any
    contamination: Any
    latest: Any
    tally: Any

    def __init__(
        self,
        scenario: str | Scenario,
        num_worlds: int = 1,
        device: Any = "cpu",
        seed: int = 0,
        threads: int | None = None,
        **overrides: Any,
    ):
        fits = threads is None or (is_whole(threads) and threads >= 1)
        require(fits, "threads", "must be a whole number of at least 1 or None", threads)
        seed = whole_number("seed", seed, 0, LAST_SEED)
        is_made = isinstance(scenario, Scenario) and not overrides  # it has given its warnings already
        self.scenario = (cast(Scenario, scenario) if is_made else named.scenario(scenario, **overrides)).resolve()
        self.num_worlds = whole_number("num_worlds", num_worlds)
        self.device = as_device(device)
        self.threads = threads or cores()
        self.turn = Turn("the simulation")
        self.layout: Layout = layout(self.scenario)
        added = [extension.name for extension in self.scenario.extensions if isinstance(extension, RewardTerm)]
        self.reward_term_names = (*TERMS, *added)
        self.score_names = number_names(self.scenario)
        self._allocate()
        with compile_quietly():
            self._build()
            self.reset(seeds=seed + np.arange(self.num_worlds))

    @property
    def stages(self) -> Program:
        """Stages of a step; `print(simulation.stages)` lists each with its arguments and what it writes."""
        return self._step

    @property
    def num_robots(self) -> int:
        """N."""
        return self.scenario.num_robots

    @property
    def action_shape(self) -> tuple[int, int, int]:
        """(W, N, A): numbers in [-1, 1], named by `scenario.action_names`, for the motion and then for the message."""
        return self.num_worlds, self.num_robots, self.scenario.action_size

    @in_turn
    def reset(self, worlds: Any = None, seeds: Any = None) -> wp.array:
        """Begin a new episode in some worlds; the others are unchanged.

        Args:
            worlds: (W,) mask or indices of the worlds, each once; all by default.
            seeds: A seed for each of these worlds, whole numbers from 0 to 2^31 - 1; by default each world draws its
                next seed from its last.

        Returns:
            The observation of all worlds.
        """
        chosen = chosen_worlds(worlds, self.num_worlds)
        new_seeds = np.full(self.num_worlds, -1, dtype=np.int32)
        if seeds is not None:
            new_seeds[chosen] = checked_seeds(seeds, len(chosen))
        self._seeds.assign(new_seeds)
        self.clock.fresh.assign(world_mask(chosen, self.num_worlds).astype(np.int32))
        self._reset()
        self.clock.fresh.zero_()
        return self.observation

    @in_turn
    def step(self, action: Any, rogue_action: Any = None) -> tuple[wp.array, wp.array, wp.array, wp.array]:
        """Advance every world whose episode is running by one control step.

        Args:
            action: `action_shape`, a NumPy array, torch tensor or Warp array of numbers in [-1, 1]; values outside are
                clipped. If a number is not finite, that robot's action is replaced by zero and the world is flagged in
                `invalid`.
            rogue_action: (W, T, 2) the same for rogues, where `targets.rogues` is `agents`.

        Returns:
            observation, reward, terminated, truncated: the arrays of these names.

        Raises:
            ValueError: an action has another shape, does not contain real numbers, or is missing, or there is one for
                rogues that the scenario does not have.
        """
        self._take(action, rogue_action)
        self._step()
        return self.observation, self.reward, self.terminated, self.truncated

    @in_turn
    def take(self, action: Any, rogue_action: Any = None) -> None:
        """Store the actions of the next step, as `step` accepts them; `advance` then simulates the step.

        Raises:
            ValueError: as of `step`.
        """
        self._take(action, rogue_action)

    @in_turn
    def advance(self) -> None:
        """Advance by one control step with the actions that the caller has written into `action`.

        The actions of rogues that are agents must be in `rogues.action`.
        """
        self._step()

    def score(self, worlds: Any = None) -> list[dict[str, Any]]:
        """Return the score row of the latest episode so far of the worlds of a mask or indices, or of all.

        Its entries are those of `lissajous_env.world.columns.NAMES` except `policy` and `episode`, then those of
        extensions.
        """
        chosen, added = chosen_worlds(worlds, self.num_worlds), self._extended.columns(self.clock.step.numpy())
        return [
            score_of(episode) | {name: plain(values[w]) for name, values in added.items()}
            for w, episode in zip(chosen, episodes_of(self.scenario, self._structs, chosen), strict=True)
        ]

    def score_numbers(self, worlds: Any) -> np.ndarray:
        """Return the scores (W, numbers) of the worlds of a mask or indices, named by `score_names`.

        The rows of other worlds are infinite instead of NaN, so that environment checkers consider equal infos equal.
        """
        chosen = chosen_worlds(worlds, self.num_worlds)
        numbers = np.full((self.num_worlds, len(self.score_names)), np.inf)
        if len(chosen):
            numbers[chosen] = [[row[name] for name in self.score_names] for row in self.score(chosen)]
        return numbers

    def detection_times(self, world: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """Return times (K,) from each target's appearance until its detection or now [s], and True (K,) if detected."""
        (episode,) = episodes_of(self.scenario, self._structs, chosen_worlds([world], self.num_worlds))
        return episode.times, episode.targets.detected[episode.targets.appeared]

    @property
    def over(self) -> np.ndarray:
        """(W,) bool on the host: worlds whose episode has ended."""
        return self.clock.status.numpy() != RUNNING

    def _allocate(self) -> None:
        w, n, k = self.num_worlds, self.num_robots, self.scenario.messages.size
        self._structs = state_of(self.scenario, w, self.layout.size, len(self.reward_term_names), self.device)
        self.__dict__.update(self._structs)
        self.rogues: Any = self._structs.get("rogues")
        self.action = wp.zeros(self.action_shape, dtype=wp.float32, device=self.device)
        self.command = wp.zeros((w, n, self.action_shape[2] - k), dtype=wp.float32, device=self.device)
        self.limited_action = wp.zeros_like(self.action)
        # On a CPU, the same memory as `action`; elsewhere empty, so that no action has its shape.
        self._action_host = self.action.numpy() if self.device.is_cpu else np.empty(0, dtype=np.float32)
        self.observation = wp.zeros((w, n, self.layout.size), dtype=wp.float32, device=self.device)
        self.final_observation = wp.zeros_like(self.observation)
        self._seeds = wp.zeros(w, dtype=wp.int32, device=self.device)  # of a reset; -1 where it draws the seed
        self.reward, self.reward_terms = self.latest.reward, self.latest.terms
        self.terminated, self.truncated = self.latest.terminated, self.latest.truncated
        self.invalid, self.invalid_at = self.clock.invalid, self.clock.invalid_at

    def _build(self) -> None:
        """Bind the stages of a reset and of a step to the arrays."""
        constants = constants_of(self.scenario, self.device)
        self.speed_unit = constants["speed_unit"]
        values = constants | self._structs | {"seeds": self._seeds, "limited_action": self.limited_action}
        values |= {name: getattr(self, name) for name in ("action", "command", "observation", "final_observation")}
        values["initial"] = initial_of(self._structs, self.device)
        shape = self.num_worlds, self.num_robots, self.scenario.sensing.most_seen
        # Squared distance and index of the objects that a robot observes, the nearest first.
        values["nearest"] = wp.zeros(shape, dtype=wp.vec2, device=self.device)
        sizes = {ROBOT: self.num_robots, TARGET: self.targets.status.shape[1], ROW: self.cells.idle_max.shape[1]}
        sizes |= {FIELD_ROW: self.contamination.row_ages.shape[1], ARRAY: len(values["initial"].size)}
        work = self.num_robots * _ROBOT_WORK + sizes[TARGET] * _TARGET_WORK
        tasks = min(self.num_worlds * work // _TASK_WORK, self.num_worlds)
        values["bins"] = bins = bins_of(self.scenario, self.speed_unit, self.num_worlds, self.device)
        sizes[BIN] = bins.columns * bins.rows
        launch = self.num_worlds, self.device, task_count(tasks, self.device, self.threads), self.threads
        self._extended = ExtensionStages(self.scenario, self._structs, self.observation)
        self._reset, self._step = (
            Program(self._extended.among(self._own_stages(begins), begins), values, sizes, *launch)
            for begins in (True, False)
        )

    def _own_stages(self, begins: bool) -> list[Stage]:
        """Return the stages of a step, or of the reset that `begins` an episode, without those of extensions."""
        return stages_of(self.scenario, self.rogues, begins)

    def _take(self, action: Any, rogue_action: Any) -> None:
        needed, given = self.scenario.targets.rogues == AGENTS, rogue_action is not None
        if needed or given:
            rule = f"must be given if, and only if, targets.rogues is {AGENTS}"
            require(needed and given, "rogue_action", rule, rogue_action)
            copy_in("rogue_action", rogue_action, self.rogues.action)
        if type(action) is np.ndarray and action.dtype == np.float32 and action.shape == self._action_host.shape:
            self._action_host[:] = action
        else:
            copy_in("action", action, self.action)
