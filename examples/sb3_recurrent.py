"""Train robots with a memory: RecurrentPPO of sb3-contrib, whose networks contain an LSTM, and evaluate them.

    python examples/sb3_recurrent.py --scenario watch --steps 2000000 --out runs/recurrent.zip

All robots share one network, and each has its own memory, which `training.sb3.ModelPolicy` preserves from step to step.
"""

import argparse

from sb3_contrib import RecurrentPPO

import lissajous_env
from training.sb3 import ModelPolicy, RobotVecEnv


def train(scenario: str, steps: int, worlds: int = 32, horizon: int = 50) -> RecurrentPPO:
    """Return a model that was trained for so many robot steps, in rollouts of `horizon` steps of each world."""
    env = RobotVecEnv(scenario, worlds, seed=0)
    model = RecurrentPPO(
        "MlpLstmPolicy", env, n_steps=horizon, batch_size=env.num_envs * horizon // 4, n_epochs=4, gamma=0.99,
        learning_rate=3e-4, policy_kwargs={"lstm_hidden_size": 64, "enable_critic_lstm": False, "shared_lstm": True},
        device="cpu", seed=0,
    )  # fmt: skip
    return model.learn(steps)


def main() -> None:
    """Train, store the model, and print the scores of sixteen episodes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="watch")
    parser.add_argument("--steps", type=int, default=2_000_000)
    parser.add_argument("--out", default="recurrent.zip")
    options = parser.parse_args()
    model = train(options.scenario, options.steps)
    model.save(options.out)
    print(f"wrote {options.out}")
    policy = ModelPolicy(model, options.scenario, num_worlds=16)
    for row in lissajous_env.evaluate(policy, options.scenario, seeds=range(16)):
        print(
            *(f"{name} {row[name]:.3g}" for name in ("seed", "observed_fraction", "detection_time_mean", "collisions"))
        )


if __name__ == "__main__":
    main()
