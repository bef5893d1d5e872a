"""Stable-Baselines3: the batch of worlds as a `VecEnv`, and its models as policies."""

from training.sb3.model_policy import ModelPolicy
from training.sb3.vec_env import LissajousVecEnv

__all__ = ["LissajousVecEnv", "ModelPolicy"]
