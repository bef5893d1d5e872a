"""RLlib's PPO for both sides: a module `robots`, which all robots share, and a module `rogues`, which all rogues share.

from training.rllib.two_sided import two_sided_config

algorithm = two_sided_config("intruders", **{"task.duration": 30.0}).env_runners(num_env_runners=4).build_algo()
algorithm.train()
"""

from typing import Any

from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.multi_rl_module import MultiRLModuleSpec
from ray.rllib.core.rl_module.rl_module import RLModuleSpec

from lissajous_env import Scenario
from lissajous_env.parameters.rogues import AGENTS
from training.rllib.env import LissajousMultiAgentEnv

MODULES = "robots", "rogues"
"""Names of the modules."""


def policy_mapping_fn(agent: Any, *_: Any, **__: Any) -> str:
    """Return the module of an agent: `robots` for robot_0 ..., `rogues` for rogue_0 ...

    Raises:
        ValueError: it is neither a robot nor a rogue.
    """
    module = f"{str(agent).partition('_')[0]}s"
    if module not in MODULES:
        raise ValueError(f"agent must be a robot or a rogue, got {agent!r}")
    return module


def two_sided_config(scenario: str | Scenario = "experiment", **settings: Any) -> PPOConfig:
    """Return RLlib's configuration of PPO for both sides of a scenario; its other settings are RLlib's defaults.

    Args:
        scenario: Scenario, or its name; `rogues` is `agents`.
        **settings: Further arguments of `LissajousParallelEnv`, and fields of the scenario.
    """
    config = PPOConfig().environment(
        LissajousMultiAgentEnv,
        env_config={"scenario": scenario, "rogues": AGENTS} | settings,
        disable_env_checking=True,
        # The environment clips actions.
        normalize_actions=False,
        clip_actions=False,
    )
    config.multi_agent(policies=set(MODULES), policy_mapping_fn=policy_mapping_fn)
    config.rl_module(rl_module_spec=MultiRLModuleSpec(rl_module_specs={name: RLModuleSpec() for name in MODULES}))
    return config
