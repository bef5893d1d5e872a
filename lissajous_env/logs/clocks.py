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
        poses: Poses of each robot, rows of `lissajous_env.logs.poses.ROW`.
        log: Names of the robots.

    Attributes:
        poses: The poses, in the order of their recording, all with stamps on this clock.
        notes: Remarks on what was left out or seems wrong.

    Raises:
        ValueError: a clock was set while the log was recorded.
    """

    def __init__(self, poses: Sequence[np.ndarray], log: Log):
        self.notes: list[str] = []
        self.poses = [own[np.lexsort((own["stamp"], own["logged"], own["bag"]))] for own in poses]
        self._log, robots = log, range(len(poses))
        without = [k for k in robots if not np.ptp(poses[k]["stamp"]) > 0]
        if any(len(poses[k]) > 1 for k in without):
            self.notes.append(f"the poses of {log.called(without)} have no stamps; their times are the recorder's")
        stamped = [k for k in robots if k not in without]
        if not stamped:
            stamped, without = list(robots), []
            for own in self.poses:
                own["stamp"] = own["logged"]
        self._leave_out_strays()
        for k in stamped:
            self._refuse_breaks(k)
        deviating = self._deviating(stamped)
        self._pairs = self._paired([self.poses[k] for k in stamped if k not in deviating])
        for k in without:
            self.poses[k]["stamp"] = self.times(self.poses[k]["bag"], self.poses[k]["logged"])

    def times(self, bag: np.ndarray, logged: np.ndarray) -> np.ndarray:
        """Return times of the recorder of some files [s] as times of this clock [s]."""
        converted = np.array(logged, dtype=float)
        for number in np.unique(bag).tolist():
            own, stamps = self._pairs.get(number, self._pairs[-1])
            given = converted[bag == number]
            beyond = np.minimum(given - own[0], 0) + np.maximum(given - own[-1], 0)
            converted[bag == number] = np.interp(given, own, stamps) + beyond
        return converted

    def differs(self, bag: np.ndarray, logged: np.ndarray, stamp: np.ndarray) -> float:
        """Return by how much stamps are ahead of this clock [s], 0 for less than a second; NaN if they do not rise."""
        if len(stamp) > 1 and not np.ptp(stamp) > 0:
            return np.nan
        ahead = float(np.median(stamp - self.times(bag, logged)))
        return ahead if abs(ahead) > _LAG else 0.0

    def _leave_out_strays(self) -> None:
        """Leave out poses whose stamps were not set, as before the first message of a simulator's clock."""
        words = []
        for robot, own in enumerate(self.poses):
            stray = np.abs(own["stamp"] - np.median(own["stamp"])) > _DAY
            if stray.any():
                got = f"more than a day from the others ({own['stamp'][stray][0]:.3f} s)"
                words.append((robot, f"{int(stray.sum())} poses with stamps that are {got} are left out"))
                self.poses[robot] = own[~stray]
        self.notes += self._log.grouped(words)

    def _refuse_breaks(self, robot: int) -> None:
        """Refuse a log in which the clock of a robot's poses is set.

        Raises:
            ValueError: the stamps go back, or ahead without the recorder's times.
        """
        for bag in np.unique(self.poses[robot]["bag"]):
            poses = self.poses[robot][self.poses[robot]["bag"] == bag]
            row = _first_break(poses)
            if row is not None:
                jump = float(poses["stamp"][row] - poses["stamp"][row - 1])
                got = f"{abs(jump):.3g} s {'back' if jump < 0 else 'ahead'}, recorded at {poses['logged'][row]:.3f} s"
                called = self._log.called([robot])
                raise ValueError(
                    f"the stamps of {called} must rise with the recorder's times in {self._log.name}, got a jump of "
                    f"{got}: was a clock set, or a simulation reset? Cut the log there"
                )

    def _deviating(self, robots: Sequence[int]) -> list[int]:
        """Return the robots whose clocks differ from those of the others by the recorder's times, and note them."""
        deviating: list[int] = []
        for bag in np.unique(np.concatenate([self.poses[k]["bag"] for k in robots])).tolist():
            own = {k: self.poses[k][self.poses[k]["bag"] == bag] for k in robots}
            own = {k: poses for k, poses in own.items() if len(poses) > 1}
            if len(own) < 3:
                continue  # of two clocks, nobody knows which one is off
            logged, stamps = _pairs_of([max(own.values(), key=len)])
            lags = {}
            for k, poses in own.items():
                both = poses[(poses["logged"] >= logged[0]) & (poses["logged"] <= logged[-1])]
                if len(both):
                    lags[k] = float(np.median(both["stamp"] - np.interp(both["logged"], logged, stamps)))
            middle = float(np.median(list(lags.values())))
            for k, lag in lags.items():
                if abs(lag - middle) > _LAG:
                    deviating.append(k)
                    ahead = f"{abs(lag - middle):.3g} s {'ahead of' if lag > middle else 'behind'}"
                    words = f"by the recorder's times, the clock of {self._log.called([k])} is {ahead}"
                    self.notes.append(f"{words} those of the others")
        return deviating

    @staticmethod
    def _paired(poses: Sequence[np.ndarray]) -> dict[int, tuple[np.ndarray, np.ndarray]]:
        """Return pairs of the recorder's times and stamps for each file, and at -1 for all of them."""
        bags = np.unique(np.concatenate([own["bag"] for own in poses])).tolist()
        return {bag: _pairs_of([own[own["bag"] == bag] for own in poses]) for bag in bags} | {-1: _pairs_of(poses)}


def _pairs_of(poses: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Return increasing times of the recorder, and the latest stamp of a pose that was recorded until then."""
    logged, stamp = (np.concatenate([own[name] for own in poses]) for name in ("logged", "stamp"))
    order = np.lexsort((stamp, logged))
    last = np.append(np.diff(logged[order]) > 0, True)
    return logged[order][last], np.maximum.accumulate(stamp[order])[last]


def _first_break(poses: np.ndarray) -> int | None:
    """Return the first row of a robot's poses, in the order of their recording, at which its clock was set."""
    stamp, place = poses["stamp"], poses["pose"][:, :2]
    leaps = np.flatnonzero(np.diff(stamp) > _LEAP + 10 * np.diff(poses["logged"])) + 1
    top = np.maximum.accumulate(stamp)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], stamp < top - SAME, [0]]).astype(int)))
    for begin, end in edges.reshape(-1, 2).tolist():
        earlier = np.arange(np.searchsorted(top, stamp[begin]), begin)
        earlier = earlier[stamp[earlier] >= stamp[begin]]
        recorded = np.concatenate([earlier, np.arange(begin, end)])
        in_order = recorded[np.argsort(stamp[recorded], kind="stable")]
        if end - begin > 1 and len(earlier) > 1 and _way(place[in_order]) > _DETOUR * _way(place[recorded]):
            return min([begin, *leaps.tolist()])
    return int(leaps[0]) if len(leaps) else None


def _way(place: np.ndarray) -> float:
    return float(np.nansum(np.linalg.norm(np.diff(place, axis=0), axis=1)))
