"""Stable-Baselines3: the batch of worlds as its `VecEnv`, and PPO on it."""

from training.sb3.vec_env import RobotVecEnv

__all__ = ["RobotVecEnv"]
