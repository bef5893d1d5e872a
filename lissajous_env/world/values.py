"""Arguments of the kernels of a scenario: its constants (structs, numbers and small arrays), and the state."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device import structs
from lissajous_env.device.curve import curve_struct
from lissajous_env.device.devices import check_room
from lissajous_env.device.stage import TYPES
from lissajous_env.device.structs import allocate, to_struct
from lissajous_env.device.warp_abi import variables_of
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.contamination.labels import MARGIN, as_hops, label_row_length
from lissajous_env.world.observation import cell_start, message_start, track_start
from lissajous_env.world.robots.deviations import points_of
from lissajous_env.world.robots.faults import removal_steps, schedule_steps
from lissajous_env.world.rogues.acting import rogue_layout
from lissajous_env.world.state import EpisodeTotals


def constants_of(scenario: Scenario, device: Any) -> dict[str, Any]:
    """Return the constants of a resolved scenario by the names of kernels' parameters."""
    task, targets, n = scenario.task, scenario.targets, scenario.num_robots
    model, slowest = model_of(scenario.robot.kind), targets.speed if targets.speed_min is None else targets.speed_min
    schedule = np.array(schedule_steps(scenario.faults, task.step), dtype=np.int32).reshape(-1, 3)
    return {
        "curve": curve_struct(scenario.curve, device),
        "formation": to_struct(structs.FormationStruct, scenario.formation),
        "robot": to_struct(structs.RobotStruct, scenario.robot),
        "sensing": to_struct(structs.SensingStruct, replace(scenario.sensing, sight=scenario.sight)),
        "target": to_struct(structs.TargetStruct, replace(targets, speed_min=slowest)),
        "faults": to_struct(structs.FaultsStruct, scenario.faults),
        "noise": to_struct(structs.NoiseStruct, scenario.noise),
        "task": to_struct(structs.TaskStruct, task),
        "steps": task.steps,  # of an episode
        "cells_total": 0 if task.grid is None else task.grid[0] * task.grid[1],
        "age_per_step": task.step / scenario.time_unit,  # of a message in the observation [0.3 rad / omega]
        "bounds_per_step": task.step / scenario.detection_time_bound,  # a step in units of T_max
        "turning_radius": scenario.start_turning,  # [m], for which robots have room between walls at the start, or 0
        "message_start": message_start(scenario),  # indices of first entries in an observation row
        "track_start": track_start(scenario),
        "cell_start": cell_start(scenario),
        "speed_unit": scenario.speed_unit,  # [m/s]
        "action_speeds": wp.array(_action_speeds(scenario), dtype=wp.float32, device=device, ndim=2),
        "curve_points": points_of(None if model.keeps_to_curve else scenario.driven, str(device)),
        # (N,) phases in the equilibrium [rad].
        "equilibrium": wp.array(scenario.equilibrium, dtype=wp.float64, device=device),
        # (N, 2) robots before and after each one on the ring; -1 for none.
        "neighbours": wp.array(scenario.neighbours, dtype=wp.int32, device=device, ndim=2),
        "hops": as_hops(scenario.spreading, device),
        # (N,) places in the equilibrium, factors on the motor's drive, top speeds [m/s], and displacements at the start
        # along the phase [rad].
        "places": wp.array(scenario.places, dtype=wp.int32, device=device),
        "drive_factors": wp.array(scenario.drive_factors, dtype=wp.float32, device=device),
        "top_speeds": wp.array(scenario.top_speeds, dtype=wp.float32, device=device),
        "displacements": wp.array(scenario.displacements, dtype=wp.float32, device=device),
        # (N,) step after which the schedule removes each robot, and (F, 3) robot, start and end [step] of each fault.
        "removals": wp.array(removal_steps(scenario.faults, n, task.step), dtype=wp.int32, device=device),
        "schedule": wp.array(schedule, dtype=wp.int32, device=device, ndim=2),
    }


