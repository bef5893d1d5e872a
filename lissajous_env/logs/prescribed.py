"""A simulation whose robots follow given paths: everything else is as in any simulation."""

from typing import Any

import numpy as np
import warp as wp

from lissajous_env.device.compilation import OPTIONS
from lissajous_env.device.curve import wrap, wrap_phase
from lissajous_env.device.devices import as_device
from lissajous_env.device.program import Stage
from lissajous_env.device.stage import ROBOT, WORLD
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.robots.placing import follow_curve
from lissajous_env.world.simulation import Simulation
from lissajous_env.world.state import REMOVED, STUCK, Clock, Robots, allocate
from lissajous_env.world.tally import EpisodeTotals

wp.set_module_options(OPTIONS)


@wp.struct
class Paths:
    """Paths of N robots at M moments, with S + 1 places on the way to each moment."""

    track: wp.array3d(dtype=wp.vec3)
    """(M, N, S + 1) places from the moment before to this one [m]."""
    heading: wp.array2d(dtype=wp.float32)
    """(M, N) headings [rad]."""
    speed: wp.array2d(dtype=wp.float32)
    """(M, N) speeds over the ground [m/s]."""
    phase: wp.array2d(dtype=wp.float64)
    """(M, N) phases [rad]; NaN where the phase follows the curve from the one before."""
    hidden: wp.array2d(dtype=wp.int32)
    """(M, N) 1 where nothing is known of the robot in the step to a moment."""


@wp.kernel
def hide(first: int, lanes: int, paths: Paths, clock: Clock, robots: Robots):
    """Take robots of which nothing is known for removed, so that none collides with them and no column counts them."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 1:
        for i in range(lane, robots.status.shape[1], lanes):
            if paths.hidden[clock.step[w], i] == 1:
                robots.status[w, i] = REMOVED


@wp.kernel
def unhide(first: int, paths: Paths, clock: Clock, robots: Robots, tally: EpisodeTotals):
    """Take them for failed again, unless they were removed."""
    w = first + wp.tid()
    if clock.active[w] == 1:
        for i in range(robots.status.shape[1]):
            if paths.hidden[clock.step[w], i] == 1 and robots.removed_at[w, i] >= clock.step[w]:
                robots.status[w, i] = STUCK
                tally.faulted[w] = 1
                tally.fault_end[w] = -1


@wp.kernel
def follow_paths(first: int, lanes: int, paths: Paths, clock: Clock, robots: Robots):
    """Move the robots along their paths, or place them where these begin; a removed robot stays where it was."""
    tid, lane = wp.tid()
    w = first + tid
    if clock.active[w] == 0:
        return
    moment = clock.step[w]
    last = robots.track.shape[2] - 1
    for i in range(lane, robots.status.shape[1], lanes):
        if robots.status[w, i] == REMOVED:
            for s in range(last + 1):
                robots.track[w, i, s] = robots.position[w, i]
        else:
            for s in range(last + 1):
                robots.track[w, i, s] = paths.track[moment, i, s]
            robots.position[w, i] = paths.track[moment, i, last]
            robots.heading[w, i] = wrap(paths.heading[moment, i])
            robots.speed[w, i] = paths.speed[moment, i]
            if not wp.isnan(paths.phase[moment, i]):
                robots.phase[w, i] = wrap_phase(paths.phase[moment, i])
            if moment == 0 and paths.hidden[0, i] == 1:
                robots.status[w, i] = STUCK


class PrescribedSimulation(Simulation):
    """A simulation whose robots follow given paths, whatever their actions are.

    Args:
        scenario: The scenario, of at most M - 1 steps.
        track: (M, N, S + 1, 3) places on the way to each of M moments [m]; S is `task.substeps`.
        heading: (M, N) headings [rad].
        speed: (M, N) speeds over the ground [m/s].
        phase: (M, N) phases [rad]; NaN where the phase follows the curve from the one before.
        hidden: (M, N) True where nothing is known of the robot in the step to a moment.
        num_worlds: Number of worlds, which have the same paths and different targets.
        seed: Seed of world 0.
    """

    def __init__(
        self,
        scenario: Scenario,
        track: np.ndarray,
        heading: np.ndarray,
        speed: np.ndarray,
        phase: np.ndarray,
        hidden: np.ndarray,
        num_worlds: int = 1,
        seed: int = 0,
    ):
        m, n, places, _ = track.shape
        paths: Any = allocate(Paths, {"track": (m, n, places)}, (m, n), as_device("cpu"))
        named = {"track": track, "heading": heading, "speed": speed, "phase": phase, "hidden": hidden.astype(np.int32)}
        for name, values in named.items():
            getattr(paths, name).assign(values)
        self._paths, self._follows = paths, bool(np.isnan(phase).any())
        super().__init__(scenario, num_worlds, seed=seed)

    def _own_stages(self) -> tuple[list[Stage], list[Stage]]:
        at_reset, at_step = super()._own_stages()
        own = {"paths": self._paths}
        place = [stage.name for stage in at_reset].index("robots") + 1
        at_reset.insert(place, Stage("paths", follow_paths, ROBOT, own=own))
        motion = Stage("motion", follow_paths, ROBOT, own=own)
        follow = Stage("phase", follow_curve, when=self._follows)
        moved = [motion if stage.name == "motion" else stage for stage in at_step if stage.name != "phase"]
        moved.insert([stage.name for stage in moved].index("motion") + 1, follow)
        return self._hiding(at_reset, own), self._hiding(moved, own)

    def _hiding(self, stages: list[Stage], own: dict[str, Any]) -> list[Stage]:
        """Return stages between which robots are hidden: from the measurements to the score."""
        names = [stage.name for stage in stages]
        first, last = names.index("measurement") + 1, names.index("score") + 1
        begin, end = Stage("hiding", hide, ROBOT, own=own), Stage("showing", unhide, WORLD, own=own)
        return [*stages[:first], begin, *stages[first:last], end, *stages[last:]]
