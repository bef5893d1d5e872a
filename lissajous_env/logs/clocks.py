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

from lissajous_env.logs.log import Log, runs
from lissajous_env.logs.samples import Table

SAME = 1e-4
"""Difference up to which two stamps of a robot's poses are the same [s]."""
_DAY = 86_400.0
"""Difference from the other stamps from which on a stamp counts as not set [s]."""
_LAG = 1.0
"""Difference of two clocks from which on a note names them [s]."""
_LEAP = 10.0
"""Time by which stamps jump ahead while the recorder's times do not [s], from which on the clock was set."""
_DETOUR = 1.5
"""Factor by which the way in the order of the stamps must exceed that in the order of the recording."""


class Clock:
    """The clock of a log.

    Args:
        poses: Poses of each robot.
        log: Names of the robots.

    Attributes:
        poses: The poses, in the order of their recording, all with stamps on this clock.
        notes: Remarks on what is not known or seems wrong.

    Raises:
        ValueError: a clock was set while the log was recorded.
    """

    def __init__(self, poses: Sequence[Table], log: Log):
        self._log, self.poses = log, [own.take(np.lexsort((own.stamp, own.logged, own.bag))) for own in poses]
        lacks = [_lacks_stamps(own.stamp) for own in self.poses]
        self.notes = log.grouped([
            (k, f"{int(lack.sum())} poses have no stamps; their times are the recorder's")
            for k, lack in enumerate(lacks) if lack.any()
        ])  # fmt: skip
        if np.concatenate(lacks).all():
            self.poses = [dataclasses.replace(own, stamp=own.logged) for own in self.poses]
            lacks = [~lack for lack in lacks]
        stamped = {k: own.take(~lacks[k]) for k, own in enumerate(self.poses) if not lacks[k].all()}
        for k, own in stamped.items():
            self._refuse_breaks(k, own)
        deviating = self._deviating(stamped)
        self._pairs = _pairs_of([own for k, own in stamped.items() if k not in deviating])
        for k, own in enumerate(self.poses):
            stamp = np.where(lacks[k], self.times(own.bag, own.logged), own.stamp)
            self.poses[k] = dataclasses.replace(own, stamp=stamp)

    def times(self, bag: np.ndarray, logged: np.ndarray) -> np.ndarray:
        """Return times of the recorder of some files [s] as times of this clock [s]."""
        converted = np.array(logged, dtype=float)
        for number in np.unique(bag).tolist():
            converted[bag == number] = _converted(logged[bag == number], *self._pairs.get(number, self._pairs[-1]))
        return converted

    def differs(self, bag: np.ndarray, logged: np.ndarray, stamp: np.ndarray) -> float:
        """Return by how much stamps are ahead of this clock [s], 0 for less than a second; NaN if they do not rise."""
        if len(stamp) > 1 and not np.ptp(stamp) > 0:
            return np.nan
        ahead = float(np.median(stamp - self.times(bag, logged)))
        return ahead if abs(ahead) > _LAG else 0.0

    def _refuse_breaks(self, robot: int, stamped: Table) -> None:
        """Refuse a log in which the clock of a robot's poses is set.

        Raises:
            ValueError: the stamps go back, or ahead without the recorder's times.
        """
        for poses in _by_file(stamped).values():
            row = _first_break(poses)
            if row is not None:
                jump = float(poses.stamp[row] - poses.stamp[row - 1])
                got = f"{abs(jump):.3g} s {'back' if jump < 0 else 'ahead'}, recorded at {poses.logged[row]:.3f} s"
                called = self._log.called([robot])
                raise ValueError(
                    f"the stamps of {called} must rise with the recorder's times in {self._log.name}, got a jump of "
                    f"{got}: was a clock set, or a simulation reset? Cut the log there"
                )

    def _deviating(self, stamped: dict[int, Table]) -> set[int]:
        """Return the robots whose clocks differ from those of the others by the recorder's times, and note them."""
        files: dict[int, dict[int, Table]] = {}
        for k, poses in stamped.items():
            for bag, own in _by_file(poses).items():
                files.setdefault(bag, {})[k] = own
        deviating: set[int] = set()
        for own in files.values():
            pairs = _pairs_of([max(own.values(), key=len)])[-1]
            lags = {k: np.median(poses.stamp - _converted(poses.logged, *pairs)) for k, poses in own.items()}
            middle = np.median(list(lags.values()))
            # Of two clocks, nobody knows which one is off.
            for k, lag in lags.items() if len(own) > 2 else ():
                if abs(lag - middle) > _LAG:
                    deviating.add(k)
                    ahead = f"{abs(lag - middle):.3g} s {'ahead of' if lag > middle else 'behind'}"
                    words = f"by the recorder's times, the clock of {self._log.called([k])} is {ahead}"
                    self.notes.append(f"{words} those of the others")
        return deviating


def _lacks_stamps(stamp: np.ndarray) -> np.ndarray:
    """Return True for stamps of a robot that were never set, or not before the first message of a simulator's clock."""
    return (np.abs(stamp - np.median(stamp)) > _DAY) | (np.ptp(stamp) == 0)


def _by_file(poses: Table) -> dict[int, Table]:
    """Return the poses in each file."""
    return {int(bag): poses.take(poses.bag == bag) for bag in np.unique(poses.bag)}


def _pairs_of(poses: Sequence[Table]) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """Return increasing times of the recorder, and the latest stamp of a pose until then, by file; at -1 of all."""
    bag, logged, stamp = (np.concatenate([getattr(own, name) for own in poses]) for name in ("bag", "logged", "stamp"))
    pairs = {}
    for number in (-1, *np.unique(bag).tolist()):
        chosen = np.ones(len(bag), bool) if number < 0 else bag == number
        order = np.lexsort((stamp[chosen], logged[chosen]))
        in_order = logged[chosen][order]
        last = np.append(np.diff(in_order) > 0, True)
        pairs[number] = in_order[last], np.maximum.accumulate(stamp[chosen][order])[last]
    return pairs


def _converted(given: np.ndarray, logged: np.ndarray, stamp: np.ndarray) -> np.ndarray:
    """Return stamps at times of the recorder between pairs of both; beyond them, both clocks go at the same pace."""
    beyond = np.minimum(given - logged[0], 0) + np.maximum(given - logged[-1], 0)
    return np.interp(given, logged, stamp) + beyond


def _first_break(poses: Table) -> int | None:
    """Return the first row of a robot's poses, in the order of their recording, at which its clock was set."""
    stamp, place = poses.stamp, poses.numbers[:, :2]
    leaps = np.flatnonzero(np.diff(stamp) > _LEAP + 10 * np.diff(poses.logged)) + 1
    top = np.maximum.accumulate(stamp)
    for begin, end in runs(stamp < top - SAME):
        earlier = np.arange(np.searchsorted(top, stamp[begin]), begin)
        earlier = earlier[stamp[earlier] >= stamp[begin]]
        recorded = np.concatenate([earlier, np.arange(begin, end)])
        in_order = recorded[np.argsort(stamp[recorded], kind="stable")]
        if end - begin > 1 and len(earlier) > 1 and _way(place[in_order]) > _DETOUR * _way(place[recorded]):
            return min([begin, *leaps.tolist()])
    return int(leaps[0]) if len(leaps) else None


def _way(place: np.ndarray) -> float:
    return float(np.nansum(np.linalg.norm(np.diff(place, axis=0), axis=1)))
