"""Stable-Baselines3: the batch of worlds as a `VecEnv`, its models as policies, and training by PPO."""

from training.sb3.mixed_vec_env import MixedVecEnv
from training.sb3.model_policy import ModelPolicy
from training.sb3.vec_env import RobotVecEnv, RogueVecEnv

__all__ = ["MixedVecEnv", "ModelPolicy", "RobotVecEnv", "RogueVecEnv"]
