"""Multi-robot persistent monitoring and target detection on Lissajous curves, for PettingZoo and Gymnasium."""

from typing import Any as _Any

# Before all others, whose import Ctrl-C may interrupt.
from lissajous_env.console import interrupts as _interrupts  # noqa: F401

# isort: split
# Before all others: a scenario can be made only once the robot models and the scripted rogues are registered.
from lissajous_env.world import robots as _robots  # noqa: F401
from lissajous_env.world import rogues as _rogues  # noqa: F401

# isort: split
from lissajous_env.envs.batch import Batch
from lissajous_env.envs.gymnasium_env import LissajousEnv
from lissajous_env.envs.gymnasium_vector import LissajousVectorEnv, vector_env
from lissajous_env.envs.pettingzoo_env import LissajousParallelEnv, env
from lissajous_env.episodes.evaluation import BASES as _BASES
from lissajous_env.episodes.evaluation import base as _base
from lissajous_env.episodes.evaluation import evaluate, load, policies, policy
from lissajous_env.parameters.extensions import observation_entry, reward_term, score_column, target_motion
from lissajous_env.parameters.named import (
    register_scenario,
    register_scenario_space,
    scenario,
    scenario_space,
    scenario_spaces,
    scenarios,
)
from lissajous_env.parameters.robot_models import AsCar, RobotModel, register_robot_model
from lissajous_env.parameters.rogues import Rogue, register_rogue, rogue, rogues
from lissajous_env.parameters.scenario import (
    Curve,
    Faults,
    Formation,
    Messages,
    Noise,
    Robot,
    Scenario,
    Sensing,
    Targets,
    Task,
)
from lissajous_env.parameters.space import ScenarioSpace
from lissajous_env.world.simulation import Simulation

__all__ = [
    "AsCar",
    "Batch",
    "Curve",
    "Faults",
    "Formation",
    "LissajousEnv",
    "LissajousParallelEnv",
    "LissajousVectorEnv",
    "Messages",
    "Noise",
    "Robot",
    "RobotModel",
    "Rogue",
    "Scenario",
    "ScenarioSpace",
    "Sensing",
    "Simulation",
    "Targets",
    "Task",
    "env",
    "evaluate",
    "load",
    "observation_entry",
    "parallel_env",
    "policies",
    "policy",
    "register_robot_model",
    "register_rogue",
    "register_scenario",
    "register_scenario_space",
    "reward_term",
    "rogue",
    "rogues",
    "scenario",
    "scenario_space",
    "scenario_spaces",
    "scenarios",
    "score_column",
    "target_motion",
    "vector_env",
]

parallel_env = LissajousParallelEnv


def __getattr__(name: str) -> _Any:
    """Return a base for custom policies, such as `lissajous_env.Policy`, imported from `baselines` on demand."""
    if name not in _BASES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return _base(name)


def __dir__() -> list[str]:
    return sorted({*globals(), *_BASES})
