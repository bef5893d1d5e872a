"""Multi-robot persistent monitoring and target detection on Lissajous curves, for PettingZoo and Gymnasium."""

# Before all others, whose import Ctrl-C may interrupt.
from lissajous_env.console import interrupts as _interrupts  # noqa: F401

# isort: split
# Before all others: a scenario can be made only once the robot models and the scripted rogues are registered.
from lissajous_env.world import robots as _robots  # noqa: F401
from lissajous_env.world import rogues as _rogues  # noqa: F401

# isort: split
from lissajous_env.envs.batch import Batch as Batch
from lissajous_env.envs.gymnasium_env import LissajousEnv as LissajousEnv
from lissajous_env.envs.gymnasium_vector import LissajousVectorEnv as LissajousVectorEnv
from lissajous_env.envs.pettingzoo_env import LissajousParallelEnv as LissajousParallelEnv
from lissajous_env.envs.pettingzoo_env import env as env
from lissajous_env.episodes.evaluation import evaluate as evaluate
from lissajous_env.parameters.extensions import observation_entry as observation_entry
from lissajous_env.parameters.extensions import reward_term as reward_term
from lissajous_env.parameters.extensions import score_column as score_column
from lissajous_env.parameters.extensions import target_entry as target_entry
from lissajous_env.parameters.extensions import target_motion as target_motion
from lissajous_env.parameters.named import register_scenario as register_scenario
from lissajous_env.parameters.named import scenario as scenario
from lissajous_env.parameters.named import scenario_space as scenario_space
from lissajous_env.parameters.named import scenario_spaces as scenario_spaces
from lissajous_env.parameters.named import scenarios as scenarios
from lissajous_env.parameters.robot_models import AsCar as AsCar
from lissajous_env.parameters.robot_models import RobotModel as RobotModel
from lissajous_env.parameters.robot_models import register_robot_model as register_robot_model
from lissajous_env.parameters.rogues import rogue as rogue
from lissajous_env.parameters.rogues import rogues as rogues
from lissajous_env.parameters.scenario import Scenario as Scenario
from lissajous_env.parameters.space import ScenarioSpace as ScenarioSpace
from lissajous_env.settings.parts import Curve as Curve
from lissajous_env.settings.parts import Faults as Faults
from lissajous_env.settings.parts import Formation as Formation
from lissajous_env.settings.parts import Noise as Noise
from lissajous_env.settings.parts import Robot as Robot
from lissajous_env.settings.task import Messages as Messages
from lissajous_env.settings.task import Sensing as Sensing
from lissajous_env.settings.task import Targets as Targets
from lissajous_env.settings.task import Task as Task
from lissajous_env.world.simulation import Simulation as Simulation

parallel_env, vector_env = LissajousParallelEnv, LissajousVectorEnv
