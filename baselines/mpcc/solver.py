"""The paper's model predictive contouring controller, problem (11)-(15), for a batch of cars at once.

State X = x, y, heading, v, gamma; control delta, tau; M stages of length h; f one Runge-Kutta step of (12) over h with
gamma' = v / ||r'(gamma)|| by (14) as the last row:

    minimise   sum_{k=0..M}    (phase_rate - v_k / ||r'(gamma_k)||)^2 + q_lag e_lag(X_k)^2 + q_lat e_lat(X_k)^2
             + sum_{k=0..M-1}  q_3 delta_k^2 + q_4 tau_k^2                                                        (11a)
    subject to X_{k+1} = f(X_k, delta_k, tau_k), X_0 given, delta_k and tau_k in their bounds (11c)

The errors are those of (x, y) relative to r(gamma), along and across the tangent there. Heading and gamma are not
wrapped, and no point is projected on the curve, which crosses itself. The model is smooth and may predict a speed
slightly below 0 (down to -0.13 m/s at the smallest throttle), where the simulated car would not move.

Differs from the paper: gamma replaces the arc length s; this is the same model without inverting (14); the inputs are
summed up to M - 1, since those of stage M have no effect.
"""

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import warp as wp

from baselines.mpcc.frame import Series
from baselines.mpcc.kernel import EARLY, KEEP, Scratch, solve, solve_lissajous
from baselines.mpcc.model import MpccParameters, MpccStruct, tabulate, vec5
from lissajous_env.device.compilation import CONTRACTED
from lissajous_env.device.copies import Copyable
from lissajous_env.device.curve import curve_struct
from lissajous_env.device.devices import as_device, compile_quietly, copy_in, cores, is_torch
from lissajous_env.device.structs import to_struct
from lissajous_env.device.work import Work, load, task_count
from lissajous_env.parameters.scenario import Curve
from lissajous_env.settings.checks import whole_number

wp.set_module_options(CONTRACTED)

solve_series = wp.overload(wp.Kernel(solve.func, module=wp.get_module(__name__)), {"curve": Series})
"""The kernel of `baselines.mpcc.kernel` for curves of harmonics; in this module, which is compiled only where such a
curve is driven, it leaves the rounding of the other kernel alone."""

SMALLEST_SHARE = 64
"""Smallest number of problems for which another thread is used."""


class Solution(NamedTuple):
    """Result of `Mpcc.solve`: new NumPy arrays for NumPy input, otherwise the solver's Warp arrays."""

    control: Any
    """(K, M, 2) steering [rad] and throttle."""
    trajectory: Any
    """(K, M + 1, 5) predicted x, y [m], heading [rad], speed [m/s], gamma [rad]."""
    cost: Any
    """(K,) value of (11a); 3e38 where the solve failed, because the state or the cost of every start was not finite."""
    iterations: Any
    """(K,) iterations, summed over the starts."""


