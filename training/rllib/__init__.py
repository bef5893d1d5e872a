"""RLlib: the environment, and the configuration of PPO for robots and rogues."""

from training.rllib.env import LissajousMultiAgentEnv

__all__ = ["LissajousMultiAgentEnv"]
