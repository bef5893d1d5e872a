"""The simulation: a batch of worlds of one scenario, stepped together on one device."""

import os
from collections.abc import Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.curve import CurveStruct
from lissajous_env.device.devices import as_device, check_room, compile_quietly, copy_in, side_by_side
from lissajous_env.device.structs import to_struct
from lissajous_env.parameters import named
from lissajous_env.parameters.checks import is_whole
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.theory import closed_forms
from lissajous_env.wording import shown
from lissajous_env.world.collisions import COUNT, ON_COLLISION, REMOVE, find_collisions
from lissajous_env.world.coverage import cover, reset_cells
from lissajous_env.world.distance import table_of
from lissajous_env.world.faults import FaultsStruct, removal_steps, reset_losses, schedule_steps
from lissajous_env.world.observation import Layout, Scales, layout, observe
from lissajous_env.world.reward import TERMS, TaskStruct
from lissajous_env.world.robots import FormationStruct, NoiseStruct, RobotStruct, move_cars, move_points, reset_robots
from lissajous_env.world.score import score_rows
from lissajous_env.world.selection import chosen_worlds, whole_number
from lissajous_env.world.state import RUNNING, Cells, Clock, Links, Robots, Rogues, Step, Tally, allocate
from lissajous_env.world.tally import keep_score, reset_clock, reset_tally
from lissajous_env.world.targets import TargetsStruct, move_targets, reset_arrivals, reset_targets

_START = {"equilibrium": 0, "rotated": 1, "random": 2}
_BLOCK = 256
"""Worlds below which a CPU thread of its own costs more than it saves."""
_LAST_SEED = 2**31 - 1
_ROGUE_BYTES = 32


