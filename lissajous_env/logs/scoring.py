"""Score a log of robots as the simulation scores its own."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from lissajous_env.episodes.recording import Recorder, Recording
from lissajous_env.logs.commands import COMMAND_NAMES, actions_of_commands, named_commands
from lissajous_env.logs.log import Log, Series
from lissajous_env.logs.motion import Motion, motion_of
from lissajous_env.logs.prescribed import COLLISION, EDGE, FAULT, PrescribedSimulation
from lissajous_env.logs.writing import episode_of
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.scenario_file import scenario_of_json
from lissajous_env.theory import closed_forms
from lissajous_env.theory.geometry import locate
from lissajous_env.wording import require
from lissajous_env.world.state import FAILED, REMOVED, WORKING

_MOST_STEPS = 200_000
"""Largest number of control steps of a log."""
_FAR = 5.0
"""Least distance from the origin, in sizes of the rectangle, at which a note says that an origin may be missing."""
_SHORTER = 1e-6
"""Share of a step by which a log may be shorter than a number of them."""
_REACHED = 0.02
"""Share of two radii by which the distance of robots that collide may exceed them, because ways are not straight."""
_LATE_STATUS = 0.2
"""Share of a control step by which a status or a phase may be recorded after the pose that it belongs to."""
_OF_ACTIONS = ("return_mean", "smoothness", "blocked_time")
"""Columns that cannot be computed without the commands."""


@dataclass(frozen=True)
class Scored:
    """A log that has been scored."""

    rows: list[dict[str, Any]]
    """A score row for each seed of the virtual targets."""
    recording: Recording
    """The episode of the first of these seeds, or its first moment alone, in the scenario with the log's duration."""
    log: Log
    """The log with this scenario, and without commands that do not fit it."""
    notes: tuple[str, ...]
    """Remarks for readers of the scores."""


def own_scenario(log: Log) -> Scenario | None:
    """Return the scenario in a log that a simulation wrote; None for any other log.

    Raises:
        ValueError: it is damaged.
    """
    return None if log.episode is None else scenario_of_json(log.episode["scenario"])


