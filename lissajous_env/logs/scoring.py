"""Score a log of robots as the simulation scores its own."""

import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lissajous_env.episodes.recording import Recorder, Recording
from lissajous_env.logs.car_input import actions_of
from lissajous_env.logs.log import Log, Track
from lissajous_env.logs.prescribed import PrescribedSimulation
from lissajous_env.parameters import named
from lissajous_env.parameters.plain_scenario import scenario_of
from lissajous_env.parameters.robot_models import model_of
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.theory.locating import locate
from lissajous_env.wording import shown
from lissajous_env.world.state import REMOVED, STUCK, WORKING

GAP = 0.5
"""Longest time between two poses of a robot during which it counts as working, by default [s]."""
_SAME = 1e-6
"""Difference up to which two times are the same [s]."""
OF_ACTIONS = ("return_mean", "smoothness")
"""Columns that cannot be computed without the commands."""


@dataclass(frozen=True)
class Scored:
    """A log that has been scored."""

    scenario: Scenario
    """The scenario that was scored: that of the log or a given one, with the faults and the duration of the log."""
    rows: list[dict[str, Any]]
    """A score row for each seed of the virtual targets."""
    recording: Recording
    """The episode of the first of these seeds."""
    start: float
    """Time of the log at which the episode begins [s]."""
    notes: tuple[str, ...]
    """Remarks for readers of the scores."""
    found: np.ndarray
    """Times until the virtual targets were detected, of all rows [s]."""
    unfound: np.ndarray
    """Times for which the others were present [s]."""


def own_scenario(log: Log) -> Scenario | None:
    """Return the scenario in a log that a simulation wrote; None for any other log.

    Raises:
        ValueError: it is damaged.
    """
    if log.episode is None:
        return None
    try:
        return scenario_of(log.episode["scenario"])
    except (KeyError, TypeError) as error:
        raise ValueError(f"log {log.name} must contain a whole scenario: {error}") from error


def score(
    log: Log,
    scenario: str | Scenario | None = None,
    seeds: Sequence[int] | None = None,
    gap: float = GAP,
    on_step: Callable[[], None] | None = None,
) -> Scored:
    """Score a log: its robots' paths are replayed in a simulation of a scenario, whose targets are virtual.

    Poses are interpolated at the control steps of the scenario, beginning with the first time at which all robots have
    one. A robot fails when its status in the log says so, and when it has no pose for longer than `gap`: it then counts
    as blind.

    Args:
        log: The log.
        scenario: The scenario; by default that of the log, where a simulation wrote it.
        seeds: Seeds of the virtual targets, one episode each; by default that of the log or 0.
        gap: Longest time without a pose during which a robot counts as working [s].
        on_step: Called after each step.

    Raises:
        ValueError: there is no scenario, or the log does not fit it: another number of robots, or too short.
    """
    own = own_scenario(log)
    given = named.scenario(scenario) if scenario is not None else own
    if given is None:
        raise ValueError(f"scenario must be given, because the log {log.name} has none")
    made = given.resolve()
    if len(log.tracks) != made.num_robots:
        raise ValueError(f"log {log.name} must have the {made.num_robots} robots of {made.name}, got {len(log.tracks)}")
    times = _moments(log, made.task.step)
    status, notes = _statuses(log, times, gap)
    made = _as_logged(made, times, status)
    if seeds is None:
        seeds = [int(log.episode["seed"]) if log.episode else 0]
    simulation = _simulation(log, made, times, len(seeds))
    simulation.reset(seeds=np.array(list(seeds)))
    actions = _actions(log, made, times)
    recorder = Recorder(simulation)
    recorder.take()
    for moment in range(1, len(times)):
        action = np.zeros(simulation.action_shape[1:], np.float32) if actions is None else actions[moment - 1]
        simulation.step(np.broadcast_to(action, simulation.action_shape).astype(np.float32))
        recorder.take()
        if on_step is not None:
            on_step()
    name = str((log.episode or {}).get("policy") or log.name)
    unknown = dict.fromkeys(OF_ACTIONS, float("nan")) if actions is None else {}
    if unknown:
        notes = (*notes, f"{' and '.join(OF_ACTIONS)} are unknown without commands")
    rows = [
        {"policy": name, "episode": k} | row | unknown for k, row in enumerate(simulation.score(np.arange(len(seeds))))
    ]
    recording = recorder.recording(name)
    recording = dataclasses.replace(recording, score=recording.score | unknown)
    waited = [simulation.detection_times(world) for world in range(len(seeds))]
    found, unfound = (np.concatenate([each[known == kept] for each, known in waited]) for kept in (True, False))
    return Scored(made, rows, recording, float(times[0]), notes, found, unfound)


def _moments(log: Log, step: float) -> np.ndarray:
    """Return the times at which the scenario's steps begin and end [s]."""
    steps = int((log.end - log.start) / step + _SAME)
    if steps < 1:
        raise ValueError(
            f"log {log.name} must have poses of all robots for at least a control step of {step:g} s, "
            f"got {max(log.end - log.start, 0):.3g} s"
        )
    return log.start + step * np.arange(steps + 1)