class Simulation:
    """A batch of worlds of one scenario.

    Attributes (Warp arrays on the device, the same objects for the life of the simulation; W worlds, N robots):
        observation: (W, N, D) float32, one row a robot; `lissajous_env.world.observation` documents the entries.
        final_observation: (W, N, D) the rows with which each world's episode before ended.
        reward: (W, N) float32; `reward_terms` (W, N, 7) holds its terms, named by `reward_term_names`.
        terminated: (W, N) bool, robots that a collision or the edge of the rectangle removed.
        truncated: (W, N) bool, True when the time is over.
        invalid: (W,) int32, 1 where an action of the episode was not finite and zero was taken instead.
        invalid_at: (W,) int32, the step in which that happened first, counted from 1; 0 for none.

    World k depends on its own seed and actions alone: it is the same, bit for bit, in any batch, on any number of
    threads. A world whose episode has ended stands still, with reward 0, until it is reset.

    Args:
        scenario: What to simulate: a scenario, or the name of one.
        num_worlds: W.
        device: `cpu`, `cuda` or `cuda:k`.
        seed: Seed of world 0; world k has seed + k.
        threads: CPU threads over which a large batch is split; all cores by default.

    Raises:
        ValueError: a number of worlds below 1 or of more than the device's memory holds, a device that is not there,
            or a seed out of range.
    """

    def __init__(
        self,
        scenario: str | Scenario,
        num_worlds: int = 1,
        device: Any = "cpu",
        seed: int = 0,
        threads: int | None = None,
    ):
        if threads is not None and not (is_whole(threads) and threads >= 1):
            raise ValueError(f"threads must be a whole number of at least 1 or None, got {shown(threads)}")
        if not is_whole(seed) or not 0 <= seed <= _LAST_SEED:
            raise ValueError(f"seed must be a whole number from 0 to {_LAST_SEED}, got {shown(seed)}")
        self.scenario = named.scenario(scenario).resolve()
        self.num_worlds = whole_number("num_worlds", num_worlds)
        self.device = as_device(device)
        self.threads = threads or os.cpu_count() or 1
        self.layout: Layout = layout(self.scenario)
        self.reward_term_names = TERMS
        self.speed_scale = speed_scale(self.scenario)
        self._allocate()
        with compile_quietly():
            self._record()
            self.reset(seeds=int(seed) + np.arange(self.num_worlds))

    @property
    def num_robots(self) -> int:
        """N."""
        return self.scenario.num_robots

    @property
    def action_shape(self) -> tuple[int, int, int]:
        """(W, N, 1) phase rates or (W, N, 2) steering and throttle, each in [-1, 1]."""
        return self.num_worlds, self.num_robots, self.scenario.action_size

    def reset(self, worlds: Any = None, seeds: Any = None) -> wp.array:
        """Begin a new episode in some worlds; the others are left as they are.

        Args:
            worlds: (W,) mask or indices of the worlds, each once; all by default.
            seeds: A seed for each of these worlds, whole numbers from 0 to 2^31 - 1; by default each world draws its
                next seed from its last.

        Returns:
            The observation of all worlds.
        """
        chosen = self._chosen(worlds)
        new_seeds = np.full(self.num_worlds, -1, dtype=np.int32)
        if seeds is not None:
            new_seeds[chosen] = _checked_seeds(seeds, len(chosen))
        fresh = np.zeros(self.num_worlds, dtype=np.int32)
        fresh[chosen] = 1
        self._seeds.assign(new_seeds)
        self.clock.fresh.assign(fresh)
        self._run(self._beginnings)
        self.clock.fresh.zero_()
        return self.observation

    def step(self, action: Any) -> tuple[wp.array, wp.array, wp.array, wp.array]:
        """Take one control step in every world whose episode is going on.

        Args:
            action: `action_shape`, a NumPy array, torch tensor or Warp array of numbers in [-1, 1]; values outside are
                clipped. Where a number is not finite, that robot's action is taken as zero and the world is flagged
                in `invalid`.

        Returns:
            observation, reward, terminated, truncated: the arrays of these names.

        Raises:
            ValueError: the action has another shape, or does not hold real numbers.
        """
        self._take(action)
        self._run(self._steps)
        return self.observation, self.reward, self.terminated, self.truncated

    def score(self, worlds: Any = None) -> list[dict[str, Any]]:
        """Score of the latest episode of some worlds so far, one row each: `lissajous_env.world.score.COLUMNS`."""
        return score_rows(self, self._chosen(worlds))

    @property
    def over(self) -> np.ndarray:
        """(W,) bool on the host: worlds whose episode has ended."""
        return self.clock.stage.numpy() != int(RUNNING)

    def _allocate(self) -> None:
        scenario, w, n = self.scenario, self.num_worlds, self.num_robots
        t, s = scenario.target_capacity, scenario.task.substeps
        columns, rows = scenario.task.grid or (1, 1)
        words = (columns + 31) // 32
        delay = round(scenario.noise.message_delay / scenario.task.step)
        large = [t * _ROGUE_BYTES, rows * columns * 4, rows * n * words * 4, n * n * 4]
        check_room([*large, n * (delay + 1) * 16, 2 * n * self.layout.size * 4], w, self.device)
        each, robot = (w,), (w, n)
        self.clock = allocate(Clock, {}, each, self.device)
        self.robots = allocate(Robots, {"track": (w, n, s + 1)}, robot, self.device)
        link = {"heard": (w, n, 2), "heard_at": (w, n, 2)}
        self.links = allocate(Links, link, (w, n, delay + 1), self.device)
        self.rogues = allocate(Rogues, {}, (w, t), self.device)
        grid = {"sensed_at": (w, rows, columns), "sensed": (w, rows, words), "sensed_by": (w, rows, n, words)}
        self.cells = allocate(Cells, grid, (w, rows), self.device)
        terms = {"in_sight": each, "waiting": each, "idle_ended": each, "terms": (w, n, len(TERMS))}
        self.latest = allocate(Step, terms, robot, self.device)
        self.tally = allocate(Tally, {"contact": (w, n, n), "returns": robot}, each, self.device)
        self.action = wp.zeros(self.action_shape, dtype=wp.float32, device=self.device)
        # On a CPU the same memory; elsewhere of no shape that an action has.
        self._action_host = self.action.numpy() if self.device.is_cpu else np.empty(0, dtype=np.float32)
        self.observation = wp.zeros((w, n, self.layout.size), dtype=wp.float32, device=self.device)
        self.final_observation = wp.zeros_like(self.observation)
        self._seeds = wp.zeros(w, dtype=wp.int32, device=self.device)
        self.reward, self.reward_terms = self.latest.reward, self.latest.terms
        self.terminated, self.truncated = self.latest.terminated, self.latest.truncated
        self.invalid, self.invalid_at = self.clock.invalid, self.clock.invalid_at

    def _record(self) -> None:
        """Record the launches of a reset and of a step, once for each thread's block of worlds."""
        blocks = [(0, self.num_worlds)]
        if self.device.is_cpu:
            workers = min(self.threads, -(-self.num_worlds // _BLOCK))
            edges = np.linspace(0, self.num_worlds, workers + 1).astype(int)
            blocks = [(int(low), int(high)) for low, high in pairwise(edges)]
        constants = _Constants(self.scenario, self.device)
        self._beginnings = [self._recorded(self._begin_recipe(constants), *block) for block in blocks]
        self._steps = [self._recorded(self._step_recipe(constants), *block) for block in blocks]

    def _begin_recipe(self, of: "_Constants") -> list[tuple]:
        n, t, rows = self.num_robots, self.rogues.stage.shape[1], self.cells.idle_max.shape[1]
        clock, robots, rogues = self.clock, self.robots, self.rogues
        return [
            (reset_clock, (), [self._seeds, clock]),
            (reset_losses, (), [of.faults, of.removals, of.steps, clock, robots]),
            (reset_tally, (), [clock, robots, self.latest, self.tally]),
            (reset_robots, (n,), [of.curve, of.formation, of.robot, of.noise, of.start, of.equilibrium, of.displaced,
                                  clock, robots, self.links, self.latest]),
            (reset_targets, (t,), [of.curve, of.targets, of.at_boundary, clock, rogues]),
            *([(reset_arrivals, (), [of.targets, of.step, clock, rogues])] if of.targets.arrival_rate > 0 else []),
            (reset_cells, (rows,), [clock, self.cells]),
            *self._sensing_recipe(of, begin=1),
            self._observing(of, begin=1),
        ]  # fmt: skip

    def _step_recipe(self, of: "_Constants") -> list[tuple]:
        clock, robots, latest, tally = self.clock, self.robots, self.latest, self.tally
        lanes = self._lanes(self.num_robots)
        move = move_points if self.scenario.robot.kind == "curve" else move_cars
        return [
            (move, lanes, [*lanes, of.curve, of.formation, of.robot, of.noise, of.faults, of.step, of.walled,
                           of.schedule, self.action, clock, robots, self.links, latest]),
            (find_collisions, lanes, [*lanes, of.robot, clock, robots, latest, tally]),
            *self._sensing_recipe(of, begin=0),
            self._observing(of, begin=0),
        ]  # fmt: skip

    def _sensing_recipe(self, of: "_Constants", begin: int) -> list[tuple]:
        clock, robots, latest, tally = self.clock, self.robots, self.latest, self.tally
        slots, rows = self._lanes(self.rogues.stage.shape[1]), self._lanes(self.cells.idle_max.shape[1])
        covering = (cover, rows, [*rows, begin, of.curve, of.scales.radius, clock, robots, self.cells, latest, tally])
        return [
            (move_targets, slots, [*slots, begin, of.curve, of.targets, of.step, of.scales.radius, clock, robots,
                                   self.rogues, latest]),
            *([covering] if of.cells_total > 0 else []),
            (keep_score, (), [begin, of.curve, of.formation, of.task, of.steps, of.cells_total, of.on_collision,
                              of.on_leaving, of.robot.radius, of.distances, of.equilibrium, of.neighbours, clock,
                              robots, latest, tally]),
        ]  # fmt: skip

    def _observing(self, of: "_Constants", begin: int) -> tuple:
        lanes = self._lanes(self.num_robots)
        inputs = [begin, of.curve, of.noise, of.scales, of.neighbours, self.clock, self.robots, self.links,
                  self.rogues, self.latest, self.observation, self.final_observation]  # fmt: skip
        return observe, lanes, [*lanes, *inputs]

    def _lanes(self, entities: int) -> tuple[int]:
        """Threads of a world: on a GPU one for each entity; on a CPU one that loops over them, to save its setup."""
        return (1,) if self.device.is_cpu else (max(entities, 1),)

    def _recorded(self, recipe: list[tuple], low: int, high: int) -> list:
        return [
            wp.launch(kernel, dim=(high - low, *size), inputs=[low, *inputs], device=self.device, record_cmd=True)
            for kernel, size, inputs in recipe
            if 0 not in size
        ]

    def _run(self, blocks: list[list]) -> None:
        if len(blocks) == 1:
            _launch_all(blocks[0])
        else:
            side_by_side([partial(_launch_all, block) for block in blocks], self.threads)

    def _take(self, action: Any) -> None:
        if type(action) is np.ndarray and action.dtype == np.float32 and action.shape == self._action_host.shape:
            self._action_host[:] = action
        else:
            copy_in("action", action, self.action)

    def _chosen(self, worlds: Any) -> np.ndarray:
        return chosen_worlds(worlds, self.num_worlds)

    def _groups(self) -> dict[str, Any]:
        structs = (self.clock, self.robots, self.links, self.rogues, self.cells, self.latest, self.tally)
        arrays = {f"{s._cls.key}.{name}": getattr(s, name) for s in structs for name in s._cls.vars}
        return arrays | {"observation": self.observation, "final_observation": self.final_observation}

    def save_state(self) -> dict[str, np.ndarray]:
        """Copy everything that changes during an episode to the host, by name."""
        return {name: array.numpy().copy() for name, array in self._groups().items()}

    def load_state(self, saved: dict[str, np.ndarray]) -> None:
        """Go on from what `save_state` returned, in a simulation of the same scenario and number of worlds.

        Raises:
            ValueError: an array is missing or has another shape.
        """
        for name, array in self._groups().items():
            if name not in saved or saved[name].shape != array.numpy().shape:
                got = saved[name].shape if name in saved else "none"
                raise ValueError(f"saved state must hold {name} of shape {array.numpy().shape}, got {got}")
        for name, array in self._groups().items():
            array.assign(saved[name])

    def __getstate__(self) -> dict[str, Any]:
        settings = {"scenario": self.scenario, "num_worlds": self.num_worlds, "device": str(self.device)}
        return {"settings": settings | {"threads": self.threads}, "arrays": self.save_state()}

    def __setstate__(self, saved: dict[str, Any]) -> None:
        self.__init__(**saved["settings"])
        self.load_state(saved["arrays"])


class _Constants:
    """What the kernels need of a scenario, as structs, numbers and small arrays on the device."""

    def __init__(self, scenario: Scenario, device: Any):
        task, n = scenario.task, scenario.num_robots
        self.curve = to_struct(CurveStruct, scenario.curve)
        self.formation = to_struct(FormationStruct, scenario.formation)
        self.robot = to_struct(RobotStruct, scenario.robot)
        self.noise = to_struct(NoiseStruct, scenario.noise)
        self.faults = to_struct(FaultsStruct, scenario.faults)
        self.targets = to_struct(TargetsStruct, scenario.targets)
        self.task = to_struct(TaskStruct, task)
        self.step, self.steps = task.step, task.steps
        self.start = _START[scenario.formation.start]
        self.at_boundary = int(scenario.targets.entry == "boundary")
        self.on_collision = ON_COLLISION[task.on_collision]
        self.on_leaving = REMOVE if task.boundary == "remove" else COUNT
        self.walled = int(task.boundary == "wall")
        self.distances = table_of(scenario, device)
        self.cells_total = 0 if task.grid is None else task.grid[0] * task.grid[1]
        displaced = np.zeros(n)
        for robot, angle in scenario.formation.displaced:
            displaced[robot] += angle
        schedule = np.array(schedule_steps(scenario.faults, task.step), dtype=np.int32).reshape(-1, 3)
        self.equilibrium = wp.array(scenario.equilibrium, dtype=wp.float64, device=device)
        self.displaced = wp.array(displaced, dtype=wp.float32, device=device)
        self.removals = wp.array(removal_steps(scenario.faults, n, task.step), dtype=wp.int32, device=device)
        self.schedule = wp.array(schedule, dtype=wp.int32, device=device, ndim=2)
        self.neighbours = wp.array(scenario.neighbours, dtype=wp.int32, device=device, ndim=2)
        self.scales = Scales()
        self.scales.speed = speed_scale(scenario)
        self.scales.radius = scenario.sensing_radius
        self.scales.step = task.step
        self.scales.robots_seen = scenario.sensing.robots_seen
        self.scales.targets_seen = scenario.sensing.targets_seen


def speed_scale(scenario: Scenario) -> float:
    """Unit of observed speeds: the top speed of a car, or the highest speed of the formation of points [m/s]."""
    if scenario.robot.kind == "car":
        return scenario.robot.speed_max
    lap = np.linspace(0, 2 * np.pi, 4096)
    return scenario.formation.phase_rate * float(closed_forms.curve_speed(scenario.curve, lap).max())


def fold_seed(seed: int) -> int:
    """Map any whole number of at least 0 to a seed of a world; numbers below 2^31 stand for themselves."""
    if not isinstance(seed, (int, np.integer)) or seed < 0:
        raise ValueError(f"seed must be a whole number of at least 0, got {shown(seed)}")
    if seed < 2**31:
        return int(seed)
    return int(np.random.SeedSequence(int(seed)).generate_state(1)[0] >> 1)


def _checked_seeds(seeds: Any, count: int) -> np.ndarray:
    try:
        array = np.atleast_1d(np.asarray(seeds))
    except ValueError as error:  # rows of different lengths
        raise ValueError(f"seed must be a whole number from 0 to {_LAST_SEED}, got {shown(seeds)}") from error
    if array.size and (array.dtype.kind not in "iu" or array.min() < 0 or array.max() > _LAST_SEED):
        raise ValueError(f"seed must be a whole number from 0 to {_LAST_SEED}, got {shown(seeds)}")
    if array.shape != (count,):
        raise ValueError(f"seeds must be one for each of the {count} worlds that are reset, got shape {array.shape}")
    return array.astype(np.int32)


def _launch_all(block: Sequence[wp.Launch]) -> None:
    for launch in block:
        launch.launch()
