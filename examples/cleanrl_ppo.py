"""Train a team with PPO in one file in the manner of CleanRL: collect, bootstrap, update, print.

    python examples/cleanrl_ppo.py --scenario watch --steps 2000000

A row of the vector environment is a robot, and all robots share the networks. A time limit is no terminal state: the
last reward of a truncated episode is increased by the value of its last row, which `final_obs` contains.
"""

import argparse

import numpy as np
import torch
from torch import nn
from torch.distributions import Normal

import lissajous_env

GAMMA, LAMBDA, CLIP, ENTROPY, EPOCHS, MINIBATCHES = 0.99, 0.95, 0.2, 0.001, 4, 4


class Agent(nn.Module):
    """Actor and critic with two layers each, and a standard deviation for each component of an action."""

    def __init__(self, inputs: int, outputs: int, width: int = 64):
        super().__init__()
        self.actor, self.critic = (
            nn.Sequential(nn.Linear(inputs, width), nn.Tanh(), nn.Linear(width, width), nn.Tanh(), nn.Linear(width, n))
            for n in (outputs, 1)
        )
        self.log_deviation = nn.Parameter(torch.full((outputs,), -0.5))

    def value(self, rows: torch.Tensor) -> torch.Tensor:
        """Return the value (B,) of rows (B, D)."""
        return self.critic(rows)[:, 0]

    def distribution(self, rows: torch.Tensor) -> Normal:
        """Return the distribution of the actions (B, A) for rows (B, D)."""
        return Normal(self.actor(rows), self.log_deviation.exp())

    def act(self, observation: np.ndarray) -> np.ndarray:
        """Return the most likely actions (W, N, A) for observations (W, N, D): a policy that can be evaluated."""
        with torch.no_grad():
            return self.actor(torch.from_numpy(observation)).clamp(-1, 1).numpy()


def advantages(rewards: torch.Tensor, values: torch.Tensor, dones: torch.Tensor, last: torch.Tensor) -> torch.Tensor:
    """Return the generalised advantages (T, B); `last` (B,) are the values of the rows after the rollout."""
    result, ahead = torch.zeros_like(rewards), torch.zeros_like(last)
    for t in reversed(range(len(rewards))):
        goes_on = 1 - dones[t]
        following = values[t + 1] if t + 1 < len(rewards) else last
        ahead = rewards[t] + GAMMA * following * goes_on - values[t] + GAMMA * LAMBDA * goes_on * ahead
        result[t] = ahead
    return result


def update(agent: Agent, optimizer: torch.optim.Optimizer, data: list[torch.Tensor]) -> None:
    """Update by PPO's clipped objective with rows, actions, log-probabilities, advantages and returns (B, ...)."""
    for _ in range(EPOCHS):
        for chosen in torch.randperm(len(data[0])).chunk(MINIBATCHES):
            rows, actions, log_probability, advantage, returns = (column[chosen] for column in data)
            advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
            distribution = agent.distribution(rows)
            ratio = (distribution.log_prob(actions).sum(-1) - log_probability).exp()
            gain = torch.min(ratio * advantage, ratio.clamp(1 - CLIP, 1 + CLIP) * advantage).mean()
            loss = 0.5 * (agent.value(rows) - returns).square().mean() - gain
            loss = loss - ENTROPY * distribution.entropy().sum(-1).mean()
            optimizer.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(agent.parameters(), 0.5)
            optimizer.step()


def train(scenario: str, steps: int, worlds: int = 32, horizon: int = 50, seed: int = 0) -> Agent:
    """Return an agent that was trained for so many robot steps, in rollouts of `horizon` steps of each world."""
    torch.manual_seed(seed)
    envs = lissajous_env.vector_env(scenario, worlds, agents_as_rows=True, autoreset_mode="SAME_STEP")
    count, (inputs,), (outputs,) = envs.num_envs, envs.single_observation_space.shape, envs.single_action_space.shape
    agent = Agent(inputs, outputs)
    optimizer = torch.optim.Adam(agent.parameters(), lr=3e-4, eps=1e-5)
    rows = torch.empty(horizon, count, inputs)
    actions = torch.empty(horizon, count, outputs)
    rewards, dones, values, log_probabilities = torch.empty(4, horizon, count)
    observation = torch.from_numpy(envs.reset(seed=seed)[0])
    for done in range(0, steps, count * horizon):
        for t in range(horizon):
            rows[t] = observation
            with torch.no_grad():
                distribution = agent.distribution(observation)
                actions[t], values[t] = distribution.sample(), agent.value(observation)
                log_probabilities[t] = distribution.log_prob(actions[t]).sum(-1)
            following, reward, terminated, truncated, infos = envs.step(actions[t].clamp(-1, 1).numpy())
            if truncated.any():
                ends = torch.from_numpy(np.stack(infos["final_obs"][truncated]))
                with torch.no_grad():
                    reward[truncated] += GAMMA * agent.value(ends).numpy()
            rewards[t], dones[t] = torch.from_numpy(reward), torch.from_numpy(terminated | truncated).float()
            observation = torch.from_numpy(following)
        with torch.no_grad():
            advantage = advantages(rewards, values, dones, agent.value(observation))
        data = rows, actions, log_probabilities, advantage, advantage + values
        update(agent, optimizer, [column.flatten(0, 1) for column in data])
        print(f"{done + count * horizon} robot steps, mean reward {rewards.mean():.4f}", flush=True)
    return agent


def main() -> None:
    """Train, and print the scores of sixteen episodes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="watch")
    parser.add_argument("--steps", type=int, default=2_000_000)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    agent = train(options.scenario, options.steps, seed=options.seed)
    for row in lissajous_env.evaluate(agent.act, options.scenario, seeds=range(16)):
        print(
            *(f"{name} {row[name]:.3g}" for name in ("seed", "observed_fraction", "detection_time_mean", "collisions"))
        )


if __name__ == "__main__":
    main()
