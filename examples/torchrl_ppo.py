"""Train a team with PPO from the parts of TorchRL: collector, advantages, clipped loss.

    python examples/torchrl_ppo.py --scenario watch --iterations 50

All robots share the actor, which reads their rows, and a central critic, which reads the rows of the whole team.
"""

import argparse

import torch
from tensordict.nn import NormalParamExtractor, TensorDictModule
from torch import nn
from torchrl.collectors import Collector
from torchrl.modules import MultiAgentMLP, ProbabilisticActor, TanhNormal
from torchrl.objectives import ClipPPOLoss, ValueEstimators

import lissajous_env
from training.torchrl import LissajousTorchEnv, ModulePolicy

OBSERVATION, ACTION, VALUE = ("robot", "observation"), ("robot", "action"), ("robot", "state_value")
EPOCHS, MINIBATCHES = 4, 4


def networks(env: LissajousTorchEnv) -> tuple[ProbabilisticActor, TensorDictModule]:
    """Return actor and critic."""
    robots, inputs = env.observation_spec[OBSERVATION].shape[1:]
    outputs = env.action_spec_unbatched[ACTION].shape[-1]
    common = {"n_agents": robots, "share_params": True, "depth": 2, "num_cells": 64, "activation_class": nn.Tanh}
    body = nn.Sequential(
        MultiAgentMLP(n_agent_inputs=inputs, n_agent_outputs=2 * outputs, centralized=False, **common),
        NormalParamExtractor(),
    )
    parameters = [("robot", "loc"), ("robot", "scale")]
    actor = ProbabilisticActor(
        TensorDictModule(body, [OBSERVATION], parameters), spec=env.action_spec_unbatched, in_keys=parameters,
        out_keys=[ACTION], distribution_class=TanhNormal, return_log_prob=True,
    )  # fmt: skip
    critic = MultiAgentMLP(n_agent_inputs=inputs, n_agent_outputs=1, centralized=True, **common)
    return actor, TensorDictModule(critic, [OBSERVATION], [VALUE])


def train(scenario: str, iterations: int, worlds: int = 64, horizon: int = 25) -> ProbabilisticActor:
    """Return the actor after some iterations, in each of which every world plays `horizon` steps."""
    torch.manual_seed(0)
    env = LissajousTorchEnv(scenario, worlds, seed=0)
    actor, critic = networks(env)
    loss = ClipPPOLoss(
        actor, critic, entropy_coeff=0.001, normalize_advantage=True, normalize_advantage_exclude_dims=(-1,)
    )
    loss.set_keys(
        reward=("robot", "reward"), action=ACTION, value=VALUE, done=("robot", "done"),
        terminated=("robot", "terminated"), sample_log_prob=("robot", "action_log_prob"),
    )  # fmt: skip
    loss.make_value_estimator(ValueEstimators.GAE, gamma=0.99, lmbda=0.95)
    optimizer = torch.optim.Adam(loss.parameters(), lr=3e-4)
    frames = worlds * horizon
    collector = Collector(env, actor, frames_per_batch=frames, total_frames=iterations * frames)
    for k, data in enumerate(collector):
        with torch.no_grad():
            loss.value_estimator(data)
        rows = data.reshape(-1)
        for _ in range(EPOCHS):
            for chosen in torch.randperm(frames).chunk(MINIBATCHES):
                losses = loss(rows[chosen])
                optimizer.zero_grad()
                sum(value for name, value in losses.items() if name.startswith("loss_")).backward()
                nn.utils.clip_grad_norm_(loss.parameters(), 1.0)
                optimizer.step()
        collector.update_policy_weights_()
        print(f"iteration {k + 1}: mean reward {data['next', 'robot', 'reward'].mean():.4f}", flush=True)
    collector.shutdown()
    return actor


def main() -> None:
    """Train, and print the scores of sixteen episodes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="watch")
    parser.add_argument("--iterations", type=int, default=50)
    options = parser.parse_args()
    policy = ModulePolicy(train(options.scenario, options.iterations), options.scenario, num_worlds=16)
    for row in lissajous_env.evaluate(policy, options.scenario, seeds=range(16)):
        print(
            *(f"{name} {row[name]:.3g}" for name in ("seed", "observed_fraction", "detection_time_mean", "collisions"))
        )


if __name__ == "__main__":
    main()
