"""Policies that react to the targets that they observe, for cars whose actions are velocities.

`Follow`, `Force` and `Chase` move by what a robot has in sight or on its tracks, and patrol while there is nothing.
`Index` learns where targets appear. `Lanes` is the patrol: it observes no target, so it is the measure of what reacting
is worth. All keep away from the robots in sight, and each robot uses its own row alone: where the robots of a team
divide work, each computes the whole division from the same places.

Distances in their settings are in units of `sensing.sight`, or of the sensing radius for `Lanes` and `Index`.
"""

from typing import Any

import numpy as np

from baselines.policies.base import Policy, UnsuitableScenarioError
from baselines.policies.rows import Rows
from lissajous_env.parameters.scenario import Scenario

_APART = 6.25
"""Distance below which robots repel each other [body radius]."""
_REPULSION = 1.5
"""Weight of that repulsion."""
_NOWHERE = 1e6
"""Distance of a thing that is not there, in units of its policy."""


def unit(vectors: np.ndarray) -> np.ndarray:
    """Return vectors (..., 2) of length 1, in the same directions; zeros remain zeros."""
    size = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(size > 0, size, 1.0)


def towards(offset: np.ndarray, slow: float) -> np.ndarray:
    """Return velocities [top speed] to relative places (..., 2) [m], slower within a distance `slow` [m] of them."""
    return unit(offset) * np.minimum(np.linalg.norm(offset, axis=-1, keepdims=True) / slow, 1.0)


