"""The world once more: one world in float64, plain loops, written from the documented model and not from the kernels.

The oracle of the simulation. What is random is left out: the phases, the cars' bodies and the targets with which an
episode begins are given, and wandering targets are only followed with `targets.turn_rate` 0, which makes them go
straight on.
"""

import dataclasses
import itertools
import math
from dataclasses import dataclass, field

import numpy as np
import reference_walls
from reference_motion import (
    car_runge_kutta,
    closest_approach,
    curve_point,
    curve_tangent,
    curve_tree,
    drive_way,
    meetings,
    move_target,
    projection,
    stopped_by_walls,
    throttle_of,
    wrapped,
)
from reference_score import score_of

PARTED = 1.05
"""Distance over the sum of the radii, above which a collision is over."""


@dataclass
class Car:
    """One robot: its truth, and its way through the latest step."""

    position: np.ndarray
    heading: float
    speed: float
    phase: float
    way: list = field(default_factory=list)
    stopped: bool = False
    """True if a collision stopped it for good."""
    crashed: bool = False
    """True if a collision removed it."""
    left: bool = False
    """True if the edge of the rectangle removed it."""
    steering: float = 0.0
    """Angle at which it steered last."""
    touches: bool = False
    """True while a contact with a wall lasts."""
    yaw_rate: float = 0.0
    """That of a differential drive."""
    driven_from: np.ndarray | None = None
    """Place from which its progress is measured."""
    driven: int = 0
    """Steps in which its policy drove it since its last progress."""


@dataclass
class Target:
    """One target slot."""

    position: np.ndarray
    heading: float
    motion: int
    appears_at: int
    found_at: int | None = None
    found_early: float = 0.0
    """Share of that step that was left."""
    finder: int | None = None
    in_sight: bool = False


