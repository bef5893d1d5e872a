"""Extensions of a scenario: their view of the worlds, and their stages among those of the package."""

import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NoReturn, Self

import numpy as np
import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import into_rectangle
from lissajous_env.device.program import Stage
from lissajous_env.device.stage import ROBOT, TARGET, WORLD, stage
from lissajous_env.device.warp_abi import fields_of
from lissajous_env.parameters.extensions import (
    LARGEST,
    REDUCTIONS,
    Extension,
    ObservationEntry,
    RewardTerm,
    ScoreColumn,
    TargetEntry,
    TargetMotion,
)
from lissajous_env.parameters.robot_models import MODELS, RobotModel, model_of
from lissajous_env.parameters.scenario import Scenario, read_only
from lissajous_env.wording import nearest, shown, where_raised
from lissajous_env.world.columns import NAMES
from lissajous_env.world.observation import layout
from lissajous_env.world.state import DETECTED, HIDDEN, PRESENT
from lissajous_env.world.tally import TERMS
from lissajous_env.world.targets.motion import CUSTOM


class _Fixed:
    """An object with read-only attributes."""

    def __setattr__(self, name: str, value: Any) -> NoReturn:
        raise ValueError(f"{name} is read-only, and so are all arrays of a world")


class WorldView(_Fixed):
    """Argument of an extension's function: the state of all worlds as read-only arrays.

    Attributes:
        scenario: The scenario, with every field filled in.
        clock, robots, links, messages, targets, tracks, cells, contamination, latest, tally: The arrays of
            `lissajous_env.world.state`, by their names: `world.robots.position` is (W, N, 3). With `targets.rogues`,
            there is also `rogues`.
        observation: (W, N, D).
        state: The extension's own arrays (W, ...), by the names that it declared; only these can be written.

    On the CPU the arrays are the simulation's own memory; on a GPU they are copied when they are read. To change one,
    copy it: `world.targets.position.copy()`.
    """

    scenario: Scenario
    state: Mapping[str, np.ndarray]
    clock: Any
    _observation: Any
    _name: str
    _drawn: int

    def __init__(self, scenario: Scenario, structs: Mapping[str, Any], observation: Any, name: str, state: Any):
        self.__dict__.update({struct_name: _Arrays(struct, struct_name) for struct_name, struct in structs.items()})
        self.__dict__.update(scenario=scenario, state=state, _observation=observation, _name=name, _drawn=0)

    @property
    def observation(self) -> Any:
        """(W, N, D) rows of the robots."""
        return read_only(self._observation.numpy())

    def begin_call(self) -> Self:
        """Reset the random numbers to the first ones of a step, and return the view, for a call of the extension."""
        self.__dict__["_drawn"] = 0
        return self

    def random(self, *shape: int) -> np.ndarray:
        """Draw uniform numbers `(W, *shape)` in [0, 1).

        They depend on the seed of the world, the step, the name of the extension, and the number of earlier draws in
        this step, but not on the other worlds.
        """
        count = math.prod(shape)
        key = self.clock.seed.astype(np.uint64) << np.uint64(32) | self.clock.step.astype(np.uint64)
        key = _mixed(key ^ np.uint64(zlib.crc32(self._name.encode())) << np.uint64(31))
        numbers = np.arange(self._drawn + 1, self._drawn + count + 1, dtype=np.uint64) * _GOLDEN
        self.__dict__["_drawn"] += count
        return (_mixed(key[:, None] + numbers) >> np.uint64(11)).reshape(len(key), *shape) * 2.0**-53


_GOLDEN = np.uint64(0x9E3779B97F4A7C15)


def _mixed(word: np.ndarray) -> np.ndarray:
    """Return hashed words of 64 bits (the finalizer of SplitMix64: Steele, Lea and Flood, 2014)."""
    word = (word ^ word >> np.uint64(30)) * np.uint64(0xBF58476D1CE4E5B9)
    word = (word ^ word >> np.uint64(27)) * np.uint64(0x94D049BB133111EB)
    return word ^ word >> np.uint64(31)


