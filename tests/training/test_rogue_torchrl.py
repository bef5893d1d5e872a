"""TorchRL and BenchMARL with two groups: TorchRL's own checks, the simulation as oracle, and short trainings."""

import pytest

torch = pytest.importorskip("torch")
pytest.importorskip("benchmarl")

from benchmarl_mappo import Settings, experiment  # noqa: E402
from torchrl.envs.utils import check_env_specs  # noqa: E402

from training.torchrl import LissajousTorchEnv  # noqa: E402

FEW = {"targets.count": 3, "targets.arrival_rate": 0.0, "targets.entry": "unseen", "sensing.radius": 0.4}
SHORT = FEW | {"task.duration": 2.0}


@pytest.mark.parametrize("discrete", [False, True])
def test_torchrls_checks_pass(discrete):
    # Oracle: TorchRL's contract checker.
    env = LissajousTorchEnv("experiment", 2, rogues="agents", seed=0, discrete_actions=discrete, state=True, **SHORT)
    check_env_specs(env)
    assert env.group_map.keys() == {"robot", "rogue"}


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

    first = {group: parameters(group) for group in ("robot", "rogue")}
    run.run()
    torch.set_num_threads(before)
    for group, start in first.items():
        assert torch.isfinite(parameters(group)).all()
        assert not torch.equal(start, parameters(group))
