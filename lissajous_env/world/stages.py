"""The stages of a step and of a reset, in their order.

A stage is a kernel over the worlds of a batch, or over the robots, targets or rows of the grid of each world. The names
of its parameters select its arguments among the state (`lissajous_env.world.state`) and the constants
(`lissajous_env.world.values`). It skips worlds in which `clock.active` is 0, unless it is made with `idle=True`.
"""

from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.program import Stage
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.parameters.rogues import Rogue, rogue_of
from lissajous_env.parameters.scenario import Faults, Scenario
from lissajous_env.wording import shown
from lissajous_env.world.clock import advance_clock, end_episodes, reset_arrays, reset_clock
from lissajous_env.world.contamination.conservative import bound_labels
from lissajous_env.world.contamination.field import clear_cells, reset_labels, spread, update_undetected_time
from lissajous_env.world.coverage import cover
from lissajous_env.world.observing import observe, store_final_rows
from lissajous_env.world.robots.car import follow_velocity
from lissajous_env.world.robots.contacts import count_collisions, count_wall_contacts, mark_outside, stop_or_remove
from lissajous_env.world.robots.deviations import compute_deviations
from lissajous_env.world.robots.faults import reset_losses, update_status
from lissajous_env.world.robots.inside import drive_inside, has_room, walls_of
from lissajous_env.world.robots.nearby import clear_bins, has_bins, list_robots
from lissajous_env.world.robots.placing import redraw_colliding_starts, reset_robots, turn_from_walls
from lissajous_env.world.robots.signals import (
    follow_curve,
    hear,
    hear_messages,
    limit_actions,
    measure,
    send,
    send_messages,
)
from lissajous_env.world.rogues.acting import fill_rows, move_rogues, reward_rogues
from lissajous_env.world.tally import compute_reward, update_totals
from lissajous_env.world.targets.detection import move_and_detect, place_unseen
from lissajous_env.world.targets.motion import reset_arrivals, reset_targets, respawn
from lissajous_env.world.tracks import observe_tracks, record_sightings, update_known_cells, update_tracks


def stages_of(scenario: Scenario, rogues: Any = None, begins: bool = False) -> list[Stage]:
    """Return the stages of a control step, or of the reset that `begins` an episode, which is a step without motion.

    Extensions, and robots on given paths (`lissajous_env.logs.prescribed`), add their stages to these by name. `rogues`
    is the struct `Rogues` of the state; None for targets that are no rogues.
    """
    many, tracks, model = has_bins(scenario), scenario.sensing.has_tracks, model_of(scenario.robot.kind)
    task, targets, speak, are_rogues = scenario.task, scenario.targets, scenario.messages.size > 0, rogues is not None
    moves = not begins
    return [
        *(_beginning(scenario) if begins else _motion(scenario)),
        Stage("measurement", measure),
        Stage("sending", send),
        Stage("messages", send_messages, when=speak),
        Stage("initial targets", reset_targets, when=begins),
        Stage("arrivals", reset_arrivals, when=begins and targets.arrival_rate > 0),
        Stage("bins", clear_bins, when=many),
        Stage("listing", list_robots, when=many),
        Stage("collisions", count_collisions, when=moves),
        *(_decision(rogue_of(targets.rogues), rogues) if moves and targets.rogues is not None else []),
        Stage("rogues", move_rogues, when=moves and are_rogues),
        Stage("respawn", respawn, when=targets.respawn),
        Stage("entry", place_unseen, when=targets.entry == "unseen"),
        Stage("targets", move_and_detect),
        Stage("coverage", cover, when=task.grid is not None),
        *(_contamination(scenario, begins) if task.contamination is not None else []),
        Stage("consequences", stop_or_remove, when=moves and task.on_collision != "count"),
        Stage("boundary", mark_outside),
        Stage("walls", count_wall_contacts, when=moves and task.boundary == "wall" and not model.keeps_to_curve),
        Stage("deviations", compute_deviations),
        Stage("score", update_totals),
        Stage("end", end_episodes, when=moves),
        Stage("reward", compute_reward, when=moves),
        Stage("hearing", hear),
        Stage("message hearing", hear_messages, when=speak),
        Stage("final", store_final_rows, when=begins),
        Stage("sighting", record_sightings, when=tracks),
        Stage("tracking", update_tracks, when=tracks),
        Stage("tracks", observe_tracks, when=tracks),
        Stage("cells", update_known_cells, when=scenario.sensing.cells_seen is not None),
        Stage("observation", observe),
        Stage("rogue reward", reward_rogues, when=are_rogues),
        Stage("rogue observation", fill_rows, when=are_rogues),
    ]


def _beginning(scenario: Scenario) -> list[Stage]:
    """Return the stages in which robots are placed."""
    return [
        Stage("clock", reset_clock),
        Stage("arrays", reset_arrays),
        Stage("losses", reset_losses),
        Stage("robots", reset_robots),
        Stage("facing", turn_from_walls, when=scenario.start_turning > 0),
        Stage("headway", redraw_colliding_starts, when=scenario.formation.start_headway > 0),
    ]


def _motion(scenario: Scenario) -> list[Stage]:
    """Return the stages in which robots move by their actions; drivers turn velocities into steering and throttle."""
    model, has_driver = model_of(scenario.robot.kind), scenario.task.action == "velocity"
    own = {"walls": walls_of(scenario)} if has_driver and has_room(scenario) else {}
    return [
        Stage("clock", advance_clock),
        Stage("faults", update_status, when=scenario.faults != Faults()),
        Stage("commands", limit_actions),
        Stage("driver", follow_velocity, when=has_driver),
        Stage("walls ahead", drive_inside, when=bool(own), own=own),
        Stage("motion", model.move),
        Stage("phase", follow_curve, when=not model.keeps_to_curve),
    ]


def _contamination(scenario: Scenario, begins: bool) -> list[Stage]:
    """Return the stages of each tick of contamination, at a reset of the last one, and of the undetected time."""
    guarantee, ticks = Stage("guarantee", update_undetected_time), scenario.spreading.ticks
    if scenario.task.conservative:
        return [Stage("contamination", bound_labels), guarantee]
    stages = [Stage("labels", reset_labels, when=begins)]
    for tick in range(ticks - 1 if begins else 0, ticks):
        count, own = f" {tick + 1}" if ticks > 1 else "", {"tick": tick}
        stages.append(Stage(f"clearing{count}", clear_cells, own=own))
        stages.append(Stage(f"contamination{count}", spread, own=own))
    return [*stages, guarantee]


def _decision(rogue: Rogue | None, rogues: Any) -> list[Stage]:
    """Return the stage that computes the actions of scripted or learned rogues; none for rogues that are agents."""
    if rogue is None:
        return []
    name = f"rogue {rogue.name}"
    if isinstance(rogue.decide, wp.Kernel):
        return [Stage(name, rogue.decide)]

    def decide() -> None:
        action = np.asarray(rogue.decide(rogues.observation.numpy().copy()))
        shape = tuple(rogues.action.shape)
        if action.shape != shape or action.dtype.kind not in "fiu" or not np.isfinite(action).all():
            got = f"{action.dtype} of shape {action.shape}" if action.shape != shape else shown(action)
            raise ValueError(f"{name} must return finite numbers of shape {shape}, got {got}")
        rogues.action.assign(action.astype(np.float32))

    decide.__doc__ = rogue.about
    return [Stage(name, decide)]
