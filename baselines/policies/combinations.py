"""Every coordinator over every tracker, by name: who decides the phase rates, and what makes a robot follow them.

The name is the coordinator's and the tracker's suffix, `kuramoto-mpcc`; points, which follow exactly, have no suffix.
So a rival is judged by its coordination and by its tracking apart: `consensus-gvf` is all of Yao et al., and
`consensus-mpcc` their coordination alone. `register_coordinator` adds a coordinator to those below.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

from baselines.policies import registry
from baselines.policies.coordinators.arc_length import KuramotoByArc
from baselines.policies.coordinators.consensus import Consensus
from baselines.policies.coordinators.kuramoto import Kuramoto
from baselines.policies.coordinators.open_loop import OpenLoop
from baselines.policies.coordinators.tracked_reference import RUNNING, TrackedReference
from baselines.policies.trackers.base import Coordinated, Coordinator
from baselines.policies.trackers.mpcc import WithMpcc
from baselines.policies.trackers.point import OnCurve
from baselines.policies.trackers.vector_field import WithVectorField
from lissajous_env.wording import nearest, shown

COORDINATORS: dict[str, tuple[Callable[..., Coordinator], str]] = {
    "kuramoto": (Kuramoto, "Time-inverted Kuramoto coordination, the paper's method"),
    "open-loop": (OpenLoop, "Constant phase rate of every robot, without reaction (Borkar et al.)"),
    "tracked-reference": (
        TrackedReference,
        "Each robot tracks its own reference, which stops with it (Borkar et al., later)",
    ),
    "running-reference": (
        partial(TrackedReference, parameters=RUNNING),
        "Each robot tracks its own reference, which runs on without it",
    ),
    "consensus": (Consensus, "Linear consensus, with the spacing given (Yao et al.)"),
    "arc": (KuramotoByArc, "Kuramoto on the arc length, at constant ground speed, without the guarantee"),
}
"""Coordinators by name, each with what it is."""

TRACKERS: dict[str, tuple[type[Coordinated], str]] = {
    "": (OnCurve, ""),
    "-mpcc": (WithMpcc, ", by cars under model predictive contouring control"),
    "-gvf": (WithVectorField, ", by cars that follow a guiding vector field (Yao et al.)"),
}
"""Trackers by the suffix of their name, each with what it adds to what the coordinator is."""

COMBINATIONS = {
    coordination + suffix: (coordinator, tracker, f"{what}{how}.")
    for suffix, (tracker, how) in TRACKERS.items()
    for coordination, (coordinator, what) in COORDINATORS.items()
}
"""Coordinator, tracker and what it is, by the name of the policy."""

ON_REQUEST = ("kuramoto-gvf", "open-loop-gvf", "tracked-reference-gvf", "running-reference-gvf", "arc-gvf")
"""Those that a benchmark plays only where they are named: the field costs what MPCC does not, whatever it follows."""


def with_tracker(
    coordinator: Callable[..., Coordinator], tracker: str = "points", **settings: Any
) -> Callable[..., Coordinated]:
    """Return a factory of policies that follow a coordinator: `factory(scenario, num_worlds, device)` makes one.

    Args:
        coordinator: `coordinator(scenario, num_worlds, device)` makes it: a subclass of `baselines.NumpyCoordinator`,
            or any class with a Warp array `phase_rate` (W, N) [rad/s] and `coordinate(observation)`, which writes it.
        tracker: What makes the robots follow: "mpcc", cars by model predictive contouring control; "gvf", cars by a
            guiding vector field; "points", points on the curve, which follow exactly.
        **settings: Of the tracker, as `parameters=baselines.mpcc.MpccParameters(...)`.

    Raises:
        ValueError: an unknown tracker, or what is no coordinator.
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
    """Add a policy for each tracker: `name` for points, `name-mpcc` and `name-gvf` for cars, these with `-safe` too.

    Without a coordinator, this is a decorator of one: `@register_coordinator("mine")`. A benchmark plays `name-gvf`
    only where it is named.

    Args:
        name: Its name.
        coordinator: What makes it, as for `with_tracker`.
        about: What it is, in one line; the first line of its docstring by default.

    Returns:
        The coordinator.

    Raises:
        ValueError: a name that another policy has; the same coordinator may be registered again.
    """
    if coordinator is None:
        return partial(register_coordinator, name, about=about)
    what = (about or getattr(coordinator, "__doc__", None) or "").partition("\n")[0].rstrip(".")
    for suffix, (_, how) in TRACKERS.items():
        factory = with_tracker(coordinator, suffix.lstrip("-") or "points")
        registry.register(name + suffix, None, factory, about=f"{what}{how}.", on_request=suffix == "-gvf")
    return coordinator
