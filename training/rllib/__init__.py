"""RLlib: the environment, PPO over a cluster, and what it goes on from."""

from training.rllib.env import LissajousMultiAgentEnv

__all__ = ["LissajousMultiAgentEnv"]