def nearest(offset: np.ndarray, there: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the nearest (W, N, 2) of relative places (W, N, K, 2) that are there (W, N, K), and whether one is."""
    if offset.shape[2] == 0:
        return np.zeros_like(offset[:, :, 0, :]), np.zeros(there.shape[:2], bool)
    far = np.where(there, np.linalg.norm(offset, axis=-1), np.inf)
    first = far.argmin(axis=-1)
    return np.take_along_axis(offset, first[..., None, None], axis=2)[:, :, 0], np.any(there, axis=-1)


def kept_apart(wish: np.ndarray, rows: Rows) -> np.ndarray:
    """Return wished velocities (W, N, 2) [top speed] that also lead away from robots that are near."""
    far = np.where(rows.robots_seen, np.linalg.norm(rows.robot_offset, axis=-1), np.inf)
    near = np.clip(_APART * rows.scenario.robot.radius / far - 1, 0.0, 3.0)
    wish = wish - _REPULSION * (unit(rows.robot_offset) * near[..., None]).sum(axis=2)
    return unit(wish) * np.minimum(np.linalg.norm(wish, axis=-1, keepdims=True), 1.0)


def known_places(rows: Rows) -> np.ndarray:
    """Return x, y of each robot and of the teammates that it knows (W, N, 1 + M, 2) [m]; NaN for unknown ones."""
    mates = np.where(rows.teammates[..., None], rows.teammate_offset, np.nan)
    return np.concatenate([rows.position[:, :, None], rows.position[:, :, None] + mates], axis=2)


def comb(half: np.ndarray, lanes: int, edge: float) -> np.ndarray:
    """Return the corners (K, 2) of a closed tour of an even number of vertical lanes, joined along the lower side [m].

    Args:
        half: Half of the width and of the height [m].
        lanes: Number of lanes.
        edge: Distance of the outer lanes, and of the ends of lanes, from the boundary [m].
    """
    across = np.linspace(edge - half[0], half[0] - edge, lanes)
    low, high = edge - half[1], half[1] - edge
    inner = low + min(2 * edge, 0.5 * (high - low))
    corners = [(across[0], low)]
    for k, x in enumerate(across):
        lower = low if k == lanes - 1 else inner
        corners += [(x, high), (x, lower)] if k % 2 == 0 else [(x, inner), (x, high)]
    corners += [(across[-1], low), (across[0], low)]
    kept = [corner for k, corner in enumerate(corners) if k == 0 or corner != corners[k - 1]]
    return np.array(kept)


class Reacting(Policy):
    """Base of these policies: a subclass returns the velocities that it wishes, without regard to other robots."""

    kind = "velocity"

    def __init__(self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu"):
        super().__init__(scenario, num_worlds, device)
        made = self.scenario
        if not made.task.action == "velocity":
            raise UnsuitableScenarioError(f"task.action must be velocity, got {made.task.action}")
        self.half = np.array([made.curve.half_width, made.curve.half_height])
        self.top, self.step, self.sight = made.robot.top_speed, made.task.step, made.sight

    def wish(self, rows: Rows) -> np.ndarray:
        """Return the wished velocities (W, N, 2) in units of the top speed."""
        raise NotImplementedError(f"{type(self).__name__} must have a method wish(rows)")

    def rows(self, observation: np.ndarray) -> Rows:
        """Return what the robots know: their rows alone."""
        return Rows(observation.astype(float), self.scenario)

    def decide(self, observation: np.ndarray) -> np.ndarray:
        """Return the wished velocities, and away from robots that are near."""
        rows = self.rows(observation)
        action = np.zeros(self.action.shape, np.float32)
        action[..., :2] = kept_apart(self.wish(rows), rows)
        return action


class Lanes(Reacting):
    """Patrol in vertical lanes: robots follow each other, evenly spaced, on one closed tour; it observes no target.

    Each robot takes the nearest free place on the tour at the start, as soon as the first messages can have arrived.

    Args:
        scenario: The scenario.
        num_worlds: W.
        device: Warp device.
        lanes: Number of lanes, even; by default they are about 1.1 `reach` apart.
        reach: Distance that a robot searches to each side [m]; by default the sensing radius.
    """

    def __init__(
        self,
        scenario: Scenario,
        num_worlds: int = 1,
        device: Any = "cpu",
        lanes: int | None = None,
        reach: float | None = None,
    ):
        super().__init__(scenario, num_worlds, device)
        reach = self.scenario.sensing_radius if reach is None else reach
        edge = min(0.8 * reach, 0.5 * float(self.half.min()))
        fitting = 2 * round((1 + (2 * self.half[0] - 2 * edge) / (1.1 * reach)) / 2)
        self.corners = comb(self.half, max(fitting, 2) if lanes is None else lanes, edge)
        self._along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(self.corners, axis=0), axis=1))])
        self._ahead = 0.5 * reach
        self._steps = np.zeros(self.num_worlds, int)
        self._slot = np.zeros(self.shape, int)
        noise = self.scenario.noise
        delay = round(noise.message_delay / self.step)
        self._last_choice = delay + (4 if noise.message_loss > 0 else 0)
        self._earlier = np.zeros((*self.shape, delay + 1, 2))
        """Own places in the latest steps, the earliest last: a choice uses places of one step for the whole team."""

    def forget(self, mask: np.ndarray) -> None:
        """Begin the tour anew."""
        self._steps[mask] = 0

    def place(self, way: np.ndarray) -> np.ndarray:
        """Return the points (..., 2) of the tour after ways (...) along it [m]."""
        along = way % self._along[-1]
        return np.stack([np.interp(along, self._along, self.corners[:, k]) for k in (0, 1)], axis=-1)

    def wish(self, rows: Rows) -> np.ndarray:
        """Follow the robot's place on the tour."""
        spacing = self._along[-1] / self.num_robots
        starts, chooses = self._steps == 0, self._steps <= self._last_choice
        self._earlier = np.concatenate([rows.position[:, :, None], self._earlier[:, :, :-1]], axis=2)
        self._earlier[starts] = rows.position[starts][:, :, None]
        if chooses.any():
            slots = self.place(self._ahead + spacing * np.arange(self.num_robots))
            places = known_places(rows)
            places[:, :, 0] = self._earlier[:, :, -1]
            self._slot[chooses] = _nearest_slots(places[chooses], slots)
        way = 0.95 * self.top * self.step * self._steps + self._ahead
        self._steps += 1
        return towards(self.place(way[:, None] + spacing * self._slot) - rows.position, 0.5 * self._ahead)


def _nearest_slots(places: np.ndarray, slots: np.ndarray) -> np.ndarray:
    """Return the slot (W, N) of each robot, where pairs of a robot and a slot are chosen by their distance.

    Args:
        places: (W, N, 1 + M, 2) place of a robot and of the others that it knows [m].
        slots: (S, 2) places of the slots [m].
    """
    far = np.linalg.norm(places[..., None, :] - slots, axis=-1)
    far = np.where(np.isnan(far), np.inf, far)
    own = np.zeros(far.shape[:2], int)
    count = len(slots)
    for _ in range(far.shape[2]):
        pair = far.reshape(*far.shape[:2], -1).argmin(axis=-1)
        robot, slot = pair // count, pair % count
        fits = np.isfinite(np.take_along_axis(far.reshape(*far.shape[:2], -1), pair[..., None], axis=-1)[..., 0])
        own = np.where((robot == 0) & fits, slot, own)
        taken = (np.arange(far.shape[2])[:, None] == robot[..., None, None]) | (
            np.arange(count) == slot[..., None, None]
        )
        far = np.where(taken, np.inf, far)
    return own


class Searching(Reacting):
    """Base of the policies that patrol in lanes while they know of no target."""

    def __init__(self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu"):
        super().__init__(scenario, num_worlds, device)
        self.patrol = Lanes(scenario, num_worlds, device, reach=self.scenario.sight)

    def expected_offset(self, rows: Rows) -> np.ndarray:
        """Return where known targets are now (W, N, K, 2), relative to the robot, if they kept their velocity [m]."""
        # A target keeps its velocity for about twice the time in which a robot drives as far as it sees.
        longest = 1.875 * self.sight / self.top
        here = rows.position[:, :, None]
        guess = rows.track_offset + rows.track_velocity * np.minimum(rows.track_age, longest)[..., None]
        return np.clip(here + guess, -self.half, self.half) - here


class Follow(Searching):
    """Follow the nearest target in sight; patrol in lanes if there is none."""

    def wish(self, rows: Rows) -> np.ndarray:
        """Drive to the nearest target in sight."""
        offset, there = nearest(rows.target_offset, rows.targets_seen)
        return np.where(there[..., None], towards(offset, 0.375 * self.sight), self.patrol.wish(rows))


class Force(Searching):
    """A-CMOMMT (Parker 2002): forces towards known targets, weaker if others observe them, and away from robots.

    Reference: L. E. Parker, "Distributed algorithms for multi-robot observation of multiple moving targets", Autonomous
    Robots 12 (2002) 231-255.

    Args:
        scenario: The scenario.
        num_worlds: W.
        device: Warp device.
        shared: Weight of a target that another robot has in sight.
        reach: Distance up to which targets attract [sight].
        apart: Distance up to which robots repel each other [sight].
        push: Weight of the repulsion.
    """

    def __init__(
        self,
        scenario: Scenario,
        num_worlds: int = 1,
        device: Any = "cpu",
        shared: float = 0.0,
        reach: float = 2.0,
        apart: float = 3.0,
        push: float = 1.0,
    ):
        super().__init__(scenario, num_worlds, device)
        self.shared, self.reach, self.apart, self.push = shared, reach, apart, push

    def wish(self, rows: Rows) -> np.ndarray:
        """Add the forces; patrol without any target in reach."""
        guess = self.expected_offset(rows)
        far = np.linalg.norm(guess, axis=-1)
        weight = np.where(rows.track_of_other, self.shared, 1.0) * np.clip(far / (0.375 * self.sight), 0.0, 1.0)
        weight = np.where(rows.tracks & (far < self.reach * self.sight), weight, 0.0)
        force = (unit(guess) * weight[..., None]).sum(axis=2)
        mates = np.where(rows.teammates, np.linalg.norm(rows.teammate_offset, axis=-1), np.inf)
        repels = np.clip(1 - mates / (self.apart * self.sight), 0.0, 1.0)
        force -= self.push * (unit(rows.teammate_offset) * repels[..., None]).sum(axis=2)
        return np.where((weight != 0).any(axis=-1)[..., None], force, self.patrol.wish(rows))


class Chase(Searching):
    """Pursue the nearest target in sight of any robot, at the place where it will be; patrol in lanes if there is none.

    Args:
        scenario: The scenario.
        num_worlds: W.
        device: Warp device.
        lead: Time for which the velocity of a target is extrapolated, in units of the time in which the robot drives to
            where the target is; 0 is pure pursuit.
    """

    def __init__(self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu", lead: float = 0.8):
        super().__init__(scenario, num_worlds, device)
        self.lead = lead

    def wish(self, rows: Rows) -> np.ndarray:
        """Drive to where the nearest target will be."""
        now = rows.tracks & (rows.track_age < 0.5 * self.step) & ~rows.track_leaves
        far = np.where(now, np.linalg.norm(rows.track_offset, axis=-1), _NOWHERE * self.sight)
        when = np.minimum(self.lead * far / self.top, 0.9 * self.sight / self.top)
        here = rows.position[:, :, None]
        ahead = np.clip(here + rows.track_offset + rows.track_velocity * when[..., None], -self.half, self.half) - here
        first = far.argmin(axis=-1)[..., None, None]
        goal = np.take_along_axis(ahead, first, axis=2)[:, :, 0]
        return np.where(np.any(now, axis=-1, keepdims=True), towards(goal, 0.02 * self.sight), self.patrol.wish(rows))


class Index(Reacting):
    """Drive where the expected number of targets per time is largest: rates of cells times the time since a visit.

    The rate of a cell is the mean of a gamma distribution, whose prior is the uniform rate with the weight of half a
    detection. Robots choose one after the other, and leave out what others will cover.

    Args:
        scenario: The scenario.
        num_worlds: W.
        device: Warp device.
        learns: False for uniform rates.
        delay: Time that is added to the driving time to a place, in units of sensing radius over top speed.

    Raises:
        UnsuitableScenarioError: no targets appear during an episode, or the robots do not share tracks and places.
    """

    def __init__(
        self, scenario: Scenario, num_worlds: int = 1, device: Any = "cpu", learns: bool = True, delay: float = 1.0
    ):
        super().__init__(scenario, num_worlds, device)
        made, radius = self.scenario, self.scenario.sensing_radius
        if made.targets.arrival_rate == 0:
            raise UnsuitableScenarioError("targets.arrival_rate must be above 0 for an index rule [1/s], got 0")
        if made.sensing.shared != "team" or min(made.sensing.tracks_seen, made.sensing.teammates_seen) == 0:
            rule = "must be team, with sensing.tracks_seen and sensing.teammates_seen above 0, for an index rule"
            raise UnsuitableScenarioError(f"sensing.shared {rule}, got {made.sensing.shared}")
        self.learns, self.radius, self.delay = learns, radius, delay * radius / self.top
        self.counts = np.ceil(2 * self.half / (1.7 * radius)).astype(int)
        axes = [(np.arange(n) + 0.5) * 2 * h / n - h for n, h in zip(self.counts, self.half, strict=True)]
        self.cells = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
        self._near = (np.linalg.norm(self.cells[:, None] - self.cells, axis=-1) < radius).astype(float)
        self._left = (np.linalg.norm(self.cells[:, None] - self.cells, axis=-1) >= 1.2 * radius).astype(float)
        shape = (*self.shape, len(self.cells))
        self._idle, self._found, self._watched = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        self.forget(np.ones(self.num_worlds, bool))

    def forget(self, mask: np.ndarray) -> None:
        """Forget all detections; every cell has been idle for the same time."""
        self._idle[mask] = 10 * self.radius / self.top
        self._found[mask] = self._watched[mask] = 0.0

    def expected(self) -> np.ndarray:
        """Return the expected number of undetected targets in each cell (W, N, cells)."""
        return self.rates() * self._idle

    def rates(self) -> np.ndarray:
        """Return the expected rates (W, N, cells) [1/s]."""
        uniform = self.scenario.targets.arrival_rate / len(self.cells)
        if not self.learns:
            return np.full(self._idle.shape, uniform)
        return (self._found + 0.5) / (self._watched + 0.5 / uniform)

    def wish(self, rows: Rows) -> np.ndarray:
        """Update what the robot knows, divide the cells among the team, and drive to the own one."""
        places = known_places(rows)
        far = np.nan_to_num(np.linalg.norm(places[:, :, :, None] - self.cells, axis=-1), nan=_NOWHERE * self.radius)
        covered = (far < self.radius).any(axis=2)
        waited = self._idle + self.step
        self._watched += np.where(covered, waited, 0.0)
        self._idle = np.where(covered, 0.0, waited)
        where = (rows.position[:, :, None] + rows.track_offset + self.half) / (2 * self.half) * self.counts
        column, line = np.moveaxis(np.clip(where.astype(int), 0, self.counts - 1), -1, 0)
        world, robot, track = np.nonzero(rows.track_leaves)
        np.add.at(self._found, (world, robot, (column * self.counts[1] + line)[world, robot, track]), 1.0)
        goal = self._divide(self.expected(), far / self.top)
        return towards(self.cells[goal] - rows.position, self.radius / 3)

    def _divide(self, mass: np.ndarray, time: np.ndarray) -> np.ndarray:
        """Return the own cell (W, N) where each robot in turn has the largest mass in its disc per time.

        Args:
            mass: (W, N, cells) expected number of targets.
            time: (W, N, 1 + M, cells) driving times of the robots that each robot knows, its own first [s].
        """
        goal = np.zeros(self.shape, int)
        free = np.ones((*time.shape[:3], 1))
        for _ in range(time.shape[2]):
            worth = (mass @ self._near)[:, :, None] * free / (time + self.delay) - (1 - free)
            best = worth.reshape(*self.shape, -1).argmax(axis=-1)
            robot, cell = best // len(self.cells), best % len(self.cells)
            goal = np.where(robot == 0, cell, goal)
            np.put_along_axis(free, robot[..., None, None], 0.0, axis=2)
            mass = mass * self._left[cell]
        return goal
