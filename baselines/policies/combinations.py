"""Combinations of coordinators, which compute phase rates, and trackers, which make robots follow them, by name.

A name consists of the coordinator's name and the tracker's suffix, as `kuramoto-mpcc`; points, which follow exactly,
have no suffix. Coordination and tracking can thus be compared separately: `consensus-gvf` is the whole method of Yao
et al., and `consensus-mpcc` their coordination alone. `register_coordinator` adds a coordinator.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

from baselines.policies import registry
from baselines.policies.coordinators.arc_length import KuramotoByArc
from baselines.policies.coordinators.base import Coordinator
from baselines.policies.coordinators.borkar import RUNNING, OpenLoop, TrackedReference
from baselines.policies.coordinators.consensus import Consensus
from baselines.policies.coordinators.kuramoto import Kuramoto
from baselines.policies.trackers.base import Coordinated, OnCurve
from baselines.policies.trackers.mpcc import WithMpcc
from baselines.policies.trackers.vector_field import WithVectorField
from lissajous_env.wording import nearest, shown

COORDINATORS: dict[str, tuple[Callable[..., Coordinator], str]] = {
    "kuramoto": (Kuramoto, "Time-inverted Kuramoto coordination, the paper's method"),
    "open-loop": (OpenLoop, "Constant phase rate of every robot, without feedback (Borkar et al.)"),
    "tracked-reference": (
        TrackedReference,
        "Each robot tracks its own reference, which stops with the robot (Borkar et al.)",
    ),
    "running-reference": (
        partial(TrackedReference, parameters=RUNNING),
        "Each robot tracks its own reference, which keeps moving if the robot stops",
    ),
    "consensus": (Consensus, "Linear consensus with the desired spacing given (Yao et al.)"),
    "arc": (KuramotoByArc, "Kuramoto on the arc length, at constant ground speed, without the guarantee"),
}
"""Coordinators by name, each with a description."""

TRACKERS: dict[str, tuple[type[Coordinated], str]] = {
    "": (OnCurve, ""),
    "-mpcc": (WithMpcc, ", for cars with model predictive contouring control"),
    "-gvf": (WithVectorField, ", for cars that follow a guiding vector field (Yao et al.)"),
}
"""Trackers by the suffix of their name, each with the end of the description."""

COMBINATIONS = {
    coordination + suffix: (coordinator, tracker, f"{what}{how}.")
    for suffix, (tracker, how) in TRACKERS.items()
    for coordination, (coordinator, what) in COORDINATORS.items()
}
"""Coordinator, tracker and description by the name of the policy."""

ON_REQUEST = ("kuramoto-gvf", "open-loop-gvf", "tracked-reference-gvf", "running-reference-gvf", "arc-gvf")
"""Policies that a benchmark plays only if they are named; they differ from `-mpcc` in the tracker alone."""


def with_tracker(
    coordinator: Callable[..., Coordinator], tracker: str = "points", **settings: Any
) -> Callable[..., Coordinated]:
    """Return a factory of policies that follow a coordinator: `factory(scenario, num_worlds, device)` makes one.

    Args:
        coordinator: Function or class, called as `coordinator(scenario, num_worlds, device)`: a subclass of
            `baselines.NumpyCoordinator`, or any class with a Warp array `phase_rate` (W, N) [rad/s] and a method
            `coordinate(observation)` that writes it.
        tracker: "mpcc" for cars with model predictive contouring control; "gvf" for cars with a guiding vector field;
            "points" for points on the curve, which follow exactly.
        **settings: Settings of the tracker, such as `parameters=baselines.mpcc.MpccParameters(...)`.

    Raises:
        ValueError: the tracker is unknown, or the coordinator is not callable.
    """
    trackers = {suffix.lstrip("-") or "points": made for suffix, (made, _) in TRACKERS.items()}
    if tracker not in trackers:
        raise ValueError(
            f"tracker must be one of {', '.join(trackers)}, got {shown(tracker)}{nearest(tracker, trackers)}"
        )
    if not callable(coordinator):
        raise ValueError(f"coordinator must be coordinator(scenario, num_worlds, device), got {shown(coordinator)}")
    return partial(trackers[tracker], coordinator, **settings)


def register_coordinator(name: str, coordinator: Callable[..., Coordinator] | None = None, about: str = "") -> Any:
    """Register a policy for each tracker: `name` for points, `name-mpcc` and `name-gvf` for cars.

    Without `coordinator`, return a decorator, as in `@register_coordinator("mine")`. The policies for cars also accept
    the suffixes of collision filters. A benchmark plays `name-gvf` only if it is named.

    Args:
        name: Name of the coordinator.
        coordinator: The coordinator, as for `with_tracker`.
        about: Description in one line; by default the first line of the coordinator's docstring.

    Returns:
        The coordinator.

    Raises:
        ValueError: another policy has the name; the same coordinator may be registered again.
    """
    if coordinator is None:
        return partial(register_coordinator, name, about=about)
    what = (about or getattr(coordinator, "__doc__", None) or "").partition("\n")[0].rstrip(".")
    for suffix, (_, how) in TRACKERS.items():
        factory = with_tracker(coordinator, suffix.lstrip("-") or "points")
        registry.register(name + suffix, None, factory, about=f"{what}{how}.", on_request=suffix == "-gvf")
    return coordinator