class _Arrays(_Fixed):
    """Read-only arrays of a struct: on a CPU its memory, on a GPU copies that are made when they are read."""

    def __init__(self, struct: Any, name: str):
        self.__dict__.update({"_fields": fields_of(struct), "_name": name})

    def __dir__(self) -> list[str]:
        return list(self.__dict__["_fields"])

    def __getattr__(self, name: str) -> Any:
        fields = self.__dict__["_fields"]
        if name not in fields:
            raise AttributeError(f"{self._name} has no {name}{nearest(name, fields)}; see dir(world.{self._name})")
        array = fields[name]
        view = read_only(array.numpy())
        if array.device.is_cpu:
            self.__dict__[name] = view
        return view


wp.set_module_options(OPTIONS)

_LARGEST = wp.constant(LARGEST)
_MAX, _MIN, _LAST = (wp.constant(REDUCTIONS.index(name)) for name in ("max", "min", "last"))


@wp.func
def or_zero(value: float) -> float:
    """Return the value, or 0 if it is not finite or too large; an error would make a GPU wait for the host."""
    return wp.where(wp.abs(value) <= _LARGEST, value, 0.0)


@stage(ROBOT, writes="latest: terms")
def copy_term(w, i, term: int, weight: float, value: wp.array2d(dtype=float), clock, latest):
    """Copy an extension's term of the reward, times its weight, to index `term` of the terms."""
    latest.terms[w, i, term] = or_zero(weight * value[w, i])


@stage(ROBOT, writes="observation")
def copy_observation(w, i, start: int, low: float, high: float, value: wp.array3d(dtype=float), clock, observation):
    """Copy an extension's entries into the rows, from index `start` on."""
    for k in range(value.shape[2]):
        observation[w, i, start + k] = wp.clamp(or_zero(value[w, i, k]), low, high)


@stage(WORLD, writes="reduced")
def reduce_column(w, reduction: int, value: wp.array(dtype=wp.float64), clock, reduced: wp.array(dtype=wp.float64)):
    """Update the sum, maximum, minimum or last value of an extension's score column; NaN before the first step."""
    latest = wp.where(wp.abs(value[w]) <= wp.float64(_LARGEST), value[w], wp.float64(0.0))
    if clock.step[w] == 0:
        latest = wp.float64(wp.nan)
    elif clock.step[w] > 1:
        if reduction == _MAX:
            latest = wp.max(reduced[w], latest)
        elif reduction == _MIN:
            latest = wp.min(reduced[w], latest)
        elif reduction != _LAST:
            latest += reduced[w]
    reduced[w] = latest


@stage(TARGET, writes="targets: heading, position")
def copy_positions(w, t, curve, target, value: wp.array2d(dtype=wp.vec2), clock, targets):
    """Move the targets with motion CUSTOM to an extension's positions [m]; those that leave now stay in their place."""
    status = targets.status[w, t]
    stays = status == PRESENT or (status == DETECTED and target.leave == 0)
    if targets.motion[w, t] == CUSTOM and stays:
        place = into_rectangle(value[w, t], curve)
        moved = place - targets.position[w, t]
        if wp.length_sq(moved) > 0.0:
            targets.heading[w, t] = wp.atan2(moved[1], moved[0])
        targets.position[w, t] = place


@stage(TARGET, writes="targets: before, position")
def place_arrivals(w, t, curve, value: wp.array2d(dtype=wp.vec2), clock, targets):
    """Place the targets that appear now at an extension's positions [m]."""
    if targets.status[w, t] == HIDDEN and targets.appears_at[w, t] <= clock.step[w]:
        place = into_rectangle(value[w, t], curve)
        targets.position[w, t] = place
        targets.before[w, t] = place


_LARGEST_ROUNDED = LARGEST * (1 + 1e-6)
"""Largest magnitude that the host accepts, with a margin for numbers that were rounded to float32."""


