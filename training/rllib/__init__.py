"""RLlib: the environment, and PPO over a cluster."""

from training.rllib.env import LissajousMultiAgentEnv

__all__ = ["LissajousMultiAgentEnv"]