def score(
    log: Log,
    scenario: str | Scenario | None = None,
    seeds: Sequence[int] | None = None,
    gap: float | None = None,
    on_step: Callable[[], None] = lambda: None,
    recorded: bool = True,
) -> Scored:
    """Score a log: its robots' paths are replayed in a simulation of a scenario, whose targets are virtual.

    Poses that no simulation wrote are smoothed as far as they are noisy. They are interpolated at the control steps of
    the scenario, beginning with the first time at which all robots have one. A robot fails when its status in the log
    says so, and when its motion is not known: between two poses that are farther apart than `gap`, or than it can
    drive, and after its last one. It then detects nothing and collides with nothing.

    Args:
        log: The log.
        scenario: The scenario; by default that of the log, where a simulation wrote it.
        seeds: Seeds of the virtual targets, one episode each; by default that of the log or 0.
        gap: Longest time without a pose during which a robot counts as working [s]; by default 0.5 s, or the control
            step if that is longer.
        on_step: Called after each step.
        recorded: True for a recording of all moments; its size is limited, and a long log may exceed it.

    Raises:
        ValueError: there is no scenario, or the log does not fit it: another number of robots, or too short or long.
    """
    given = named.scenario(scenario) if scenario is not None else own_scenario(log)
    if given is None:
        raise ValueError(f"scenario must be given, because the log {log.name} has none")
    scenario = given.resolve()
    if len(log.tracks) != scenario.num_robots:
        got = "; ".join((f"{len(log.tracks)}: {log.called(range(len(log.tracks)))}", *log.notes))
        raise ValueError(f"log {log.name} must have the {scenario.num_robots} robots of {scenario.name}, got {got}")
    gap = max(0.5, scenario.task.step) if gap is None else gap
    require(gap >= scenario.task.step, "gap", f"must be at least the control step of {scenario.task.step:g} s", gap)
    times = _moments(log, scenario.task.step, gap)
    motions = _motions(log, scenario, gap)
    paths = _paths(log, scenario, motions, times)
    if not log.phases:
        paths["phase"][0] = _in_formation(scenario, paths["phase"][0])
    status = _statuses(log, times, paths["hidden"])
    cause = np.where(paths["hidden"], FAULT, _causes(scenario, paths["path"], status))
    task = dataclasses.replace(scenario.task, duration=(len(times) - 1) * scenario.task.step)
    scenario = dataclasses.replace(scenario, task=task)
    seeds = [int((log.episode or {}).get("seed", 0))] if seeds is None else list(seeds)
    simulation = PrescribedSimulation(scenario, paths | {"status": status, "cause": cause}, len(seeds))
    simulation.reset(seeds=seeds)
    actions, refused = _actions(log, scenario, times)
    notes = [*log.notes, *_remarks(log, scenario, motions, times, status), *refused]
    recorder = Recorder(simulation)
    recorder.take()
    for moment in range(1, len(times)):
        action = np.zeros(simulation.action_shape[1:], np.float32) if actions is None else actions[moment - 1]
        simulation.step(np.broadcast_to(action, simulation.action_shape).astype(np.float32))
        if recorded:
            recorder.take()
        on_step()
        if simulation.over.all():  # every robot was removed
            break
    name = str((log.episode or {}).get("policy") or log.name)
    unknown = dict.fromkeys(_OF_ACTIONS, float("nan")) if actions is None else {}
    if unknown:
        notes.append(f"{', '.join(_OF_ACTIONS[:-1])} and {_OF_ACTIONS[-1]} are unknown without commands")
    rows = [{"policy": name, "episode": k} | row | unknown for k, row in enumerate(simulation.score())]
    recording = dataclasses.replace(recorder.recording(name), scenario=scenario, score=rows[0])
    episode = (log.episode or {"policy": ""}) | episode_of(scenario, int(seeds[0]))
    scored = dataclasses.replace(log, episode=episode, begin=log.start, commands={} if unknown else log.commands)
    return Scored(rows, recording, scored, tuple(notes))


def _moments(log: Log, step: float, gap: float) -> np.ndarray:
    """Return the times at which the scenario's steps begin and end [s].

    The last one ends with the poses of a robot: the first of those whose poses end within gaps of one another at the
    end of the log, so that none fails shortly before. If all robots were removed, it ends with the episode of the log's
    own scenario, if that is longer.
    """
    firsts, ends = ([float(track.time[place]) for track in log.tracks] for place in (0, -1))
    lasts = np.sort(ends)
    last = lasts[np.append(True, np.diff(lasts) > gap)][-1]
    steps = math.floor((last - log.start) / step + _SHORTER)
    removed = [robot for robot, status in log.statuses.items() if REMOVED in status.value]
    if len(removed) == len(log.tracks) and (own := own_scenario(log)) is not None:
        steps = max(steps, round(own.task.duration / step))
    late, early = int(np.argmax(firsts)), int(np.argmin(ends))
    if steps < 1 or firsts[late] >= ends[early]:
        raise ValueError(
            f"log {log.name} must have poses of all robots for at least a control step of {step:g} s, got those of "
            f"{log.called([late])} from {firsts[late]:.3f} s on and those of {log.called([early])} until "
            f"{ends[early]:.3f} s: is a clock set wrong?"
        )
    if steps > _MOST_STEPS:
        longest, robot = max((float(np.diff(track.time).max()), k) for k, track in enumerate(log.tracks))
        raise ValueError(
            f"log {log.name} must last at most {_MOST_STEPS:,} control steps of {step:g} s, got {steps:,}; the longest "
            f"time without a pose is {longest:.6g} s, of {log.called([robot])}"
        )
    return log.start + step * np.arange(steps + 1)