class ExtensionStages:
    """Stages and arrays of a scenario's extensions.

    Args:
        scenario: Scenario with the extensions.
        structs: The structs of the state, by name.
        observation: (W, N, D) the rows.

    Attributes:
        remembered: By name, the value (W,) so far of each `ScoreColumn`, for a mean the sum, and the arrays of the
            extensions' states.
    """

    def __init__(self, scenario: Scenario, structs: Mapping[str, Any], observation: wp.array):
        self.scenario = scenario
        self.device: Any = observation.device
        _check_names(scenario)
        self.remembered: dict[str, wp.array] = {}
        self._world = structs, observation
        self._after: dict[str, list[Stage]] = {}
        """Stages of extensions in a step, by the name of the stage of the package that they follow."""
        self._after_reset: dict[str, list[Stage]] = {}
        model = model_of(scenario.robot.kind)
        if self.device.is_cpu and not MODELS.is_included(model):
            robots = structs["robots"]
            self._after["motion"] = [Stage("motion checked", lambda: _check_motion(model, robots))]
        shape, term, entry = observation.shape, len(TERMS), observation.shape[2]
        entry -= sum(extension.size for extension in scenario.extensions if isinstance(extension, ObservationEntry))
        for extension in scenario.extensions:
            own: dict[str, Any] = {}
            if isinstance(extension, RewardTerm):
                follows, copies, value = "end", copy_term, self._zeros(shape[:2])
                own, term = {"term": term, "weight": extension.weight}, term + 1
            elif isinstance(extension, ObservationEntry):
                follows, copies, value = "observation", copy_observation, self._zeros((*shape[:2], extension.size))
                own, entry = {"start": entry, "low": extension.low, "high": extension.high}, entry + extension.size
            elif isinstance(extension, ScoreColumn):
                follows, copies, value = "reward", reduce_column, self._zeros(shape[:1], wp.float64)
                self.remembered[extension.name] = own["reduced"] = self._zeros(shape[:1], wp.float64)
                own["reduction"] = REDUCTIONS.index(extension.reduce)
            else:
                is_motion = isinstance(extension, TargetMotion)
                follows, copies = ("collisions", copy_positions) if is_motion else ("respawn", place_arrivals)
                value = self._zeros((shape[0], scenario.target_capacity), wp.vec2)
            state = self._state_of(extension, shape[0])
            if state:
                self._after_reset.setdefault("arrays", []).append(self._beginning(extension, state))
            run = self._run(extension, value, state)
            copy = Stage(f"{extension.name} copied", copies, own=own | {"value": value})
            # The kernel of a target motion writes the positions itself.
            is_complete = isinstance(extension, TargetMotion) and run[0].is_kernel
            self._after.setdefault(follows, []).extend(run if is_complete else [*run, copy])
            if isinstance(extension, (ObservationEntry, TargetEntry)):
                self._after_reset.setdefault(follows, []).extend([*run, copy])
            elif isinstance(extension, ScoreColumn):
                self._after_reset.setdefault("score", []).append(copy)

    def among(self, stages: Sequence[Stage], begins: bool) -> list[Stage]:
        """Return the stages of a step, or of the reset that `begins` an episode, with those of extensions."""
        after = self._after_reset if begins else self._after
        return [entry for stage in stages for entry in (stage, *after.get(stage.name, ()))]

    def columns(self, steps: np.ndarray) -> dict[str, np.ndarray]:
        """Return the values (W,) of the score columns after so many steps (W,) of the episodes."""
        columns = [column for column in self.scenario.extensions if isinstance(column, ScoreColumn)]
        divisors = {column.name: np.maximum(steps, 1) if column.reduce == "mean" else 1 for column in columns}
        return {name: self.remembered[name].numpy() / divisor for name, divisor in divisors.items()}

    def _zeros(self, shape: tuple[int, ...], dtype: Any = wp.float32) -> wp.array:
        return wp.zeros(shape, dtype=dtype, device=self.device)

    def _state_of(self, extension: Extension, worlds: int) -> dict[str, wp.array]:
        """Make the arrays of an extension's state; those of a function are on the CPU."""
        device = self.device if isinstance(extension.run, wp.Kernel) else "cpu"
        shapes = {name: (worlds, *shape) for name, shape in extension.state.items()}
        state = {name: wp.zeros(shape, dtype=wp.float32, device=device) for name, shape in shapes.items()}
        self.remembered |= {f"{extension.name}.{name}": array for name, array in state.items()}
        return state

    def _beginning(self, extension: Extension, state: dict[str, wp.array]) -> Stage:
        """Return the stage that fills the arrays of an extension's state in the worlds that begin an episode."""
        fresh = self._world[0]["clock"].fresh

        def begin() -> None:
            begins = fresh.numpy() == 1
            filled = {name: np.zeros_like(array.numpy()) for name, array in state.items()}
            if extension.reset is not None:
                extension.reset(WorldView(self.scenario, *self._world, f"{extension.name} reset", filled))
            for name, array in state.items():
                array.assign(np.where(begins.reshape(-1, *[1] * (array.ndim - 1)), filled[name], array.numpy()))

        return Stage(f"{extension.name} begins", begin)

    def _run(self, extension: Extension, value: wp.array, state: dict[str, wp.array]) -> list[Stage]:
        """Return the stages of an extension's own kernel or function, which writes into `value`."""
        if isinstance(extension.run, wp.Kernel):
            runs = [Stage(extension.name, extension.run, own=state | {"value_out": value})]
            # The positions of a motion are not in `value`, and a check would make a GPU wait for the host.
            if self.device.is_cpu and not isinstance(extension, TargetMotion):
                runs.append(Stage(f"{extension.name} checked", lambda: _check_numbers(extension, value.numpy())))
            return runs
        shape = tuple(value.numpy().shape)
        short = shape[:-1] if isinstance(extension, ObservationEntry) and extension.size == 1 else shape
        memory = {name: array.numpy() for name, array in state.items()}  # the same memory
        view, fresh = WorldView(self.scenario, *self._world, extension.name, memory), self._world[0]["clock"].fresh

        def call() -> None:
            before = {name: array.copy() for name, array in memory.items()} if memory and fresh.numpy().any() else {}
            try:
                result = np.asarray(extension.run(view.begin_call()))
            except Exception as error:
                raise ValueError(f"{extension.kind} {extension.name} failed: {where_raised(error)}") from error
            if result.dtype.kind not in "fiub" or result.shape not in (shape, short):
                got = f"{result.dtype} of shape {result.shape}" if result.ndim else shown(result)
                raise ValueError(f"{extension.kind} {extension.name} must return numbers of shape {short}, got {got}")
            with np.errstate(over="ignore"):  # numbers beyond float32 become infinite, which is refused
                numbers = result.reshape(shape).astype(value.numpy().dtype)
            _check_numbers(extension, numbers)
            value.assign(numbers)
            for name, array in before.items():  # a reset of some worlds leaves the others unchanged
                memory[name][fresh.numpy() == 0] = array[fresh.numpy() == 0]

        call.__doc__ = extension.about
        return [Stage(extension.name, call)]


