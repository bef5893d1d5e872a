"""Policies to compare against: the paper's method, its rivals, and what a person would try first."""

import importlib
import pkgutil
from functools import partial

from baselines import policies
from baselines.policies.base import Policy
from baselines.policies.coordinators.arc_length import KuramotoByArc
from baselines.policies.coordinators.consensus import Consensus
from baselines.policies.coordinators.kuramoto import Kuramoto
from baselines.policies.coordinators.open_loop import OpenLoop
from baselines.policies.coordinators.tracked_reference import TrackedReference
from baselines.policies.patrol import Laps, RandomWaypoint, Still, Sweep
from baselines.policies.registry import make, names, register, register_opener, register_wrapper
from baselines.policies.trackers.mpcc import WithMpcc
from baselines.policies.trackers.point import OnCurve
from baselines.policies.trackers.vector_field import WithVectorField
from baselines.safety.filter import Safe

__all__ = ["Policy", "make", "names", "register", "register_opener"]

_KURAMOTO = "Time-inverted Kuramoto coordination, the paper's method"
_OPEN_LOOP = "Constant phase rate of every robot, without reaction (Borkar et al.)"
_TRACKED = "Each robot tracks its own reference, computed in open loop (Borkar et al., later)"
_MPCC = "by cars under model predictive contouring control."
register("kuramoto", "curve", partial(OnCurve, Kuramoto), about=f"{_KURAMOTO}.")
register("open-loop", "curve", partial(OnCurve, OpenLoop), about=f"{_OPEN_LOOP}.")
register("kuramoto-mpcc", "car", partial(WithMpcc, Kuramoto), about=f"{_KURAMOTO}, {_MPCC}")
register("open-loop-mpcc", "car", partial(WithMpcc, OpenLoop), about=f"{_OPEN_LOOP}, {_MPCC}")
register("tracked-reference", "curve", partial(OnCurve, TrackedReference), about=f"{_TRACKED}.")
register("tracked-reference-mpcc", "car", partial(WithMpcc, TrackedReference), about=f"{_TRACKED}, {_MPCC}")
register(
    "consensus-gvf",
    "car",
    partial(WithVectorField, Consensus),
    about="A guiding vector field and linear consensus, with the spacing given (Yao et al.).",
)
register(
    "kuramoto-arc-mpcc",
    "car",
    partial(WithMpcc, KuramotoByArc),
    about="Kuramoto on the arc length, at constant ground speed, without the guarantee.",
)
register("sweep", "car", Sweep, about="A patrol in file: around the boundary, or in lanes.")
register("laps", "car", Laps, about="The loop of the patrol, each car for itself, at top speed.")
register("random", None, RandomWaypoint, about="Random waypoints; for points random phase rates.")
register("still", None, Still, about="No motion.")
register_wrapper("-safe", "car", Safe)

# A policy in a file of its own there registers itself.
for _module in sorted(each.name for each in pkgutil.walk_packages(policies.__path__, f"{policies.__name__}.")):
    importlib.import_module(_module)
