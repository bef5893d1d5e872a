"""One clock for all messages of a log: the stamps of the poses, to which the recorder's times are converted.

A message with a stamp has the time of its stamp. A message without one has the recorder's time; it is converted by the
poses of the same file, each of which has both times. So neither a constant difference of the two clocks nor a different
pace (a simulation's) changes anything.

In the order of their recording, the stamps of a robot's poses rise, except for messages that arrived late. Where they
fall and the poses in the order of their stamps would make no path, the clock went back, as when a simulator is reset;
where they jump ahead and the recorder's times do not, it was set. Such a log is refused.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np

from lissajous_env.logs.bags import Samples
from lissajous_env.logs.log import Log
from lissajous_env.logs.motion import noise_of
from lissajous_env.wording import counted

SAME_STAMP = 1e-4
"""Difference up to which two stamps of a robot's poses are the same [s]."""
_DAY = 86_400.0
"""Difference from the other stamps above which a stamp counts as not set [s]."""
_LEAST_LEAD = 1.0
"""Least difference of two clocks that a note names [s]."""
_LEAP = 10.0
"""Least time by which stamps jump ahead of the recorder's times if the clock was set [s]."""
_DETOUR = 1.5
"""Factor by which the way in the order of the stamps must exceed that in the order of the recording."""
_NOISES = 6.0
"""Standard deviations of a pose that do not count as such a way."""


