"""A simulation whose robots follow given paths: everything else is as in any simulation."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import wrap, wrap_phase
from lissajous_env.device.devices import as_device
from lissajous_env.device.program import Stage
from lissajous_env.device.stage import ROBOT, named_struct, stage
from lissajous_env.device.structs import allocate
from lissajous_env.device.trig import TWO_PI
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.robots.signals import follow_curve
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import FAILED, NOWHERE, REMOVED, WORKING

wp.set_module_options(OPTIONS)

FAULT, COLLISION, EDGE = 0, 1, 2
"""Causes of a status: a fault from the beginning of a step on; a collision or the edge at its end."""


@named_struct("paths")
class Paths:
    """Paths of N robots at M moments, with S + 1 places on the way to each moment."""

    path: wp.array3d(dtype=wp.vec3)
    """(M, N, S + 1) places from the moment before to this one [m]."""
    heading: wp.array2d(dtype=wp.float32)
    """(M, N) headings [rad]."""
    speed: wp.array2d(dtype=wp.float32)
    """(M, N) speeds over the ground [m/s]."""
    phase: wp.array2d(dtype=wp.float64)
    """(M, N) phases [rad]; NaN where the phase follows the curve from the one before."""
    status: wp.array2d(dtype=wp.int32)
    """(M, N) WORKING, FAILED or REMOVED."""
    cause: wp.array2d(dtype=wp.int32)
    """(M, N) FAULT, COLLISION or EDGE, the cause of a status if it is another one than before."""
    hidden: wp.array2d(dtype=wp.int32)
    """(M, N) 1 if nothing is known of a robot in the step to a moment, in which it has then failed or been removed."""


@stage(ROBOT, writes="latest: terminated; robots: resumed_at, sensor, status")
def follow_statuses(w, i, paths, cause: int, clock, robots, latest):
    """Let robots fail, resume or be removed by a cause."""
    moment = clock.step[w]
    if paths.cause[moment, i] == cause:
        status = paths.status[moment, i]
        if status == WORKING and robots.status[w, i] == FAILED:
            robots.resumed_at[w, i] = moment - 1
        robots.status[w, i] = status
        if cause != FAULT:
            robots.sensor[w, i] = wp.vec2(NOWHERE, NOWHERE)
            latest.terminated[w, i] = status == REMOVED


@stage(ROBOT, writes="robots: status")
def hide(w, i, paths, clock, robots):
    """Mark robots of which nothing is known as removed, so that none collides with them and no column counts them."""
    if paths.hidden[clock.step[w], i] == 1:
        robots.status[w, i] = REMOVED


@stage(ROBOT, writes="robots: status; tally: fault_end, faulted")
def unhide(w, i, paths, clock, robots, tally):
    """Mark hidden robots as failed again, unless they were removed, for the score to count their faults."""
    moment = clock.step[w]
    if paths.hidden[moment, i] == 1 and paths.status[moment, i] == FAILED:
        robots.status[w, i] = FAILED
        tally.faulted[w] = 1
        tally.fault_end[w] = -1


@stage(ROBOT, writes="robots: heading, path, phase, position, speed, status")
def follow_paths(w, i, paths, formation, clock, robots):
    """Move the robots along their paths, or place them where these begin; a removed robot stays where it was."""
    moment = clock.step[w]
    last = robots.path.shape[2] - 1
    if robots.status[w, i] == REMOVED:
        for s in range(last + 1):
            robots.path[w, i, s] = robots.position[w, i]
    else:
        for s in range(last + 1):
            robots.path[w, i, s] = paths.path[moment, i, s]
        robots.position[w, i] = paths.path[moment, i, last]
        robots.heading[w, i] = wrap(paths.heading[moment, i])
        robots.speed[w, i] = paths.speed[moment, i]
        phase = paths.phase[moment, i]
        if not wp.isnan(phase):
            if moment > 0 and wp.isnan(paths.phase[moment - 1, i]):  # of those of a place, the nearest
                turn = wp.float64(TWO_PI / float(formation.alpha))
                phase += turn * wp.floor((robots.phase[w, i] - phase) / turn + wp.float64(0.5))
            robots.phase[w, i] = wrap_phase(phase)


class PrescribedSimulation(Simulation):
    """A simulation whose robots follow given paths, whatever their actions are.

    Args:
        scenario: The scenario, of at most M - 1 steps; `paths` has its faults and the effects of collisions and of the
            edge.
        paths: The fields of `Paths`.
        num_worlds: Number of worlds, which have the same paths and different targets.
    """

    def __init__(self, scenario: Scenario, paths: Mapping[str, np.ndarray], num_worlds: int):
        m, n, places, _ = paths["path"].shape
        self._paths: Any = allocate(Paths, {"path": (m, n, places)}, (m, n), as_device("cpu"))
        for name, values in paths.items():
            getattr(self._paths, name).assign(values)
        boundary = "wall" if scenario.task.boundary == "wall" else "open"  # contacts with walls are counted
        task = dataclasses.replace(scenario.task, boundary=boundary, on_collision="count")
        super().__init__(dataclasses.replace(scenario, task=task), num_worlds)

    def _own_stages(self, begins: bool) -> list[Stage]:
        """Return the stages in which robots follow their paths, and are hidden from the measurements to the score."""
        own = {"paths": self._paths}
        faults, collisions, edge = (
            Stage(name, follow_statuses, own=own | {"cause": cause})
            for name, cause in (("faults", FAULT), ("collided", COLLISION), ("outside", EDGE))
        )
        follow = Stage("motion", follow_paths, own=own)
        phase = Stage("phase", follow_curve, when=bool(np.isnan(self._paths.phase.numpy()).any()))
        hiding, showing = Stage("hiding", hide, own=own), Stage("showing", unhide, own=own)
        # None stands for the stage itself.
        changed = {"faults": [faults], "motion": [follow], "phase": [phase], "robots": [None, faults, follow]}
        changed |= {"headway": [], "facing": []}  # which would move robots from where their paths begin
        changed |= {"measurement": [None, hiding], "boundary": [collisions, None, edge], "score": [None, showing]}
        stages = super()._own_stages(begins)
        return [one if new is None else new for one in stages for new in changed.get(one.name, [None])]