class World:
    """One world of a scenario, stepped by `step(action)`; `targets` are (position, heading, motion, appears_at)."""

    def __init__(self, scenario, phases, bodies, targets):
        self.scenario = scenario = scenario.resolve()
        bodies, robot = list(bodies), scenario.robot
        self.bodies = [dataclasses.replace(robot, wheelbase=base, drive=own, speed_max=None) for base, own in bodies]
        self.wheels = [(own / robot.drive, base / robot.wheelbase) for base, own in bodies]
        self.alpha = scenario.formation.alpha
        self.n = scenario.num_robots
        task = scenario.task
        self.dt, self.now = task.step, 0
        self.equilibrium = [0.0] * self.n
        for place, robot in enumerate(scenario.formation.ring):
            self.equilibrium[robot] = 2 * math.pi * scenario.formation.p * place / self.n
        self.robots = [self._placed(phase) for phase in phases]
        self.targets = [Target(np.array(place, float), heading, motion, at) for place, heading, motion, at in targets]
        self.delay = round(scenario.noise.message_delay / task.step)
        self.sent: list[list] = []
        self.heard = [[None, None] for _ in range(self.n)]
        self.messages = [(0.0,) * scenario.messages.size for _ in range(self.n)]
        self.touching: set[tuple[int, int]] = set()
        self.collisions = self.contact_steps = 0
        self.least_distance = math.inf
        self.new_collisions = [0] * self.n
        self.detections = [0] * self.n
        self.ended_idleness = 0
        self.lateral_sum = self.lateral_max = self.tracking_sum = self.tracking_max = self.spacing_max = 0.0
        self.outside, self.outside_steps = [False] * self.n, 0
        self.partly_outside_steps = self.wall_contacts = self.blocked_steps = 0
        self.deviations: list[float] = []
        self.returns = np.zeros(self.n)
        self.terms = np.zeros((self.n, 7))
        columns, rows = task.grid or (0, 0)
        self.centres = [
            (x, y)
            for y in (np.arange(rows) + 0.5) * 2 * scenario.curve.half_height / max(rows, 1)
            - scenario.curve.half_height
            for x in (np.arange(columns) + 0.5) * 2 * scenario.curve.half_width / max(columns, 1)
            - scenario.curve.half_width
        ]
        self.visits = [[0] for _ in self.centres]
        self.sensed_by = [set() for _ in self.centres]
        self.covered_at = self.covered_each_at = None
        self.at_work = [self.works(i) for i in range(self.n)]
        self.resumed_at: int | None = None
        self.first_fault: int | None = None
        self._sense(begin=True)
        self._tally(begin=True)
        self._send()
        self._hear()

    def _placed(self, phase: float) -> Car:
        rate = self.scenario.formation.phase_rate
        gamma = self.alpha * phase
        tangent = curve_tangent(self.scenario.curve, gamma) * rate
        heading = math.atan2(tangent[1], tangent[0])
        return Car(curve_point(self.scenario.curve, gamma), heading, float(np.linalg.norm(tangent)), phase)

    # Who works.

    def removed(self, i: int) -> bool:
        """Return whether robot i is removed, by the schedule, by a collision or by the edge of the rectangle."""
        times = [round(time / self.dt) for robot, time in self.scenario.faults.removed if robot == i]
        return self.robots[i].crashed or self.robots[i].left or any(at < max(self.now, 1) for at in times)

    def stuck(self, i: int) -> bool:
        """Return whether robot i has failed in the step that ends now."""
        rows = [(a, b) for robot, a, b in self.scenario.faults.schedule if robot == i]
        faulty = any(round(a / self.dt) < self.now <= b / self.dt + 1e-6 for a, b in rows)
        return not self.removed(i) and (faulty or self.robots[i].stopped)

    def works(self, i: int) -> bool:
        """Return whether robot i moves and senses."""
        return not self.removed(i) and not self.stuck(i)

    # A step.

    @property
    def over(self) -> bool:
        """Return whether the time is over, or collisions and the edge of the rectangle removed every robot."""
        return self.now >= self.scenario.task.steps or all(robot.crashed or robot.left for robot in self.robots)

    def step(self, action: np.ndarray) -> None:
        """Move robots, find collisions, move and sense targets, cover cells, score, reward, hear messages.

        A robot that collides has sensed and sent in the step of its collision and earns what that step earns; the score
        of the formation is already without it if it is removed.
        """
        if self.over:
            self.terms[:] = 0
            return
        self.now += 1
        command = np.clip(np.asarray(action, dtype=float), -1, 1)
        stood = [not works for works in self.at_work]
        self.at_work = [self.works(i) for i in range(self.n)]
        if any(stood[i] and self.at_work[i] for i in range(self.n)):
            self.resumed_at = self.now - 1
        moving = command.shape[1] - self.scenario.messages.size
        for i in range(self.n):
            if self.at_work[i]:
                self.messages[i] = tuple(command[i, moving:])
        command = command[:, :moving]
        for i in range(self.n):
            self._move(i, command[i])
        self._send()
        self._collide()
        self._sense(begin=False)
        self._consequences()
        reference_walls.leave(self)
        if self.scenario.task.boundary == "wall" and self.scenario.robot.kind != "curve":
            reference_walls.watch_walls(self, command)
        self._tally(begin=False)
        self._reward(command)
        self._hear()

    def _move(self, i: int, command: np.ndarray) -> None:
        car, curve, robot, substeps = (
            self.robots[i],
            self.scenario.curve,
            self.scenario.robot,
            self.scenario.task.substeps,
        )
        car.way = [car.position.copy()]
        if self.removed(i):
            car.way *= substeps + 1
            return
        if robot.kind == "curve":
            rate = float(command[0]) * robot.phase_rate_max if self.at_work[i] else 0.0
            for s in range(1, substeps + 1):
                passed = car.phase + rate * self.dt * s / substeps
                car.way.append(curve_point(curve, self.alpha * passed))
            car.phase += rate * self.dt
            tangent = curve_tangent(curve, self.alpha * car.phase) * self.alpha * rate
            car.speed = float(np.linalg.norm(tangent))
            if rate != 0:
                car.heading = math.atan2(tangent[1], tangent[0])
        elif robot.kind == "differential" and self.at_work[i]:
            state = np.array([*car.position[:2], car.heading, car.speed, car.yaw_rate])
            for _ in range(substeps):
                state = drive_way(robot, state, command, *self.wheels[i], self.dt / substeps)
                if self.scenario.task.boundary == "wall":
                    state[:4] = stopped_by_walls(self.scenario.curve, robot.radius, state[:4])
                car.way.append(np.array([state[0], state[1], 0.0]))
            car.heading, car.speed, car.yaw_rate = map(float, state[2:])
            car.phase += projection(curve, state[:2], self.alpha * car.phase) / self.alpha
        elif self.at_work[i] or (self.scenario.faults.stop == "coast" and not car.stopped):
            throttle = 0.0  # a failed car rolls on as it steered last
            if self.at_work[i]:
                car.steering = float(command[0]) * robot.steering_max
                throttle = throttle_of(robot, float(command[1]))
            state = np.array([car.position[0], car.position[1], car.heading, car.speed])
            for _ in range(substeps):
                state = car_runge_kutta(self.bodies[i], state, car.steering, throttle, self.dt / substeps)
                if self.scenario.task.boundary == "wall":
                    state = stopped_by_walls(self.scenario.curve, robot.radius, state)
                car.way.append(np.array([state[0], state[1], 0.0]))
            car.heading, car.speed = float(state[2]), float(state[3])
            car.phase += projection(curve, state[:2], self.alpha * car.phase) / self.alpha
        else:
            car.speed = car.yaw_rate = 0.0
            car.way += [car.position] * substeps
        car.position = car.way[-1]

    def one_place(self, i: int, j: int) -> bool:
        """Return whether two points overlap by design: their parameters in equilibrium are equal."""
        apart = math.remainder(self.alpha * (self.equilibrium[i] - self.equilibrium[j]), 2 * math.pi)
        return self.scenario.robot.kind == "curve" and abs(apart) < 1e-9

    def _collide(self) -> None:
        touch = 2 * self.scenario.robot.radius
        self.new_collisions = [0] * self.n
        for i in range(self.n):
            for j in range(i + 1, self.n):
                if self.removed(i) or self.removed(j) or self.one_place(i, j):
                    continue
                offsets = [a - b for a, b in zip(self.robots[i].way, self.robots[j].way, strict=True)]
                least = min(closest_approach(a, b) for a, b in itertools.pairwise(offsets))
                self.least_distance = min(self.least_distance, least)
                if least < touch:
                    self.contact_steps += 1
                    if (i, j) not in self.touching:
                        self.touching.add((i, j))
                        self.collisions += 1
                        self.new_collisions[i] += 1
                        self.new_collisions[j] += 1
                if np.linalg.norm(offsets[-1]) > PARTED * touch:
                    self.touching.discard((i, j))

    def _consequences(self) -> None:
        for car, collisions in zip(self.robots, self.new_collisions, strict=True):
            if collisions and self.scenario.task.on_collision == "stop":
                car.stopped = True
            if collisions and self.scenario.task.on_collision == "remove":
                car.crashed = True

    def _sensors(self) -> dict[int, np.ndarray]:
        """Places of the robots that sense."""
        return {i: self.robots[i].position[:2] for i in range(self.n) if self.works(i)}

    def _sense(self, begin: bool) -> None:
        sensors, radius = self._sensors(), self.scenario.sensing.radius
        self.detections = [0] * self.n
        for target in self.targets:
            target.in_sight = False
            gone = self.scenario.targets.leave and target.found_at is not None
            if target.appears_at > self.now or gone:
                continue
            before = target.position.copy()
            if target.appears_at < self.now:
                move_target(self.scenario, target, sensors)
            distances = {i: float(np.linalg.norm(place - target.position)) for i, place in sensors.items()}
            target.in_sight = any(distance < radius for distance in distances.values())
            if target.found_at is not None:
                continue
            ways = {i: self.robots[i].way for i in sensors} if target.appears_at < self.now else {}
            met = meetings(before, target.position, ways, radius)
            if met or target.in_sight:
                target.found_at = self.now
                target.finder = min(met or distances, key=(met or distances).__getitem__)
                target.found_early = 1 - met.get(target.finder, 1.0)
                self.detections[target.finder] += 1
        self.ended_idleness = 0
        for k, (x, y) in enumerate(self.centres):
            sensing = [i for i, place in sensors.items() if math.hypot(place[0] - x, place[1] - y) < radius]
            self.sensed_by[k].update(sensing)
            if sensing:
                self.ended_idleness += self.now - self.visits[k][-1]
                self.visits[k].append(self.now)
        if self.centres:
            if self.covered_at is None and all(self.sensed_by):
                self.covered_at = self.now
            if self.covered_each_at is None and all(len(robots) == self.n for robots in self.sensed_by):
                self.covered_each_at = self.now

    # Score and reward.

    def _tally(self, begin: bool) -> None:
        here = [i for i in range(self.n) if not self.removed(i)]
        there = [i for i in range(self.n) if i in here or self.new_collisions[i] or self.outside[i]]
        curve = self.scenario.curve
        tracking, lateral = [], []
        for i in there:
            on_curve = curve_point(curve, self.alpha * self.robots[i].phase)
            tracking.append(math.dist(on_curve[:2], self.robots[i].position[:2]))
            lateral.append(self._distance_from_curve(self.robots[i].position[:2]))
        self.tracking_max = max([self.tracking_max, *tracking])
        self.lateral_max = max([self.lateral_max, *lateral])
        if not begin and there:
            self.tracking_sum += sum(tracking) / len(there)
            self.lateral_sum += sum(lateral) / len(there)
        pairs = [(i, j) for i in here for j in self.scenario.neighbours[i] if j in here]
        distances = [math.dist(self.robots[i].position, self.robots[j].position) for i, j in pairs]
        self.spacing_max = max([self.spacing_max, *distances])
        offsets = [self.robots[i].phase - self.equilibrium[i] for i in here]
        turn = math.atan2(sum(math.sin(o) for o in offsets), sum(math.cos(o) for o in offsets))
        if self.first_fault is None and any(self.stuck(i) for i in range(self.n)):
            self.first_fault = self.now
        self.deviations.append(max([abs(wrapped(o - turn)) for o in offsets], default=0.0))

    def _distance_from_curve(self, place: np.ndarray) -> float:
        """By brute force over a lap in millimetres."""
        if self.scenario.robot.kind == "curve":
            return 0.0
        return float(curve_tree(self.scenario.curve).query(place)[0])

    def _reward(self, command: np.ndarray) -> None:
        task = self.scenario.task
        waiting = sum(t.appears_at <= self.now and t.found_at is None for t in self.targets)
        for i in range(self.n):
            gone = self.robots[i].crashed or self.robots[i].left
            crashed = gone and not self.new_collisions[i] and not self.outside[i]
            ended = self.ended_idleness * self.dt / max(len(self.centres), 1)
            self.terms[i] = [
                task.reward_detection * self.detections[i],
                0.0 if crashed else task.reward_waiting * waiting * self.dt,
                task.reward_collision * self.new_collisions[i],
                0.0 if crashed else task.reward_idleness * ended,
                self.at_work[i] * task.reward_effort * float(np.mean(command[i] ** 2)),
                0.0 if crashed else task.reward_formation * self.deviations[-1] * self.dt,
                task.reward_outside * self.outside[i] * self.dt,
            ]
        self.returns += self.terms.sum(axis=1)

    def score(self) -> dict[str, float]:
        """Columns of the score up to now, but names and seed."""
        return score_of(self)

    # Messages.

    def _send(self) -> None:
        messages = [(r.phase, *r.position[:2], own) for r, own in zip(self.robots, self.messages, strict=True)]
        self.sent.append([None if self.removed(i) else message for i, message in enumerate(messages)])

    def _hear(self) -> None:
        if self.now < self.delay:
            return
        for i in range(self.n):
            for side, j in enumerate(self.scenario.neighbours[i]):
                message = self.sent[self.now - self.delay][j] if j >= 0 else None
                if message is not None:
                    self.heard[i][side] = (self.now - self.delay, message)


def world_like(simulation, world: int = 0) -> World:
    """The reference of one world of a simulation, begun with the phases and targets of its episode."""
    targets = simulation.targets
    targets = zip(
        targets.position.numpy()[world].astype(float),
        targets.heading.numpy()[world].astype(float),
        targets.motion.numpy()[world].tolist(),
        targets.appears_at.numpy()[world].tolist(),
        strict=True,
    )
    robots = simulation.robots
    bodies = zip(robots.wheelbase.numpy()[world].tolist(), robots.drive.numpy()[world].tolist(), strict=True)
    reference = World(simulation.scenario, robots.phase.numpy()[world].tolist(), bodies, list(targets))
    if simulation.scenario.start_turning > 0:  # robots that would drive into a wall at once face away from it
        for robot, heading in zip(reference.robots, robots.heading.numpy()[world].tolist(), strict=True):
            robot.heading = heading
    return reference
