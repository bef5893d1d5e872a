"""The stages of a step and of a reset, in their order.

A stage is a kernel that goes over the worlds of a batch, or the robots, targets or rows of the grid of each world. Its
arguments are matched by the names of its parameters, among the state (`lissajous_env.world.state`) and the constants
(`lissajous_env.world.values`). It skips worlds in which `clock.active` is 0, unless it is made with
`idle=True`.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.program import Stage
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.parameters.rogues import Rogue, rogue_of
from lissajous_env.parameters.scenario import Faults, Scenario
from lissajous_env.wording import shown
from lissajous_env.world.clock import advance_clock, end_episodes, reset_arrays, reset_clock
from lissajous_env.world.contamination.conservative import bound_labels, reset_bounds
from lissajous_env.world.contamination.field import clear_cells, keep_guarantee, reset_labels, spread
from lissajous_env.world.coverage import cover
from lissajous_env.world.observing import keep_final, observe
from lissajous_env.world.robots.car import drive
from lissajous_env.world.robots.contacts import find_collisions, take_consequences, watch_walls
from lissajous_env.world.robots.deviations import find_deviations, watch_boundary
from lissajous_env.world.robots.faults import reset_losses, update_status
from lissajous_env.world.robots.nearby import clear_bins, has_bins, list_robots
from lissajous_env.world.robots.placing import draw_apart, follow_curve, reset_robots, turn_inside
from lissajous_env.world.robots.signals import hear, hear_messages, measure, send, send_messages, take_commands
from lissajous_env.world.rogues.acting import fill_rows, move_rogues, reward_rogues
from lissajous_env.world.tally import clear_events, give_reward, keep_score
from lissajous_env.world.targets.detection import move_and_detect, place_unseen
from lissajous_env.world.targets.motion import reset_arrivals, reset_targets, respawn
from lissajous_env.world.tracks import cover_known, observe_tracks, sight, update_tracks


def step_stages(scenario: Scenario, rogues: Any = None) -> list[Stage]:
    """Return the stages of a control step, with those of rogues if there are any."""
    model = model_of(scenario.robot.kind)
    return [
        Stage("clock", advance_clock),
        Stage("events", clear_events),
        Stage("faults", update_status, when=scenario.faults != Faults()),
        Stage("commands", take_commands),
        Stage("driver", drive, when=scenario.task.action == "velocity"),
        Stage("motion", model.move),
        Stage("phase", follow_curve, when=not model.keeps_to_curve),
        Stage("measurement", measure),
        Stage("sending", send),
        Stage("messages", send_messages, when=scenario.messages.size > 0),
        *_bin_stages(scenario),
        Stage("collisions", find_collisions),
        *_rogue_motion(scenario, rogues),
        *_target_stages(scenario, "targets"),
        Stage("coverage", cover, when=scenario.task.grid is not None),
        *_contamination_stages(scenario, range(scenario.spreading.ticks)),
        Stage("consequences", take_consequences, when=scenario.task.on_collision != "count"),
        Stage("boundary", watch_boundary),
        Stage("walls", watch_walls, when=scenario.task.boundary == "wall" and not model.keeps_to_curve),
        Stage("deviations", find_deviations),
        Stage("score", keep_score),
        Stage("end", end_episodes),
        Stage("reward", give_reward),
        Stage("hearing", hear),
        Stage("message hearing", hear_messages, when=scenario.messages.size > 0),
        *_track_stages(scenario),
        Stage("observation", observe),
        *_rogue_results(scenario),
    ]


def reset_stages(scenario: Scenario) -> list[Stage]:
    """Return the stages of a reset."""
    return [
        Stage("clock", reset_clock),
        Stage("arrays", reset_arrays),
        Stage("losses", reset_losses),
        Stage("robots", reset_robots),
        Stage("headway", draw_apart, when=scenario.formation.start_headway > 0),
        Stage("facing", turn_inside, when=scenario.start_turning > 0),
        Stage("measurement", measure),
        Stage("sending", send),
        Stage("messages", send_messages, when=scenario.messages.size > 0),
        Stage("targets", reset_targets),
        Stage("arrivals", reset_arrivals, when=scenario.targets.arrival_rate > 0),
        *_bin_stages(scenario),
        *_target_stages(scenario, "detection"),
        Stage("coverage", cover, when=scenario.task.grid is not None),
        Stage("labels", reset_labels, when=scenario.task.contamination is not None),
        Stage("bounds", reset_bounds, when=scenario.task.conservative),
        *_contamination_stages(scenario, [scenario.spreading.ticks - 1]),
        Stage("boundary", watch_boundary),
        Stage("deviations", find_deviations),
        Stage("score", keep_score),
        Stage("hearing", hear),
        Stage("message hearing", hear_messages, when=scenario.messages.size > 0),
        Stage("final", keep_final),
        *_track_stages(scenario),
        Stage("observation", observe),
        *_rogue_results(scenario),
    ]


def _track_stages(scenario: Scenario) -> list[Stage]:
    """Return the stages in which robots remember what they observe and cover, and what they hear of the others."""
    there = scenario.sensing.has_tracks
    return [
        Stage("sighting", sight, when=there),
        Stage("tracking", update_tracks, when=there),
        Stage("tracks", observe_tracks, when=there),
        Stage("cells", cover_known, when=scenario.sensing.cells_seen is not None),
    ]


def _bin_stages(scenario: Scenario) -> list[Stage]:
    """Return the stages that list the robots near each bin."""
    many = has_bins(scenario)
    return [Stage("bins", clear_bins, when=many), Stage("listing", list_robots, when=many)]


def _target_stages(scenario: Scenario, name: str) -> list[Stage]:
    """Return the stages in which targets appear, and the stage of this name, in which they move and are detected."""
    unseen = scenario.targets.entry == "unseen"
    return [
        Stage("respawn", respawn, when=scenario.targets.respawn),
        Stage("entry", place_unseen, when=unseen),
        Stage(name, move_and_detect),
    ]


def _contamination_stages(scenario: Scenario, ticks: Iterable[int]) -> list[Stage]:
    """Return the stages of each tick of contamination, then that of the worst-case undetected time."""
    if scenario.task.contamination is None:
        return []
    if scenario.task.conservative:
        return [Stage("contamination", bound_labels), Stage("guarantee", keep_guarantee)]
    stages = []
    for tick in ticks:
        count, own = f" {tick + 1}" if scenario.spreading.ticks > 1 else "", {"tick": tick}
        stages.append(Stage(f"clearing{count}", clear_cells, own=own))
        stages.append(Stage(f"contamination{count}", spread, own=own))
    return [*stages, Stage("guarantee", keep_guarantee)]


def _rogue_motion(scenario: Scenario, rogues: Any) -> list[Stage]:
    """Return the stages in which scripted rogues decide, and all rogues move."""
    if scenario.targets.rogues is None:
        return []
    rogue = rogue_of(scenario.targets.rogues)
    decides = [] if rogue is None else [_decision(rogue, rogues)]
    return [*decides, Stage("rogues", move_rogues)]


def _decision(rogue: Rogue, rogues: Any) -> Stage:
    """Return the stage in which a scripted or learned rogue decides."""
    name = f"rogue {rogue.name}"
    if isinstance(rogue.decide, wp.Kernel):
        return Stage(name, rogue.decide)

    def decide() -> None:
        action = np.asarray(rogue.decide(rogues.observation.numpy().copy()))
        shape = tuple(rogues.action.shape)
        if action.shape != shape or action.dtype.kind not in "fiu" or not np.isfinite(action).all():
            got = f"{action.dtype} of shape {action.shape}" if action.shape != shape else shown(action)
            raise ValueError(f"{name} must return finite numbers of shape {shape}, got {got}")
        rogues.action.assign(action.astype(np.float32))

    decide.__doc__ = rogue.about
    return Stage(name, decide)


def _rogue_results(scenario: Scenario) -> list[Stage]:
    """Return the stages in which rogues are rewarded and observe."""
    is_on = scenario.targets.rogues is not None
    return [
        Stage("rogue reward", reward_rogues, when=is_on),
        Stage("rogue observation", fill_rows, when=is_on),
    ]