def _motions(log: Log, scenario: Scenario, gap: float) -> list[Motion]:
    """Return the motion of each robot, in the plane if the scenario is flat."""
    axes, is_simulated = (1, 1, scenario.curve.half_depth > 0), bool((log.episode or {}).get("policy"))
    # A car whose weak motor does not drive it may begin at the formation's speed.
    speeds = np.maximum(scenario.top_speeds, scenario.robot.top_speed)
    tracks = [dataclasses.replace(track, position=track.position * axes) for track in log.tracks]
    tracks = tracks if is_simulated else [track.without_repeats(gap) for track in tracks]
    pairs, radius = zip(tracks, speeds, strict=True), scenario.robot.radius
    return [motion_of(track, gap, speed, radius, trusted=is_simulated) for track, speed in pairs]


def _remarks(
    log: Log, scenario: Scenario, motions: Sequence[Motion], times: np.ndarray, status: np.ndarray
) -> list[str]:
    """Return remarks on the motion of the robots."""
    removed = (status == REMOVED).any(axis=0)
    words = [motion.remarks(times[0], times[-1], gone) for motion, gone in zip(motions, removed, strict=True)]
    notes = log.grouped([(robot, word) for robot, own in enumerate(words) for word in own])
    x, y = np.median([np.median(motion.track.position[:, :2], axis=0) for motion in motions], axis=0)
    if np.hypot(x, y) > _FAR * (scenario.curve.half_width + scenario.curve.half_height):
        far = f"the robots are around x = {x:.6g} m, y = {y:.6g} m, far from the rectangle"
        notes.append(f"{far}: give the pose of its middle in the frame of the log by --origin X Y HEADING")
    return notes


def _statuses(log: Log, times: np.ndarray, hidden: np.ndarray) -> np.ndarray:
    """Return the status (M, N) of each robot at each moment; one of which nothing is known has failed.

    A robot that was removed remains so.
    """
    status = np.full(hidden.shape, WORKING)
    for robot, series in log.statuses.items():
        status[:, robot] = series.in_force(times, _LATE_STATUS * (times[1] - times[0]), WORKING)
    status[hidden & (status == WORKING)] = FAILED
    status[np.logical_or.accumulate(status == REMOVED)] = REMOVED
    return status


def _causes(scenario: Scenario, path: np.ndarray, status: np.ndarray) -> np.ndarray:
    """Return the causes (M, N) of the statuses: FAULT, COLLISION or EDGE.

    A collision is a cause if a robot of another place is in reach on the way and no later status is WORKING. A robot
    that was removed without one in reach left at the edge if it moved in this step; otherwise a fault removed it.
    """
    others = np.not_equal.outer(scenario.places, scenario.places)  # robots of one place overlap by design
    cause, reach = np.full(status.shape, FAULT), 2 * (1 + _REACHED) * scenario.robot.radius
    effect = {"stop": FAILED, "remove": REMOVED}.get(scenario.task.on_collision)
    for last, robot in np.argwhere(status[1:] != status[:-1]):
        moment, positions = last + 1, path[last + 1]
        now = status[moment, robot]
        away = positions - positions[robot]
        begin, way = away[:, :-1], np.diff(away, axis=1)
        share = np.clip(-(begin * way).sum(axis=2) / np.maximum((way**2).sum(axis=2), 1e-12), 0, 1)
        near = (np.linalg.norm(begin + share[..., None] * way, axis=2) < reach).any(axis=1) & others[robot]
        if now == effect and (near & (status[last] != REMOVED)).any():
            cause[moment, robot] = COLLISION if (status[moment:, robot] != WORKING).all() else FAULT
        elif now == REMOVED and (positions[robot, 0] != positions[robot, -1]).any():
            cause[moment, robot] = EDGE
    return cause