class Clock:
    """The clock of a log.

    Args:
        poses: Poses of each robot.
        log: A log without tracks, whose labels are the names of the robots in notes.

    Attributes:
        poses: The poses, in the order of their recording, all with stamps on this clock.
        notes: Remarks on what is not known or seems wrong.

    Raises:
        ValueError: a clock was set while the log was recorded.
    """

    def __init__(self, poses: Sequence[Samples], log: Log):
        self._log, self.poses = log, [own.take(np.lexsort((own.stamp, own.logged, own.bag))) for own in poses]
        lacks = [_lacks_stamps(own) for own in self.poses]
        self.notes = log.grouped([
            (k, f"times of {counted(int(lack.sum()), 'pose')} without a stamp are the recorder's")
            for k, lack in enumerate(lacks) if lack.any()
        ])  # fmt: skip
        if np.concatenate(lacks).all():
            self.poses = [dataclasses.replace(own, stamp=own.logged) for own in self.poses]
            lacks = [np.zeros_like(lack) for lack in lacks]
        self._pairs, all_agreeing = {}, []
        for bag in np.unique(np.concatenate([own.bag for own in self.poses])).tolist():
            of_file = [own.take((own.bag == bag) & ~lack) for own, lack in zip(self.poses, lacks, strict=True)]
            stamped = {k: own for k, own in enumerate(of_file) if len(own)}
            for k, own in stamped.items():
                _refuse_breaks(own, f"{log.called([k])} must rise with the recorder's times in {log.name}")
            deviating = self._deviating(stamped)
            if agreeing := [own for k, own in stamped.items() if k not in deviating]:
                self._pairs[bag] = _pairs_of(agreeing)
                all_agreeing += agreeing
        self._common = _pairs_of(all_agreeing)
        for k, own in enumerate(self.poses):
            stamp = np.where(lacks[k], self.times(own), own.stamp)
            self.poses[k] = dataclasses.replace(own, stamp=stamp)

    def times(self, samples: Samples) -> np.ndarray:
        """Return the recorder's times of some samples [s] as times of this clock [s]."""
        converted = np.array(samples.logged, dtype=float)
        for number in np.unique(samples.bag).tolist():
            own = samples.bag == number
            converted[own] = _converted(samples.logged[own], *self._pairs.get(number, self._common))
        return converted

    def lead_of(self, samples: Samples, stamp: np.ndarray) -> float:
        """Return the time by which stamps of samples lead this clock [s], 0 below a second; NaN if all are equal."""
        if len(stamp) > 1 and not np.ptp(stamp) > 0:
            return np.nan
        lead = float(np.median(stamp - self.times(samples)))
        return lead if abs(lead) > _LEAST_LEAD else 0.0

    def _deviating(self, stamped: dict[int, Samples]) -> set[int]:
        """Return the robots in a file whose clocks differ from those of the others, and note them."""
        if len(stamped) < 3:  # of two clocks, either may be wrong
            return set()
        pairs = _pairs_of([max(stamped.values(), key=len)])
        leads = {k: np.median(own.stamp - _converted(own.logged, *pairs)) for k, own in stamped.items()}
        middle = sorted(leads.values())[len(leads) // 2]  # that of a robot, also of an even number
        deviating = {k: lead - middle for k, lead in leads.items() if abs(lead - middle) > _LEAST_LEAD}
        for k, ahead in deviating.items():
            got = f"{abs(ahead):.3g} s {'ahead of' if ahead > 0 else 'behind'} those of the others"
            self.notes.append(f"by the recorder's times, the clock of {self._log.called([k])} is {got}")
        return set(deviating)


def _lacks_stamps(poses: Samples) -> np.ndarray:
    """Return True for stamps that are not set: all are equal, or these a day from set ones, in value and in lead."""
    are_equal, leads = np.ptp(poses.stamp) == 0, poses.stamp - poses.logged
    far = [np.abs(times - np.median(times[(poses.stamp != 0) | are_equal])) > _DAY for times in (poses.stamp, leads)]
    return far[0] & far[1] | are_equal


def _pairs_of(poses: Sequence[Samples]) -> tuple[np.ndarray, np.ndarray]:
    """Return increasing times of the recorder, and the latest stamp of a pose until then."""
    logged, stamp = (np.concatenate([getattr(own, name) for own in poses]) for name in ("logged", "stamp"))
    order = np.lexsort((stamp, logged))
    last = np.append(np.diff(logged[order]) > 0, True)
    return logged[order][last], np.maximum.accumulate(stamp[order])[last]


def _converted(given: np.ndarray, logged: np.ndarray, stamp: np.ndarray) -> np.ndarray:
    """Return stamps at times of the recorder between pairs of both; beyond them, both clocks go at the same pace."""
    beyond = np.minimum(given - logged[0], 0) + np.maximum(given - logged[-1], 0)
    return np.interp(given, logged, stamp) + beyond


def _refuse_breaks(poses: Samples, rule: str) -> None:
    """Refuse poses of a robot, as recorded, in which its clock is set; the rule begins with its name."""
    stamp, place = poses.stamp, poses.values[:, :2]
    noise = noise_of(np.arange(len(stamp)), place)
    breaks = np.flatnonzero(np.diff(stamp) > _LEAP + 10 * np.diff(poses.logged)) + 1
    top = np.maximum.accumulate(stamp)
    late = np.flatnonzero(stamp < top - SAME_STAMP)
    for run in np.split(late, np.flatnonzero(np.diff(late) > 1) + 1) if len(late) else ():
        begin = int(run[0])
        earlier = np.arange(np.searchsorted(top, stamp[begin]), begin)
        earlier = earlier[stamp[earlier] >= stamp[begin]]
        recorded = np.concatenate([earlier, run])
        in_order = recorded[np.argsort(stamp[recorded], kind="stable")]
        least = _DETOUR * (_way(place[recorded]) + _NOISES * noise)
        if len(run) > 1 and len(earlier) > 1 and _way(place[in_order]) > least:
            breaks = np.append(breaks, begin)
    if len(breaks):
        row = breaks.min()
        jump = float(stamp[row] - stamp[row - 1])
        got = f"{abs(jump):.3g} s {'back' if jump < 0 else 'ahead'}, recorded at {poses.logged[row]:.3f} s"
        raise ValueError(
            f"the stamps of {rule}, got a jump of {got}: was a clock set, or a simulation reset? Cut the log there"
        )


def _way(place: np.ndarray) -> float:
    return float(np.nansum(np.linalg.norm(np.diff(place, axis=0), axis=1)))
