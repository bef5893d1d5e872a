"""Policies to compare against: the paper's method, its rivals, and what a person would try first."""

from functools import partial

from baselines.arc import KuramotoByArc
from baselines.consensus import Consensus
from baselines.coordinated import OnCurve, WithMpcc
from baselines.kuramoto import Kuramoto
from baselines.open_loop import OpenLoop
from baselines.patrol import Laps, RandomWaypoint, Still, Sweep
from baselines.policy import Policy
from baselines.registry import make, names, register, register_opener, register_wrapper
from baselines.safety import Safe
from baselines.tracked_reference import TrackedReference
from baselines.vector_field import WithVectorField

__all__ = ["Policy", "make", "names", "register", "register_opener"]

register("kuramoto", "curve", partial(OnCurve, Kuramoto))
register("open-loop", "curve", partial(OnCurve, OpenLoop))
register("kuramoto-mpcc", "car", partial(WithMpcc, Kuramoto))
register("open-loop-mpcc", "car", partial(WithMpcc, OpenLoop))
register("tracked-reference", "curve", partial(OnCurve, TrackedReference))
register("tracked-reference-mpcc", "car", partial(WithMpcc, TrackedReference))
register("consensus-gvf", "car", partial(WithVectorField, Consensus))
register("kuramoto-arc-mpcc", "car", partial(WithMpcc, KuramotoByArc))
register("sweep", "car", Sweep)
register("laps", "car", Laps)
register("random", None, RandomWaypoint)
register("still", None, Still)
register_wrapper("-safe", "car", Safe)