def _action_speeds(scenario: Scenario) -> np.ndarray:
    """Return (A, 3) the value at rest of each component of an action, and its speed per unit above and below it [m/s].

    A component requests `speed_unit` at both ends, but `speed_min` in full reverse, or nothing if it drives no robot.
    """
    robot, rest = scenario.robot, np.array(scenario.model.rest_action(scenario.robot))
    if scenario.actuation == "car" and not robot.reverses:
        least = max(robot.throttle_min, robot.dead_zone, robot.offset / robot.drive)  # up to which the car rests
        rest[1] = 2 * (least - robot.throttle_min) / (robot.full_throttle - robot.throttle_min) - 1
    driving = range(len(rest)) if scenario.model.driving is None else scenario.model.driving
    back = -robot.lowest_speed if scenario.actuation in ("car", "differential") else scenario.speed_unit
    speeds = np.isin(np.arange(len(rest)), driving) * np.array([[scenario.speed_unit], [back]])  # (2, A) at the ends
    return np.column_stack([rest, *(speeds / np.maximum([1 - rest, 1 + rest], 1e-6))])


def state_of(scenario: Scenario, num_worlds: int, row_size: int, terms: int, device: Any) -> dict[str, Any]:
    """Make the structs of the state of a resolved scenario, by the names of kernels' parameters.

    Args:
        scenario: The scenario.
        num_worlds: W.
        row_size: Entries of an observation row.
        terms: Terms of the reward.
        device: Warp device.

    Raises:
        ValueError: the arrays do not fit into the device's memory.
    """
    w, n = num_worlds, scenario.num_robots
    t, s = scenario.target_capacity, scenario.task.substeps
    columns, rows = scenario.task.grid or (1, 1)
    words = (columns + 63) // 64
    delay = scenario.delay_steps
    hops = scenario.spreading
    labels = hops.history_length, hops.rows + 2 * MARGIN, label_row_length(hops.columns)
    k = scenario.messages.size
    known = t if scenario.sensing.has_tracks else 0
    world, robot = (w,), (w, n)
    field_row = w, hops.rows
    labelled = w, hops.rows + 2 * MARGIN, (hops.columns + 31) // 32 + 2, hops.history_length
    mates = w, n, n if scenario.sensing.has_tracks else 0
    across_cells, down_cells = scenario.sensing.cells_seen or (0, 0)
    discs, swept = (w, words, rows), (w, (hops.columns + 63) // 64, hops.rows)
    of_robots = {name: robot for name, array in variables_of(EpisodeTotals).items() if array.type.ndim == 2}
    shapes: dict[str, tuple[tuple[int, ...], dict[str, tuple[int, ...]]]] = {
        "clock": (world, {}),
        "robots": (robot, {"path": (w, n, s + 1)}),
        "links": ((w, n, delay + 1), {"heard": (w, n, 2), "heard_at": (w, n, 2)}),
        "messages": (world, {"sending": (w, n, k), "sent": (w, n, delay + 1, k), "heard": (w, n, 2, k)}),
        "targets": ((w, t), {}),
        "tracks": ((w, n, known), {"sighted": (w, n, delay + 1, known), "target_position": (w, delay + 1, known),
                                   "mate_position": mates, "mate_sent_at": mates,
                                   "sensor_position": (w, n, delay + 1 if across_cells else 0),
                                   "covered_at": (w, n, down_cells, across_cells)}),
        "cells": ((w, rows), {"sensed_at": (w, rows, columns), "sensed_by": (w, n, words, rows),
                              "sensed": discs, "in_discs": discs, "coming": discs}),
        "contamination": (world, {"labels": (w, *labels), "sensed": swept, "swept": swept, "labelled": labelled,
                                  "settled": (w, hops.rows, labelled[2] - 2),
                                  "row_oldest": field_row, "row_ages": field_row}),
        "latest": (robot, {"in_sight": world, "waiting": world, "idle_ended": world, "terms": (w, n, terms)}),
        "tally": (world, {"contact": (w, n, n), **of_robots}),
    }  # fmt: skip
    if scenario.targets.rogues is not None:
        size = rogue_layout(scenario).size
        shapes["rogues"] = (w, t), {"action": (w, t, 2), "observation": (w, t, size)}
    sizes = [
        math.prod(own.get(field, default)[1:]) * wp.types.type_size_in_bytes(array.type.dtype)
        for name, (default, own) in shapes.items()
        for field, array in variables_of(TYPES[name]).items()
    ]
    check_room([*sizes, 2 * n * row_size * 4], w, device)
    return {name: allocate(TYPES[name], own, default, device) for name, (default, own) in shapes.items()}
