"""Stable-Baselines3: the batch of worlds as a `VecEnv`, and its models as policies."""

from lissajous_env.plugins import requiring

with requiring("training.sb3", "train"):
    from training.sb3.model_policy import ModelPolicy
    from training.sb3.vec_env import RobotVecEnv, RogueVecEnv

__all__ = ["ModelPolicy", "RobotVecEnv", "RogueVecEnv"]
