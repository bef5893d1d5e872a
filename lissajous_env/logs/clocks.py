"""One clock for all messages of a log: the stamps of the poses, to which the recorder's times are converted.

A message with a stamp has the time of its stamp. A message without one has the recorder's time; it is converted by the
poses of the same file, each of which has both times. So neither a constant difference of the two clocks nor a different
pace (a simulation's) changes anything.

In the order of their recording, the stamps of a robot's poses rise, except for messages that arrived late. Where they
fall and the poses in the order of their stamps would make no path, the clock went back, as when a simulator is reset;
where they jump ahead and the recorder's times do not, it was set. Such a log is refused.
"""

from collections.abc import Sequence

import numpy as np

from lissajous_env.logs.log import Log
from lissajous_env.logs.poses import Poses

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
        notes: Remarks on what was left out or seems wrong.

    Raises:
        ValueError: a clock was set while the log was recorded.
    """

    def __init__(self, poses: Sequence[Poses], log: Log):
        self.notes: list[str] = []
        called = self._called = log.called
        ordered = [robot.rows(np.lexsort((robot.stamp, robot.logged, robot.bag))) for robot in poses]
        stamped = [k for k, robot in enumerate(ordered) if np.ptp(robot.stamp) > 0] or list(range(len(ordered)))
        without = [k for k, robot in enumerate(ordered) if not np.ptp(robot.stamp) > 0]
        if without and len(without) == len(ordered):
            ordered = [robot._replace(stamp=robot.logged) for robot in ordered]
        if without and any(len(poses[k].stamp) > 1 for k in without):
            self.notes.append(f"the poses of {called(without)} have no stamps; their times are the recorder's")
        self.poses = ordered
        self._leave_out_strays(log)
        for k in stamped:
            self._refuse_breaks(k, log)
        self._pairs = self._paired(self._agreeing(stamped))
        if len(without) < len(ordered):
            for k in without:
                self.poses[k] = self.poses[k]._replace(stamp=self.times(self.poses[k].bag, self.poses[k].logged))

    def times(self, bag: np.ndarray, logged: np.ndarray) -> np.ndarray:
        """Return times of the recorder of some files [s] as times of this clock [s]."""
        converted = np.array(logged, dtype=float)
        for number in np.unique(bag).tolist():
            own, stamps = self._pairs.get(number, self._pairs[-1])
            here = bag == number
            given = converted[here]
            converted[here] = np.interp(given, own, stamps) + np.minimum(given - own[0], 0)
            converted[here] += np.maximum(given - own[-1], 0)
        return converted

    def differs(self, bag: np.ndarray, logged: np.ndarray, stamp: np.ndarray) -> float:
        """Return by how much stamps are ahead of this clock [s], 0 for less than a second; NaN if they do not rise."""
        if len(stamp) > 1 and not np.ptp(stamp) > 0:
            return np.nan
        ahead = float(np.median(stamp - self.times(bag, logged)))
        return ahead if abs(ahead) > _LAG else 0.0

    def _leave_out_strays(self, log: Log) -> None:
        """Leave out poses whose stamps were not set, as before the first message of a simulator's clock."""
        words = []
        for robot, poses in enumerate(self.poses):
            stray = np.abs(poses.stamp - np.median(poses.stamp)) > _DAY
            if stray.any():
                rule = "that are more than a day from the others"
                got = f"{poses.stamp[stray][0]:.3f} s"
                words.append((robot, f"{int(stray.sum())} poses with stamps {rule} ({got}) are left out"))
                self.poses[robot] = poses.rows(~stray)
        self.notes += log.grouped(words)

    def _refuse_breaks(self, robot: int, log: Log) -> None:
        """Refuse a log in which the clock of a robot's poses is set.

        Raises:
            ValueError: the stamps go back, or ahead without the recorder's times.
        """
        for bag in np.unique(self.poses[robot].bag):
            poses = self.poses[robot].rows(self.poses[robot].bag == bag)
            for row in breaks(poses)[:1]:
                jump = float(poses.stamp[row] - poses.stamp[row - 1])
                got = f"{abs(jump):.3g} s {'back' if jump < 0 else 'ahead'}, recorded at {poses.logged[row]:.3f} s"
                rule = f"the stamps of {log.called([robot])} must rise with the recorder's times in {log.name}"
                raise ValueError(
                    f"{rule}, got a jump of {got}: was a clock set, or a simulation reset? Cut the log there"
                )

    def _agreeing(self, stamped: Sequence[int]) -> list[int]:
        """Return the robots whose clocks agree by the recorder's times, and note the others."""
        off: list[int] = []
        for bag in np.unique(np.concatenate([self.poses[k].bag for k in stamped])).tolist():
            own = {k: self.poses[k].rows(self.poses[k].bag == bag) for k in stamped}
            own = {k: poses for k, poses in own.items() if len(poses.stamp) > 1}
            if len(own) < 3:
                continue  # of two clocks, nobody knows which one is off
            base, stamps = _pairs_of([max(own.values(), key=lambda poses: len(poses.stamp))])
            lags = {}
            for k, poses in own.items():
                both = (poses.logged >= base[0]) & (poses.logged <= base[-1])
                if both.any():
                    lags[k] = float(np.median((poses.stamp - np.interp(poses.logged, base, stamps))[both]))
            middle = float(np.median(list(lags.values())))
            for k, lag in lags.items():
                if abs(lag - middle) > _LAG:
                    off.append(k)
                    words = f"by the recorder's times, the clock of {self._called([k])} is {abs(lag - middle):.3g} s"
                    self.notes.append(f"{words} {'ahead of' if lag > middle else 'behind'} those of the others")
        return [k for k in stamped if k not in off]

    def _paired(self, robots: Sequence[int]) -> dict[int, tuple[np.ndarray, np.ndarray]]:
        """Return pairs of the recorder's times and stamps for each file, and at -1 for all of them."""
        poses = [self.poses[k] for k in robots]
        bags = np.unique(np.concatenate([robot.bag for robot in poses])).tolist()
        pairs = {bag: _pairs_of([robot.rows(robot.bag == bag) for robot in poses]) for bag in bags}
        return pairs | {-1: _pairs_of(poses)}


