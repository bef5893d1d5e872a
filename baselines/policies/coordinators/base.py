"""The base classes of coordinators in a Warp kernel, and in NumPy."""

from typing import Any

import numpy as np
import warp as wp

from baselines.policies.rows import Rows
from lissajous_env.device.devices import copy_in
from lissajous_env.device.program import launcher
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.world.extended import read_only

PHASES = "phases of ring neighbours"
"""Content of the messages of a coordinator that defines none."""


class Coordinator:
    """Base class of coordinators, which decide phase rates from observations.

    A subclass sets `kernel`, whose arguments are `inputs`, the observation and the rates. A coordinator without this
    base class has `phase_rate` and `coordinate`.

    Attributes:
        scenario: The scenario, with every field filled in.
        num_worlds: Number of worlds W.
        natural_rate: omega / alpha, the phase rate of the formation [rad/s].
        phase_rate: (W, N) theta' of each robot from now on, on the device [rad/s].
    """

    kernel: Any

    def __init__(self, scenario: Scenario, num_worlds: int, device: Any):
        self.scenario, self.num_worlds = scenario.resolve(), num_worlds
        self.natural_rate = scenario.formation.phase_rate / scenario.alpha
        self.phase_rate = wp.zeros((num_worlds, scenario.num_robots), dtype=wp.float32, device=device)
        self.inputs: list[Any] = []
        self._launch = launcher(device)

    def coordinate(self, observation: wp.array) -> None:
        """Write `phase_rate`."""
        self._launch(self.kernel, self.phase_rate.shape, [*self.inputs, observation], [self.phase_rate])

    def forget(self, mask: np.ndarray) -> None:
        """Reset the memory of the worlds in a mask (W,), whose episodes begin anew."""


class NumpyCoordinator(Coordinator):
    """Base class of coordinators in NumPy; a subclass implements `rates`, and also `forget` if it has a memory.

        class Together(baselines.NumpyCoordinator):
            def rates(self, rows):
                return self.natural_rate + 0.1 * np.sin(rows.lead).sum(axis=-1)

    `baselines.with_tracker` returns a policy with the coordinator; `baselines.register_coordinator` registers one for
    each tracker. `self.scenario` has every field filled in, `self.natural_rate` is omega / alpha, the phase rate of the
    formation [rad/s].
    """

    def rates(self, rows: Rows) -> np.ndarray:
        """Return the phase rates theta' (W, N) of the robots until the next step [rad/s], given their rows."""
        raise NotImplementedError(f"{type(self).__name__} must have a method rates(rows) that returns phase rates")

    def coordinate(self, observation: wp.array) -> None:
        """Write `phase_rate`.

        Raises:
            ValueError: `rates` returned another shape, no numbers, or a number that is not finite.
        """
        rates, name = self.rates(Rows(read_only(observation.numpy()), self.scenario)), type(self).__name__
        copy_in(f"rates of {name}", rates, self.phase_rate)
        finite = np.isfinite(np.asarray(rates))
        if not finite.all():
            w, i = np.argwhere(~finite)[0]
            raise ValueError(f"rates of {name} must be finite [rad/s], got {rates[w, i]} for robot_{i} in world {w}")
