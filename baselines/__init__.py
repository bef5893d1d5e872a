"""Classical policies to compare with: the paper's method, competing methods and simple patrols."""

import importlib
import pkgutil
from functools import partial

from baselines import policies
from baselines.policies.base import Policy as Policy
from baselines.policies.coordinators import NumpyCoordinator as NumpyCoordinator
from baselines.policies.dividing import Cover, DividedPursuit, Herd
from baselines.policies.index_rule import Index
from baselines.policies.own_row import Rows as Rows
from baselines.policies.patrol import Laps, RandomWaypoint, Still, Sweep
from baselines.policies.reacting import Chase, Follow, Force, Lanes, VoronoiPursuit
from baselines.policies.registry import make as make
from baselines.policies.registry import names as names
from baselines.policies.registry import register as register
from baselines.policies.trackers import register_coordinator as register_coordinator
from baselines.policies.trackers import with_tracker as with_tracker

register("sweep", "car", Sweep, about="Single-file patrol along the boundary, or in lanes.")
register("laps", "car", Laps, about="The loop of `sweep`, each car independently, at top speed.")
for _name, _factory, _scenarios, _about in (
    ("lanes", Lanes, (), "Patrol of lanes along the shorter side, at equal distances; it observes no target."),
    ("follow", Follow, ("watch",), "Drive to the nearest target in sight."),
    ("a-cmommt", Force, ("watch",), "Forces towards targets and away from robots (Parker, 2002)."),
    ("greedy-cover", Cover, ("watch",), "Drive where the most known targets are near."),
    ("greedy-herd", Herd, ("watch",), "Greedy cover that drives fleeing targets into corners and keeps them there."),
    ("pure-pursuit", partial(Chase, lead=0.0), ("intercept",), "Drive to the nearest target in sight of any robot."),
    ("lead-pursuit", Chase, ("intercept",), "Drive to where the nearest target in sight of any robot will be."),
    ("divided-pursuit", DividedPursuit, ("intercept",), "Lead pursuit of targets that are divided among the robots."),
    (
        "voronoi-pursuit",
        VoronoiPursuit,
        ("intercept",),
        "Shrink the Voronoi cell of the nearest target in sight of any robot (Huang et al., 2011).",
    ),
    ("index", partial(Index, learns=False), ("hotspots",), "Drive to the most targets per time, at uniform rates."),
    ("index-learned", Index, ("hotspots",), "Drive to the most targets per time, at rates that it learns."),
):
    register(_name, "velocity", _factory, made_for=_scenarios, about=_about)
register("random", None, RandomWaypoint, about="Random waypoints; random phase rates for points.")
register("still", None, Still, about="No motion.")

# A policy in a file of its own there registers itself.
for _module in sorted(module.name for module in pkgutil.walk_packages(policies.__path__, f"{policies.__name__}.")):
    importlib.import_module(_module)

# These import policies, and those above are to be the first in the registry.
from baselines.onboard.robot import Onboard as Onboard  # noqa: E402
from baselines.planning.portfolio import chosen as chosen  # noqa: E402
from baselines.planning.search import plan as plan  # noqa: E402
