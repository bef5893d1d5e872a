"""Stages of a scenario's extensions, and their places among the stages of the package."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.program import Stage
from lissajous_env.device.stage import ROBOT, TARGET, WORLD
from lissajous_env.parameters.extensions import (
    LARGEST,
    Extension,
    ObservationEntry,
    RewardTerm,
    ScoreColumn,
    TargetMotion,
)
from lissajous_env.parameters.robot_models import RobotModel, is_shipped, model_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.wording import shown, where_raised
from lissajous_env.world.columns import NAMES
from lissajous_env.world.extension_kernels import keep_column, take_entries, take_places, take_term
from lissajous_env.world.observation import layout
from lissajous_env.world.reward import TERMS
from lissajous_env.world.view import WorldView

_LARGEST = LARGEST * (1 + 1e-6)
"""The same of numbers that were rounded to 32 bits."""


class ExtensionStages:
    """Stages and arrays of a scenario's extensions.

    Args:
        scenario: Scenario with the extensions.
        structs: The structs of the state, by name.
        observation: (W, N, D) the rows.

    Attributes:
        kept: For each `ScoreColumn`, by name, its sum, largest, least and last (W, 4) of the episode.
    """

    def __init__(self, scenario: Scenario, structs: Mapping[str, Any], observation: wp.array):
        self.scenario = scenario
        self.device: Any = observation.device
        _check_names(scenario)
        self.kept: dict[str, wp.array] = {}
        self._view = WorldView(scenario, structs, observation) if scenario.extensions else None
        self._after: dict[str, list[Stage]] = {}
        """Stages of a step, by the stage that they follow."""
        self._after_reset: dict[str, list[Stage]] = {}
        model = model_of(scenario.robot.kind)
        if self.device.is_cpu and not is_shipped(model.name):
            robots = structs["robots"]
            self._after["motion"] = [Stage("motion checked", lambda: _check_motion(model, robots))]
        shape, term, entry = observation.shape, len(TERMS), observation.shape[2]
        entry -= sum(each.size for each in scenario.extensions if isinstance(each, ObservationEntry))
        for each in scenario.extensions:
            if isinstance(each, RewardTerm):
                value = self._room(shape[:2])
                own = {"term": term, "weight": each.weight, "value": value}
                self._after.setdefault("end", []).extend(
                    [*self._run(each, ROBOT, value), Stage(f"{each.name} taken", take_term, own=own)]
                )
                term += 1
            elif isinstance(each, ScoreColumn):
                value, kept = self._room(shape[:1], wp.float64), self._room((shape[0], 4), wp.float64)
                self.kept[each.name] = kept
                keeps = Stage(f"{each.name} kept", keep_column, own={"value": value, "kept_out": kept})
                self._after.setdefault("reward", []).extend([*self._run(each, WORLD, value), keeps])
                self._after_reset.setdefault("score", []).append(keeps)
            elif isinstance(each, ObservationEntry):
                value = self._room((*shape[:2], each.size))
                own = {"start": entry, "low": each.low, "high": each.high, "value": value}
                stages = [*self._run(each, ROBOT, value), Stage(f"{each.name} taken", take_entries, own=own)]
                self._after.setdefault("observation", []).extend(stages)
                self._after_reset.setdefault("observation", []).extend(stages)
                entry += each.size
            elif isinstance(each, TargetMotion):
                value = self._room((shape[0], scenario.target_capacity), wp.vec2)
                takes = Stage(f"{each.name} taken", take_places, own={"value": value})
                run = self._run(each, TARGET, value)
                self._after["collisions"] = run if run[0].is_kernel else [*run, takes]

    def step_stages(self, stages: Sequence[Stage]) -> list[Stage]:
        """Return the stages of a step with those of extensions."""
        return _among(stages, self._after)

    def reset_stages(self, stages: Sequence[Stage]) -> list[Stage]:
        """Return the stages of a reset with those of extensions."""
        return _among(stages, self._after_reset)

    def columns(self, steps: np.ndarray) -> dict[str, np.ndarray]:
        """Return the values (W,) of the score columns after so many steps (W,) of the episodes."""
        reduced = {each.name: each.reduce for each in self.scenario.extensions if isinstance(each, ScoreColumn)}
        return {name: _reduced(self.kept[name].numpy(), how, steps) for name, how in reduced.items()}

    def _room(self, shape: tuple[int, ...], dtype: Any = wp.float32) -> wp.array:
        return wp.zeros(shape, dtype=dtype, device=self.device)

    def _run(self, each: Extension, over: str, value: wp.array) -> list[Stage]:
        """Return the stages of an extension's own kernel or function, which writes into `value`."""
        if isinstance(each.run, wp.Kernel):
            runs = [Stage(each.name, each.run, over, own={"value_out": value})]
            # A motion writes places itself; a GPU would have to be waited for.
            if self.device.is_cpu and not isinstance(each, TargetMotion):
                runs.append(Stage(f"{each.name} checked", lambda: _check_numbers(each, value.numpy())))
            return runs
        shape = tuple(value.numpy().shape)
        short = shape[:-1] if isinstance(each, ObservationEntry) and each.size == 1 else shape

        def call() -> None:
            try:
                result = np.asarray(each.run(self._view))
            except SystemExit as error:  # which would end the process without a word
                where = where_raised(error)
                raise RuntimeError(f"{each.kind} {each.name} must return numbers, got {where}") from error
            except ValueError as error:
                if "read-only" not in str(error):
                    raise
                rule = "must not write to the world, whose arrays are read-only; copy an array to change it"
                raise ValueError(f"{each.kind} {each.name} {rule}, got: {error}") from error
            if result.dtype.kind not in "fiub" or result.shape not in (shape, short):
                got = f"{result.dtype} of shape {result.shape}" if result.ndim else shown(result)
                raise ValueError(f"{each.kind} {each.name} must return numbers of shape {short}, got {got}")
            with np.errstate(over="ignore"):  # what is beyond 32 bits is refused as infinite
                taken = result.reshape(shape).astype(value.numpy().dtype)
            _check_numbers(each, taken)
            value.assign(taken)

        call.__doc__ = each.about
        return [Stage(each.name, call)]