def _check_numbers(extension: Extension, numbers: np.ndarray) -> None:
    """Raise ValueError if numbers of an extension are not finite, or so large that their sums may not be."""
    weight = abs(extension.weight) if isinstance(extension, RewardTerm) else 1.0
    if numbers.size == 0 or max(float(numbers.max()), -float(numbers.min())) * weight <= _LARGEST_ROUNDED:
        return  # NaN, which is the largest, compares as False
    place = np.argwhere(~(np.abs(numbers).astype(float) * weight <= _LARGEST_ROUNDED))[0]
    entity = "target" if isinstance(extension, (TargetMotion, TargetEntry)) else "robot"
    where = f"{entity}_{place[1]} in world {place[0]}" if len(place) > 1 else f"world {place[0]}"
    largest = f"of at most {LARGEST:g}{', weight included' if isinstance(extension, RewardTerm) else ''}"
    rule = f"must return finite numbers {largest}"
    raise ValueError(f"{extension.kind} {extension.name} {rule}, got {numbers[tuple(place)]:.7g} for {where}")


def _check_motion(model: RobotModel, robots: Any) -> None:
    """Raise ValueError if a position, heading or speed of a robot is not finite."""
    for name in ("position", "heading", "speed"):
        numbers = getattr(robots, name).numpy()
        if not np.isfinite(numbers).all():
            w, i, *_ = np.argwhere(~np.isfinite(numbers))[0]
            rule = f"must move robots to a finite {name}"
            raise ValueError(f"robot model {model.name} {rule}, got {numbers[w, i]} for robot_{i} in world {w}")


def _check_names(scenario: Scenario) -> None:
    """Raise ValueError if an extension has a name that the package uses."""
    others = tuple(extension for extension in scenario.extensions if not isinstance(extension, ObservationEntry))
    entries = layout(replace(scenario, extensions=others)).names
    taken = {RewardTerm: TERMS, ScoreColumn: NAMES, ObservationEntry: entries}
    for extension in scenario.extensions:
        names = extension.entries if isinstance(extension, ObservationEntry) else (extension.name,)
        if clashes := [name for name in names if name in taken.get(type(extension), ())]:
            raise ValueError(f"name of an extension must be new, got {clashes[0]}")
