"""Train a team with RLlib's PPO, on this machine or on a Ray cluster, and evaluate what it learned.

    python examples/rllib_ppo.py --scenario intruders --iterations 50
    python examples/rllib_ppo.py --address 10.0.0.1:6379 --workers 32

All robots share one module. RLlib's settings, checkpoints and further algorithms are those of its own documentation.
"""

import argparse

import ray
import torch
from ray.rllib.algorithms.algorithm import Algorithm
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.columns import Columns

import lissajous_env
from training.rllib import LissajousMultiAgentEnv

MODULE = "robot"


def config(scenario: str, workers: int, worlds: int = 8) -> PPOConfig:
    """Return RLlib's configuration: `workers` processes, each of which plays `worlds` environments."""
    settings = PPOConfig().environment(LissajousMultiAgentEnv, env_config={"scenario": scenario})
    settings.env_runners(num_env_runners=workers, num_envs_per_env_runner=worlds)
    settings.multi_agent(policies={MODULE}, policy_mapping_fn=lambda agent, episode, **_: MODULE)
    return settings.training(gamma=0.99, lr=3e-4, train_batch_size_per_learner=4000, minibatch_size=1000, num_epochs=4)


def policy_of(algorithm: Algorithm):
    """Return a function of observations (W, N, D), the mean action (W, N, action size) of the trained module."""
    module = algorithm.get_module(MODULE)

    def act(observation):
        rows = torch.from_numpy(observation).flatten(0, 1)
        outputs = module.forward_inference({Columns.OBS: rows})[Columns.ACTION_DIST_INPUTS]
        mean = outputs[:, : outputs.shape[1] // 2]  # the other half is the logarithm of the standard deviation
        return mean.clamp(-1, 1).reshape(*observation.shape[:2], -1).detach().numpy()

    return act


def main() -> None:
    """Train, print the return of each iteration, and print the scores of sixteen episodes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="intruders")
    parser.add_argument("--iterations", type=int, default=50)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--address", help="address of a Ray cluster; by default one is started on this machine")
    options = parser.parse_args()
    ray.init(options.address or "local")
    algorithm = config(options.scenario, options.workers).build_algo()
    for k in range(options.iterations):
        returns = algorithm.train()["env_runners"].get("episode_return_mean")
        print(f"iteration {k + 1}: return of the team {'-' if returns is None else f'{returns:.2f}'}")
    scenario = lissajous_env.scenario(options.scenario)
    for row in lissajous_env.evaluate(policy_of(algorithm), scenario, seeds=range(16)):
        print(
            *(f"{name} {row[name]:.3g}" for name in ("seed", "observed_fraction", "detection_time_mean", "collisions"))
        )
    algorithm.stop()


if __name__ == "__main__":
    main()