def _paths(log: Log, scenario: Scenario, motions: Sequence[Motion], times: np.ndarray) -> dict[str, np.ndarray]:
    """Return the fields of `lissajous_env.logs.prescribed.Paths` but the statuses and their causes."""
    shares, columns = np.linspace(0, 1, scenario.task.substeps + 1), []
    before = np.append(times[0], times[:-1])
    within = np.linspace(before, times, len(shares), axis=1)
    for robot, motion in enumerate(motions):
        places, headings, speeds = (
            values.reshape(*within.shape, *values.shape[1:]) for values in motion.at(within.ravel())
        )
        hidden, known = motion.unknown(before, times), ~motion.unknown(times, times)
        if known.any():  # where a step is not wholly known, on straight lines between the moments around it
            lines = [np.interp(within, times[known], places[known, -1, axis]) for axis in range(3)]
            places = np.where(hidden[:, None, None], np.stack(lines, axis=-1), places)
        pose = np.column_stack([places[:, -1, :2], headings[:, -1]])
        phase = _phases(log, scenario, robot, times, pose, hidden)
        if scenario.model.keeps_to_curve and robot in log.phases:
            turn = np.angle(np.exp(1j * np.diff(phase, prepend=phase[0])))
            between = phase[:, None] + (shares - 1) * turn[:, None]
            places[:, 1:-1] = closed_forms.curve_point_3d(scenario.driven, scenario.alpha * between[:, 1:-1])
        own = {"path": places, "heading": headings[:, -1], "speed": speeds[:, -1], "phase": phase, "hidden": hidden}
        columns.append(own)
    return {name: np.stack([column[name] for column in columns], axis=1) for name in columns[0]}


def _in_formation(scenario: Scenario, phase: np.ndarray) -> np.ndarray:
    """Return the phases (N,) of the same places that are nearest to a common rotation of those at the start."""
    start = scenario.equilibrium + scenario.displacements
    away = np.exp(1j * scenario.alpha * (phase - start))
    rotation = np.angle(away.sum())
    return start + (rotation + np.angle(away * np.exp(-1j * rotation))) / scenario.alpha


def _phases(
    log: Log, scenario: Scenario, robot: int, times: np.ndarray, pose: np.ndarray, hidden: np.ndarray
) -> np.ndarray:
    """Return the phases (M,) of a robot with poses (M, 3); NaN where they follow from its path, as between gaps.

    The phase of a robot that is bound to the curve is its place, so that all of its logged phases count.
    """
    begins, logged = np.append(True, hidden[:-1] & ~hidden[1:]), log.phases.get(robot)
    if logged is not None:
        counts = begins | hidden | scenario.model.keeps_to_curve
        return np.where(counts, logged.in_force(times, _LATE_STATUS * scenario.task.step), np.nan)
    phase = np.full(len(times), np.nan)
    near = float(scenario.equilibrium[robot] + scenario.displacements[robot])
    for k in np.flatnonzero(begins):
        x, y, heading = pose[k].tolist()
        phase[k] = locate(scenario.driven, scenario.alpha, x, y, heading, near)
    return phase


def _actions(log: Log, scenario: Scenario, times: np.ndarray) -> tuple[np.ndarray | None, list[str]]:
    """Return the actions (M - 1, N, A) of a log with the commands of every robot, or None, and notes."""
    if len(log.commands) < scenario.num_robots:
        return None, []
    commands = []
    for robot, series in sorted(log.commands.items()):
        try:
            own = Series(series.time, named_commands(series, scenario.action_names))
        except ValueError as error:
            return None, [f"the commands are ignored, because of {log.called([robot])}: {error}"]
        # A command that arrives in the first half of a step is the one in force for most of it.
        commands.append(own.in_force(times[:-1], 0.499 * scenario.task.step))
    actions = np.stack(commands, axis=1)
    if scenario.robot.kind in COMMAND_NAMES:
        actions[..., :2] = actions_of_commands(scenario.robot, actions[..., :2])
    return np.clip(actions, -1, 1), []
