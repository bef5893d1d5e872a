"""Constants of a scenario for its kernels: its parts as structs, numbers, small arrays."""

from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device import part_structs
from lissajous_env.device.curve import curve_struct
from lissajous_env.device.structs import to_struct
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.contamination.conservative import as_reach
from lissajous_env.world.contamination.labels import as_hops
from lissajous_env.world.robots.deviations import points_of
from lissajous_env.world.robots.faults import removal_steps, schedule_steps


def constants_of(scenario: Scenario, device: Any) -> dict[str, Any]:
    """Return the constants of a resolved scenario by the names of kernels' parameters."""
    task, targets, n = scenario.task, scenario.targets, scenario.num_robots
    model = model_of(scenario.robot.kind)
    displaced = np.zeros(n)
    for robot, angle in scenario.formation.displaced:
        displaced[robot] += angle
    schedule = np.array(schedule_steps(scenario.faults, task.step), dtype=np.int32).reshape(-1, 3)
    return {
        "curve": curve_struct(scenario.curve, device),
        "formation": to_struct(part_structs.FormationStruct, scenario.formation),
        "robot": to_struct(part_structs.RobotStruct, scenario.robot),
        "sensing": to_struct(part_structs.SensingStruct, replace(scenario.sensing, sight=scenario.sight)),
        "target": to_struct(part_structs.TargetStruct, replace(targets, speed_min=targets.slowest)),
        "faults": to_struct(part_structs.FaultsStruct, scenario.faults),
        "noise": to_struct(part_structs.NoiseStruct, scenario.noise),
        "task": to_struct(part_structs.TaskStruct, task),
        "steps": task.steps,
        "cells_total": 0 if task.grid is None else task.grid[0] * task.grid[1],
        "age_per_step": scenario.task.step / scenario.time_unit,
        "speed_unit": model.speed_unit(scenario.driven, scenario.formation, scenario.robot),
        "driving": wp.array(_driving(scenario), dtype=wp.float32, device=device, ndim=2),
        "curve_points": points_of(None if model.keeps_to_curve else scenario.driven, str(device)),
        "equilibrium": wp.array(scenario.equilibrium, dtype=wp.float64, device=device),
        "neighbours": wp.array(scenario.neighbours, dtype=wp.int32, device=device, ndim=2),
        "hops": as_hops(scenario.spreading, device),
        "reach": as_reach(scenario.spreading.reaches, device),
        "places": wp.array(scenario.places, dtype=wp.int32, device=device),
        "drive_factors": wp.array(scenario.drive_factors, dtype=wp.float32, device=device),
        "top_speeds": wp.array(scenario.top_speeds, dtype=wp.float32, device=device),
        "displaced": wp.array(displaced, dtype=wp.float32, device=device),
        "removals": wp.array(removal_steps(scenario.faults, n, task.step), dtype=wp.int32, device=device),
        "schedule": wp.array(schedule, dtype=wp.int32, device=device, ndim=2),
    }


def _driving(scenario: Scenario) -> np.ndarray:
    """Return (A, 2) the value at rest of the components of an action, and the speed that each requests [m/s].

    A component requests the unit of speed where it is farthest from its value at rest, and 0 if it drives no robot.
    """
    model = scenario.model
    rest = np.array(model.rest_action(scenario.robot))
    unit = model.speed_unit(scenario.driven, scenario.formation, scenario.robot)
    drives = np.isin(np.arange(model.action_size), range(model.action_size) if model.driving is None else model.driving)
    return np.stack([rest, drives * unit / (1 + abs(rest))], axis=-1)