def _pairs_of(poses: Sequence[Poses]) -> tuple[np.ndarray, np.ndarray]:
    """Return increasing times of the recorder, and the latest stamp of a pose that was recorded until then."""
    logged = np.concatenate([robot.logged for robot in poses])
    stamp = np.concatenate([robot.stamp for robot in poses])
    order = np.lexsort((stamp, logged))
    last = np.append(np.diff(logged[order]) > 0, True)
    return logged[order][last], np.maximum.accumulate(stamp[order])[last]


def breaks(poses: Poses) -> list[int]:
    """Return the rows of a robot's poses, in the order of their recording, at which its clock was set."""
    leaps = np.diff(poses.stamp) > _LEAP + 10 * np.diff(poses.logged)
    begins, first = (np.flatnonzero(leaps) + 1).tolist(), 0
    while (begin := _next_break(poses.stamp[first:], poses.pose[first:, :2])) is not None:
        first += begin
        begins.append(first)
    return sorted(set(begins))


def _next_break(stamp: np.ndarray, place: np.ndarray) -> int | None:
    top = np.maximum.accumulate(stamp)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], stamp < top - SAME, [0]]).astype(int)))
    for begin, end in edges.reshape(-1, 2).tolist():
        earlier = np.arange(np.searchsorted(top, stamp[begin]), begin)
        earlier = earlier[stamp[earlier] >= stamp[begin]]
        recorded = np.concatenate([earlier, np.arange(begin, end)])
        in_order = recorded[np.argsort(stamp[recorded], kind="stable")]
        if end - begin > 1 and len(earlier) > 1 and _way(place[in_order]) > _DETOUR * _way(place[recorded]):
            return begin
    return None


def _way(place: np.ndarray) -> float:
    return float(np.nansum(np.linalg.norm(np.diff(place, axis=0), axis=1)))
