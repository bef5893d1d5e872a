"""RLlib: the environment, and the configuration of PPO for robots and rogues."""

from training.rllib.env import LissajousMultiAgentEnv, policy_mapping_fn, two_sided_config

__all__ = ["LissajousMultiAgentEnv", "policy_mapping_fn", "two_sided_config"]