def _check_numbers(each: Extension, numbers: np.ndarray) -> None:
    """Refuse numbers of an extension that are not finite, or so large that sums of them are not."""
    weight = abs(each.weight) if isinstance(each, RewardTerm) else 1.0
    if numbers.size == 0 or max(float(numbers.max()), -float(numbers.min())) * weight <= _LARGEST:
        return  # a NaN is the largest and compares as False
    place = np.argwhere(~(np.abs(numbers).astype(float) * weight <= _LARGEST))[0]
    thing = "target" if isinstance(each, TargetMotion) else "robot"
    where = f"{thing}_{place[1]} in world {place[0]}" if len(place) > 1 else f"world {place[0]}"
    largest = f"of at most {LARGEST:g}{', weight included' if isinstance(each, RewardTerm) else ''}"
    rule = f"must return finite numbers {largest}"
    raise ValueError(f"{each.kind} {each.name} {rule}, got {numbers[tuple(place)]:.7g} for {where}")


def _check_motion(model: RobotModel, robots: Any) -> None:
    """Refuse robots whose position, heading or speed is not finite."""
    for name in ("position", "heading", "speed"):
        numbers = getattr(robots, name).numpy()
        if not np.isfinite(numbers).all():
            w, i, *_ = np.argwhere(~np.isfinite(numbers))[0]
            rule = f"must move robots to a finite {name}"
            raise ValueError(f"robot model {model.name} {rule}, got {numbers[w, i]} for robot_{i} in world {w}")


def _check_names(scenario: Scenario) -> None:
    """Refuse a name that the package uses."""
    entries = layout(replace(scenario, extensions=())).names
    taken = {RewardTerm: TERMS, ScoreColumn: NAMES, ObservationEntry: entries}
    for each in scenario.extensions:
        names = each.entries if isinstance(each, ObservationEntry) else (each.name,)
        if ours := [name for name in names if name in taken.get(type(each), ())]:
            raise ValueError(f"name of an extension must be new, got {ours[0]}")


def _among(stages: Sequence[Stage], after: Mapping[str, Sequence[Stage]]) -> list[Stage]:
    return [each for stage in stages for each in (stage, *after.get(stage.name, ()))]


def _reduced(kept: np.ndarray, how: str, steps: np.ndarray) -> np.ndarray:
    """Sum, largest, least and last (W, 4) of a column as one number of each world; NaN before the first step."""
    if how == "mean":
        return np.where(steps > 0, kept[:, 0] / np.maximum(steps, 1), np.nan)
    return np.where(steps > 0, kept[:, ("sum", "max", "min", "last").index(how)], np.nan)
