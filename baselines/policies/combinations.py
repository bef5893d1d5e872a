"""Combinations of coordinators, which compute phase rates, and trackers, which make robots follow them, by name.

A name consists of the coordinator's name and the tracker's suffix, as `kuramoto-mpcc`; points, which follow exactly,
have no suffix. Coordination and tracking can thus be compared separately: `consensus-gvf` is the whole method of Yao
et al., and `consensus-mpcc` their coordination alone. `register_coordinator` adds a coordinator.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

from baselines.policies import registry
from baselines.policies.coordinators import (
    RUNNING,
    Consensus,
    Coordinator,
    Kuramoto,
    KuramotoByArc,
    OpenLoop,
    TrackedReference,
)
from baselines.policies.trackers import Coordinated, OnCurve, WithMpcc, WithVectorField
from lissajous_env.wording import nearest, shown

TRACKERS: dict[str, tuple[type[Coordinated], str]] = {
    "points": (OnCurve, ""),
    "mpcc": (WithMpcc, ", for cars with model predictive contouring control"),
    "gvf": (WithVectorField, ", for cars that follow a guiding vector field (Yao et al.)"),
}
"""Trackers by name, each with the end of the description of a policy; the name is its suffix, except for points."""


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
    if tracker not in TRACKERS:
        rule = f"tracker must be one of {', '.join(TRACKERS)}"
        raise ValueError(f"{rule}, got {shown(tracker)}{nearest(tracker, TRACKERS)}")
    if not callable(coordinator):
        raise ValueError(f"coordinator must be coordinator(scenario, num_worlds, device), got {shown(coordinator)}")
    return partial(TRACKERS[tracker][0], coordinator, **settings)


def register_coordinator(name: str, coordinator: Callable[..., Coordinator] | None = None, about: str = "") -> Any:
    """Register a policy for each tracker: `name` for points, `name-mpcc` and `name-gvf` for cars.

    Without `coordinator`, return a decorator, as in `@register_coordinator("mine")`. The policies for cars also accept
    the suffixes of collision filters. A benchmark plays `name-gvf` only if it is named, except for the whole method of
    Yao et al.

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
    for tracker, (_, how) in TRACKERS.items():
        word = name if tracker == "points" else f"{name}-{tracker}"
        on_request = tracker == "gvf" and coordinator is not Consensus
        registry.register(word, None, with_tracker(coordinator, tracker), about=f"{what}{how}.", on_request=on_request)
    return coordinator


register_coordinator("kuramoto", Kuramoto, "Time-inverted Kuramoto coordination, the paper's method")
register_coordinator("open-loop", OpenLoop, "Constant phase rate of every robot, without feedback (Borkar et al.)")
_TRACKS = "Each robot tracks its own reference, which"
register_coordinator("tracked-reference", TrackedReference, f"{_TRACKS} stops with the robot (Borkar et al.)")
_RUNNING = partial(TrackedReference, parameters=RUNNING)
register_coordinator("running-reference", _RUNNING, f"{_TRACKS} keeps moving if the robot stops")
register_coordinator("consensus", Consensus, "Linear consensus with the desired spacing given (Yao et al.)")
register_coordinator("arc", KuramotoByArc, "Kuramoto on the arc length at constant ground speed, without the guarantee")
