"""Stable-Baselines3: the batch of worlds as a `VecEnv`, and its models as policies."""

from lissajous_env.plugins import missing

try:
    from training.sb3.model_policy import ModelPolicy
    from training.sb3.vec_env import RobotVecEnv, RogueVecEnv
except ImportError as error:
    raise missing("training.sb3", "train", error) from error

__all__ = ["ModelPolicy", "RobotVecEnv", "RogueVecEnv"]
