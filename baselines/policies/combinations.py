"""Every coordinator over every tracker, by name: who decides the phase rates, and what makes a robot follow them.

The name is the coordinator's and the tracker's suffix, `kuramoto-mpcc`; points, which follow exactly, have no suffix.
So a rival is judged by its coordination and by its tracking apart: `consensus-gvf` is all of Yao et al., and
`consensus-mpcc` their coordination alone.
"""

from collections.abc import Callable
from functools import partial

from baselines.policies.coordinators.arc_length import KuramotoByArc
from baselines.policies.coordinators.consensus import Consensus
from baselines.policies.coordinators.kuramoto import Kuramoto
from baselines.policies.coordinators.open_loop import OpenLoop
from baselines.policies.coordinators.tracked_reference import RUNNING, TrackedReference
from baselines.policies.trackers.base import Coordinated, Coordinator
from baselines.policies.trackers.mpcc import WithMpcc
from baselines.policies.trackers.point import OnCurve
from baselines.policies.trackers.vector_field import WithVectorField

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