def _statuses(log: Log, times: np.ndarray, gap: float) -> tuple[np.ndarray, tuple[str, ...]]:
    """Return the status (M, N) of each robot at each moment, and notes on gaps."""
    if not gap > 0:
        raise ValueError(f"gap must be above 0 [s], got {shown(gap)}")
    status, notes = np.full((len(times), len(log.tracks)), int(WORKING)), []
    for robot, track in enumerate(log.tracks):
        if robot in log.statuses:
            status[:, robot] = log.statuses[robot].before(times)
        place = np.clip(np.searchsorted(track.time, times - _SAME), 1, len(track) - 1)
        blind = np.diff(track.time)[place - 1] > gap
        if blind.any():
            lost = (times[1] - times[0]) * int(blind.sum())
            notes.append(f"robot {robot} has gaps of {lost:.3g} s in all, in which it counts as failed")
        status[blind & (status[:, robot] == int(WORKING)), robot] = int(STUCK)
    return status, tuple(notes)


def _as_logged(scenario: Scenario, times: np.ndarray, status: np.ndarray) -> Scenario:
    """Return a scenario with the duration of a log and with the faults of its robots, and no others."""
    step, schedule, removed = scenario.task.step, [], []
    for robot in range(status.shape[1]):
        gone = np.flatnonzero(status[:, robot] == int(REMOVED))
        if len(gone):
            removed.append((robot, max(int(gone[0]) - 1, 0) * step))
        failed = np.concatenate([[0], status[1:, robot] == int(STUCK), [0]]).astype(int)
        edges = np.flatnonzero(np.diff(failed))
        schedule += [(robot, *(edge * step for edge in fault)) for fault in edges.reshape(-1, 2).tolist()]
    faults = dataclasses.replace(scenario.faults, schedule=tuple(schedule), removed=tuple(removed), rate=0.0, lost=0)
    # Whatever a wall or a collision did to the robots, the log shows it.
    task = dataclasses.replace(scenario.task, duration=(len(times) - 1) * step, boundary="open", on_collision="count")
    return dataclasses.replace(scenario, faults=faults, task=task)


def _simulation(log: Log, scenario: Scenario, times: np.ndarray, num_worlds: int) -> PrescribedSimulation:
    substeps = scenario.task.substeps
    before = np.linspace(0, 1, substeps + 1)[None, :] * scenario.task.step + (times - scenario.task.step)[:, None]
    before[:, -1], before[1:, 0] = times, times[:-1]
    tracks, headings, speeds, phases = [], [], [], []
    for robot, track in enumerate(log.tracks):
        places, _, _ = resampled(track, np.maximum(before, times[0]).ravel())
        _, heading, speed = resampled(track, times)
        tracks.append(places.reshape(len(times), substeps + 1, 3))
        headings.append(heading)
        speeds.append(speed)
        phases.append(_phases(log, scenario, robot, times, places[0], float(heading[0])))
    # The phase of a point is its place; that of a car follows from its path.
    known = model_of(scenario.robot.kind).keeps_to_curve and len(log.phases) == len(log.tracks)
    phase = np.stack(phases, axis=1)[: None if known else 1]
    paths = np.stack(tracks, axis=1), np.stack(headings, axis=1), np.stack(speeds, axis=1)
    return PrescribedSimulation(scenario, *paths, phase, num_worlds=num_worlds)


def _phases(
    log: Log, scenario: Scenario, robot: int, times: np.ndarray, place: np.ndarray, heading: float
) -> np.ndarray:
    """Return the phases of a robot in a log, or once that of the pose with which it begins."""
    if robot in log.phases:
        return log.phases[robot].before(times)
    x, y, near = float(place[0]), float(place[1]), float(scenario.equilibrium[robot])
    return np.full(len(times), locate(scenario.curve, scenario.alpha, x, y, heading, near))


def resampled(track: Track, times: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places (K, 3) [m], headings and speeds (K,) of a track at some times, by cubic Hermite interpolation.

    At the times of its poses they are those poses, to the last bit.
    """
    k = np.clip(np.searchsorted(track.time, times + _SAME, side="right") - 1, 0, len(track) - 2)
    width = np.diff(track.time)[k]
    share = np.clip((times - track.time[k]) / width, 0, 1)
    share = np.where(np.abs(times - track.time[k]) < _SAME, 0.0, share)
    share = np.where(np.abs(times - track.time[k + 1]) < _SAME, 1.0, share)
    along = np.stack([np.cos(track.heading), np.sin(track.heading), 0 * track.heading], axis=1)
    velocity = along * track.speed[:, None]
    s, w = share[:, None], width[:, None]
    way = np.diff(track.position, axis=0)[k]
    bend = s * (1 - s) * ((1 - s) * w * velocity[k] - s * w * velocity[k + 1] + (2 * s - 1) * way)
    linear = np.where(s < 1, track.position[k] + s * way, track.position[k + 1])
    between = [
        np.where(share < 1, values[k] + share * np.diff(values)[k], values[k + 1])
        for values in (track.heading, track.speed)
    ]
    return linear + bend, between[0], between[1]


def _actions(log: Log, scenario: Scenario, times: np.ndarray) -> np.ndarray | None:
    """Return the actions (M - 1, N, A) of a log with the commands of every robot; None for another."""
    if len(log.commands) < scenario.num_robots:
        return None
    commands = np.stack([log.commands[robot].before(times[:-1]) for robot in range(scenario.num_robots)], axis=1)
    if commands.shape[-1] != scenario.action_size:
        return None
    if scenario.robot.kind == "car":
        commands[..., :2] = actions_of(scenario.robot, np.ascontiguousarray(commands[..., :2]))
    return np.clip(commands, -1, 1)
