"""Multi-robot persistent monitoring and target detection on Lissajous curves, for PettingZoo and Gymnasium."""

import gymnasium as _gymnasium
import pettingzoo as _pettingzoo

from lissajous_env.envs.gymnasium_env import LissajousEnv
from lissajous_env.envs.gymnasium_vector import LissajousVectorEnv, vector_env
from lissajous_env.envs.pettingzoo_env import LissajousParallelEnv, env, parallel_env
from lissajous_env.episodes.evaluation import evaluate
from lissajous_env.parameters import named as _library
from lissajous_env.parameters.extensions import observation_entry, reward_term, score_column, target_motion
from lissajous_env.parameters.scenario import Curve, Faults, Formation, Noise, Robot, Scenario, Sensing, Targets, Task
from lissajous_env.world.robots.model import RobotModel
from lissajous_env.world.robots.table import register_robot_model
from lissajous_env.world.simulation import Simulation

scenario, scenarios = _library.scenario, _library.scenarios

__all__ = [
    "Curve",
    "Faults",
    "Formation",
    "LissajousEnv",
    "LissajousParallelEnv",
    "LissajousVectorEnv",
    "Noise",
    "Robot",
    "RobotModel",
    "Scenario",
    "Sensing",
    "Simulation",
    "Targets",
    "Task",
    "env",
    "evaluate",
    "observation_entry",
    "parallel_env",
    "register_robot_model",
    "reward_term",
    "scenario",
    "scenarios",
    "score_column",
    "target_motion",
    "vector_env",
]

for _name in scenarios():
    _id, _settings = f"lissajous/{_name}-v0", {"scenario": _name}
    _gymnasium.register(
        id=_id,
        entry_point="lissajous_env.envs.gymnasium_env:LissajousEnv",
        vector_entry_point="lissajous_env.envs.gymnasium_vector:LissajousVectorEnv",
        kwargs=_settings,
    )
    _pettingzoo.register("parallel", _id, "lissajous_env.envs.pettingzoo_env:parallel_env", kwargs=_settings)
    _pettingzoo.register("aec", _id, "lissajous_env.envs.pettingzoo_env:env", kwargs=_settings)
