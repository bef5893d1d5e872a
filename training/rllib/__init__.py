"""RLlib: the environment."""

from training.rllib.env import LissajousMultiAgentEnv

__all__ = ["LissajousMultiAgentEnv"]
