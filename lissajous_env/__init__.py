"""Multi-robot persistent monitoring and target detection on Lissajous curves, for PettingZoo and Gymnasium."""

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
from lissajous_env.episodes.evaluation import evaluate
from lissajous_env.parameters.extensions import (
    observation_entry,
    reward_term,
    score_column,
    target_entry,
    target_motion,
)
from lissajous_env.parameters.named import (
    register_scenario,
    scenario,
    scenario_space,
    scenario_spaces,
    scenarios,
)
from lissajous_env.parameters.robot_models import AsCar, RobotModel, register_robot_model
from lissajous_env.parameters.rogues import rogue, rogues
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
    "Scenario",
    "ScenarioSpace",
    "Sensing",
    "Simulation",
    "Targets",
    "Task",
    "env",
    "evaluate",
    "observation_entry",
    "parallel_env",
    "register_robot_model",
    "register_scenario",
    "reward_term",
    "rogue",
    "rogues",
    "scenario",
    "scenario_space",
    "scenario_spaces",
    "scenarios",
    "score_column",
    "target_entry",
    "target_motion",
    "vector_env",
]

parallel_env = LissajousParallelEnv
