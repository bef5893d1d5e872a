"""Remarks on a log for readers of its scores: what is not known, and what seems wrong."""

from collections.abc import Sequence

import numpy as np

from lissajous_env.logs.log import Log
from lissajous_env.logs.motion import Motion
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.state import REMOVED

_FAR = 5.0
"""Distance from the origin in sizes of the rectangle, from which on the log is in another frame."""
_MOST = 3
"""Number of gaps and jumps of a robot that are listed."""


def remarks(
    log: Log, scenario: Scenario, motions: Sequence[Motion], times: np.ndarray, status: np.ndarray
) -> list[str]:
    """Return notes on the gaps, jumps, speeds, headings and places of the robots in an episode at some times [s]."""
    words = []
    for robot, motion in enumerate(motions):
        was_removed = bool((status[:, robot] == int(REMOVED)).any())
        words += [(robot, said) for said in _gaps(motion, times, was_removed)]
    notes = log.grouped(words)
    reasons = dict.fromkeys(motion.derived for motion in motions if motion.derived)
    for reason in reasons:
        those = log.called([robot for robot, motion in enumerate(motions) if motion.derived == reason])
        notes.append(f"the speeds of {those} {reason}; they are computed from the poses")
    if headless := [robot for robot, motion in enumerate(motions) if motion.headless]:
        notes.append(f"the headings of {log.called(headless)} are unknown; they are those of the motion")
    if turned := [robot for robot, motion in enumerate(motions) if motion.turned]:
        notes.append(f"{log.called(turned)} do not drive along their headings")
    half = scenario.curve.half_width, scenario.curve.half_height
    middle = np.median([np.median(motion.track.position[:, :2], axis=0) for motion in motions], axis=0)
    if np.linalg.norm(middle) > _FAR * sum(half):
        words = f"the robots are around x = {middle[0]:.6g} m, y = {middle[1]:.6g} m, far from the rectangle"
        notes.append(f"{words}: give the pose of its middle in the frame of the log by --origin X Y HEADING")
    return notes


def _gaps(motion: Motion, times: np.ndarray, was_removed: bool) -> list[str]:
    """Return notes on the times at which the motion of a robot is not known."""
    time, first, last = motion.track.time, float(times[0]), float(times[-1])
    unknown = np.flatnonzero(~motion.known)
    unknown = unknown[(time[unknown] < last) & (time[unknown + 1] > first)]
    jumps, notes = np.intersect1d(motion.jumps, unknown), []
    gaps = [(max(float(time[k]), first), min(float(time[k + 1]), last)) for k in np.setdiff1d(unknown, jumps)]
    if gaps:
        those = _listed([f"{begin:.3f} to {end:.3f} s" for begin, end in gaps])
        total = sum(end - begin for begin, end in gaps)
        notes.append(f"gaps of {total:.3g} s in all ({those}) count as failures")
    if len(jumps):
        ways = np.linalg.norm(np.diff(motion.track.position, axis=0), axis=1)
        those = _listed([f"{ways[k]:.3g} m at {time[k]:.3f} s" for k in jumps])
        notes.append(f"jumps that no robot of the scenario can drive ({those}) count as failures")
    if time[-1] < last - 1e-6 and not was_removed:
        notes.append(f"no pose after {time[-1]:.3f} s, which counts as a failure from then on")
    return notes


def _listed(words: Sequence[str]) -> str:
    more = len(words) - _MOST
    return ", ".join(words[:_MOST]) + (f" and {more} more" if more > 0 else "")
