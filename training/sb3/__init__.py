"""Stable-Baselines3: the batch of worlds as its `VecEnv`, and PPO on it."""

from training.sb3.ppo import RobotVecEnv

__all__ = ["RobotVecEnv"]