class Mpcc(Copyable):
    """K problems (11)-(15) on one device, each warm-started from its last solution.

    `solve` is the convenient method. In a control loop, write to the Warp arrays `state` (K, 5) and `phase_rate` (K,),
    call `launch()`, and read `control` (K, M, 2), `trajectory` (K, M + 1, 5), `cost` and `iterations` (K,), all on the
    device; no data passes through the host. `threads` limits the threads of a CPU; by default, all cores are used.

    If a solve fails, the control brakes (steering 0, smallest throttle), the cost is 3e38, and the next solve starts
    without a guess.
    """

    def __init__(
        self,
        curve: Curve,
        parameters: MpccParameters | None = None,
        batch: int = 1,
        device: Any = "cpu",
        threads: int | None = None,
    ):
        self.batch = whole_number("batch", batch)
        self.threads = cores() if threads is None else whole_number("threads", threads)
        self.curve = curve
        self.parameters = parameters or MpccParameters()
        self.device = as_device(device)
        M = self.parameters.stages
        self.state = self._zeros((batch, 5))
        self.phase_rate = self._zeros((batch,))
        self.control = self._zeros((batch, M, 2))
        self.trajectory = self._zeros((batch, M + 1, 5))
        self.cost = self._zeros((batch,))
        self.iterations = self._zeros((batch,), wp.int32)
        self._begin = self._zeros((batch,), wp.int32)
        self._work = self._record(0, batch)

    def solve(self, state: Any, phase_rate: Any, guess: Any = None) -> Solution:
        """Solve all K problems.

        Args:
            state: (K, 5) x, y [m], heading [rad], speed [m/s], gamma [rad]; NumPy, torch or Warp.
            phase_rate: (K,) wanted rate of gamma [rad/s].
            guess: (K, M, 2) controls to start from; None shifts the last solution by `parameters.shift` of a stage, or
                on the first call and after a failure starts along the curve.
        """
        copy_in("state", state, self.state)
        copy_in("phase_rate", phase_rate, self.phase_rate)
        if guess is not None:
            copy_in("guess", guess, self.control)
            self._begin.fill_(KEEP)
        self.launch()
        results = (self.control, self.trajectory, self.cost, self.iterations)
        if not isinstance(state, wp.array) and not is_torch(state):
            return Solution(*(array.numpy().copy() for array in results))
        return Solution(*results)

    def launch(self) -> None:
        """Solve the problems given by `state` and `phase_rate`; on a CPU, large batches are split over the cores."""
        self._work()

    def reset(self, mask: Any = None) -> None:
        """Delete the warm starts of the problems in `mask`, (K,) booleans; None deletes all of them."""
        if mask is None:
            self._begin.fill_(EARLY)
            return
        chosen = mask.numpy() if isinstance(mask, wp.array) else np.asarray(mask)
        if chosen.shape != (self.batch,):
            raise ValueError(f"mask must have shape {(self.batch,)}, got {chosen.shape}")
        self._begin.assign(np.where(chosen, EARLY, self._begin.numpy()).astype(np.int32))

    def restrict(self, problem: int) -> None:
        """Solve only one problem, from 0 to K - 1, from now on; the results of the others are no longer written."""
        self._work = self._record(whole_number("problem", problem, 0, self.batch - 1), 1)

    def _zeros(self, shape: tuple[int, ...], dtype: Any = wp.float32) -> Any:
        return wp.zeros(shape, dtype=dtype, device=self.device)

    def _scratch(self) -> Any:
        M = self.parameters.stages
        scratch: Any = Scratch()
        for name, rows, dtype in (
            ("state", 2 * (M + 1), vec5),
            ("control", 2 * M, wp.vec2),
            ("change", M, wp.vec2),
            ("gain", 2 * M, vec5),
        ):
            # On a CPU, the rows of a thread are adjacent; on a GPU, the elements of a row of all threads are.
            cpu = self.device.is_cpu
            array = self._zeros((self.batch, rows) if cpu else (rows, self.batch), dtype)
            setattr(scratch, name, array.transpose() if cpu else array)
        return scratch

    def _record(self, first: int, count: int) -> Work:
        p, kernel = to_struct(MpccStruct, self.parameters), solve_lissajous
        curve = curve_struct(self.curve, self.device)
        if self.curve.driven.harmonics:
            harmonics: Any = Series()
            harmonics.curve = curve
            curve, kernel = harmonics, solve_series
        table, scratch = tabulate(self.curve, self.device), self._scratch()
        outputs = [self.control, self.trajectory, self.cost, self.iterations]
        tasks = task_count(count // SMALLEST_SHARE, self.device, self.threads)
        edges = [first + count * task // tasks for task in range(tasks + 1)]

        def launch(low: int, high: int) -> Any:
            inputs = [p, curve, table, low, self.state, self.phase_rate, scratch, self._begin]
            return wp.launch(kernel, high - low, inputs, outputs, device=self.device, record_cmd=True)

        with compile_quietly():
            load([kernel], self.device)
            return Work([[launch(*problems)] for problems in pairwise(edges)], self.device, self.threads)
