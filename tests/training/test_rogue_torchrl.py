"""TorchRL and BenchMARL with two groups: TorchRL's own checks, the simulation as oracle, and short trainings."""

import numpy as np
import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("benchmarl")

from benchmarl_mappo import Settings, experiment  # noqa: E402
from torchrl.envs.utils import check_env_specs  # noqa: E402

import lissajous_env  # noqa: E402
from training.torchrl import LissajousTorchEnv, TwoSidedTorchEnv  # noqa: E402

FEW = {"targets.count": 3, "targets.arrival_rate": 0.0, "targets.entry": "unseen", "sensing.radius": 0.4}
SHORT = FEW | {"task.duration": 2.0}


@pytest.mark.parametrize("discrete", [False, True])
def test_torchrls_checks_pass(discrete):
    # Oracle: TorchRL's contract checker.
    env = TwoSidedTorchEnv("experiment", 2, seed=0, discrete_actions=discrete, state=True, **SHORT)
    check_env_specs(env)
    assert env.group_map.keys() == {"adversary", "agent"}


def test_a_rollout_is_that_of_the_simulation():
    # Oracle: the simulation, stepped by hand with the same actions.
    env = TwoSidedTorchEnv("experiment", 2, seed=3, **SHORT)
    data = env.rollout(20, break_when_any_done=False)
    simulation = lissajous_env.Simulation("experiment", 2, seed=3, rogues="agents", **SHORT)
    for step in range(20):
        now = data[:, step]
        assert np.array_equal(now["agent", "observation"].numpy(), simulation.rogue_observation.numpy())
        simulation.step(now["adversary", "action"], now["agent", "action"])
        after = now["next"]
        assert np.array_equal(after["adversary", "observation"].numpy(), simulation.observation.numpy())
        assert np.array_equal(after["agent", "reward"][..., 0].numpy(), simulation.rogue_reward.numpy())
        assert np.array_equal(after["agent", "terminated"][..., 0].numpy(), simulation.rogue_terminated.numpy())
        assert np.array_equal(after["agent", "info", "present"][..., 0].numpy(), simulation.rogue_present.numpy())
    assert env.group_map == {"adversary": [f"robot_{i}" for i in range(5)], "agent": [f"rogue_{t}" for t in range(3)]}


def test_bad_input_is_refused_by_name():
    # Story: one group has no place for rogues, two need them; a NaN is refused with agent and world.
    with pytest.raises(ValueError, match=r"targets.rogues must be None or a scripted rogue"):
        LissajousTorchEnv("experiment", rogues="agents")
    with pytest.raises(ValueError, match=r"targets.rogues must be agents, got flee"):
        TwoSidedTorchEnv("experiment", rogues="flee")
    env = TwoSidedTorchEnv("experiment", 2, seed=0, **SHORT)
    data = env.rand_action(env.reset())
    data["agent", "action"][1, 2] = torch.nan
    with pytest.raises(ValueError, match="action of rogue_2 in world 1 must be finite"):
        env.step(data)


@pytest.mark.filterwarnings("ignore:SyncDataCollector has been deprecated.*:DeprecationWarning")
@pytest.mark.parametrize("algorithm", ["mappo", "ippo", "qmix"])
def test_benchmarl_trains_both_groups(algorithm, tmp_path):
    # Oracle: the parameters of both groups change and stay finite.
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    overrides = {**SHORT, "rogues": "agents"}
    run = experiment(Settings("experiment", algorithm, 2, worlds=4, out=tmp_path, overrides=overrides))

    def parameters(group):
        return torch.cat([p.detach().flatten().clone() for p in run.losses[group].parameters() if p.requires_grad])

    first = {group: parameters(group) for group in ("adversary", "agent")}
    run.run()
    torch.set_num_threads(before)
    for group, start in first.items():
        assert torch.isfinite(parameters(group)).all()
        assert not torch.equal(start, parameters(group))
