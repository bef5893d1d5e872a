"""State of a training with RLlib: plain arrays equivalent to RLlib's own checkpoint, without pickles."""

import dataclasses
import shutil

import numpy as np
import pytest

ray = pytest.importorskip("ray")
pytest.importorskip("ray.rllib")

import tree  # noqa: E402
from test_rllib import QUIET, ROWS, counted, settings  # noqa: E402

import lissajous_env  # noqa: E402
from baselines.benchmark import cluster  # noqa: E402
from tests.adversarial.planted import opened, payloads, plant, plant_rllib  # noqa: E402
from training.learned import checkpoint  # noqa: E402
from training.learned.card import Card  # noqa: E402
from training.rllib import ppo, state  # noqa: E402
from training.rllib.trainer import train  # noqa: E402
from training.trainer import Trainer  # noqa: E402


@pytest.fixture(scope="module", autouse=True)
def _one_cluster():
    with cluster.connected(None):
        yield


def test_a_training_goes_on_from_data_alone(tmp_path):
    # Story: a stranger's folder contains a pickle in place of each file, and of each that RLlib's own checkpoints have,
    # with its SHA-256 beside it. What the training needs is refused by name, the rest is not looked at.
    made, marker = (
        settings(tmp_path / "run", steps=ROWS, workers=1, worlds=4, evaluation_episodes=1),
        tmp_path / "opened",
    )
    train(made, QUIET)
    assert not list(made.out.rglob("*.pkl"))
    more, forms = dataclasses.replace(made, steps=ROWS), payloads(marker)
    files = checkpoint.read_text(made.out)["files"].values()
    needed = [made.out / name for name in (checkpoint.FILE, *(entry["name"] for entry in files))]
    assert len(needed) == 3
    for path in needed:
        for data in (forms["plain"], forms["archive"]):
            attacked = dataclasses.replace(more, out=tmp_path / "copy")
            shutil.copytree(made.out, attacked.out)
            plant(attacked.out / path.name, data)
            with pytest.raises(ValueError, match=r"damaged|decode"):
                train(attacked, QUIET)
            shutil.rmtree(attacked.out)
    for path in [path for path in made.out.rglob("[!.]*") if path.is_file() and path not in needed]:
        plant(path, forms["plain"])
    course = {"steps": ROWS // 2, "updates": 1, "seconds": 1.0, "curve": [], "rivals": {}}
    plant_rllib(made.out, forms["plain"], {"settings": made.to_dict(), "course": course})
    train(more, QUIET)
    assert counted(made.out)[0] == ROWS
    assert not opened(marker)


@pytest.fixture(scope="module")
def make(tmp_path_factory):
    """Makes RLlib's PPO in place of the one before, as a training that has trained some iterations does."""
    out = tmp_path_factory.mktemp("out")
    held = checkpoint.hold(out)
    trainer = Trainer(settings(out, workers=1, worlds=4), QUIET, held)
    algorithms = []

    def in_its_place(iterations=0):
        while algorithms:
            algorithms.pop().stop()
        algorithms.append(ppo.make_ppo(trainer.settings, trainer.scenario, trainer.card, None, iterations))
        return algorithms[0]

    yield in_its_place
    held.close()
    while algorithms:
        algorithms.pop().stop()


def learner_of(algorithm):
    """All that RLlib's learner continues from, flat; the metrics and the count of what was sent to workers left out."""
    state = algorithm.learner_group.get_state()["learner"]
    flat = tree.flatten_with_path([state["rl_module"], state["optimizer"]])
    return {".".join(map(str, path)): np.asarray(value) for path, value in flat if value is not None}


def trained(algorithm, iterations):
    """Iterations, steps of a world, and the learning rate that comes next."""
    rates = [algorithm.train()["learners"][ppo.MODULE]["default_optimizer_learning_rate"] for _ in range(iterations)]
    return algorithm.iteration, state.steps_sampled(algorithm), rates


@pytest.mark.long
def test_what_was_saved_goes_on_as_rllibs_own_checkpoint_does(make, tmp_path):
    # Oracle: RLlib's checkpoint, pickles and all: the same weights and moments to the bit, then equal counters and
    # learning rates. Weights cannot be compared later: RLlib draws its actions anew each time.
    algorithm = make()
    trained(algorithm, 3)
    network, card = ppo.policy_of(algorithm, "relu"), Card.of(lissajous_env.scenario("failure"))
    checkpoint.save(tmp_path / "ours", network, card, state=state.save_ppo(algorithm))
    saved = checkpoint.read_state(tmp_path / "ours", checkpoint.read(tmp_path / "ours")[2])
    algorithm.save_to_path(tmp_path / "rllib")

    algorithm = make(3)
    fresh = learner_of(algorithm)
    algorithm.restore_from_path(tmp_path / "rllib")
    restored = learner_of(algorithm)
    theirs = trained(algorithm, 2)

    algorithm = make(3)
    state.load_ppo(algorithm, saved, 3)
    loaded = learner_of(algorithm)
    (worker,) = algorithm.env_runner_group.foreach_env_runner(lambda each: each.get_state(), local_env_runner=False)
    ours = trained(algorithm, 2)

    assert loaded.keys() == restored.keys()
    for name, array in restored.items():
        assert array.dtype.kind == loaded[name].dtype.kind
        assert array.tobytes() == loaded[name].astype(array.dtype).tobytes(), name
    assert sum(not np.array_equal(array, fresh.get(name)) for name, array in loaded.items()) > 4 * 13
    for name, array in worker["rl_module"][ppo.MODULE].items():
        assert (array == saved[f"model.{name}"]).all()
    assert ours == theirs
    assert ours[:2] == (5, 5 * 4 * 8)
    assert ours[2][0] > ours[2][1]


@pytest.fixture(scope="module")
def an_algorithm(make):
    return make()


@pytest.mark.parametrize(
    ("name", "array", "words"),
    [
        ("model.log_std", None, "state must contain model.log_std"),
        ("model.value.0.weight", np.zeros((3, 4), np.float32), r"model.value.0.weight must be .* shape \(16, 42\)"),
        ("optimizer.policy.0.bias.exp_avg", np.full(16, np.nan, np.float32), "exp_avg must be finite"),
        ("counter.steps_sampled", np.zeros(2), "counter.steps_sampled must be"),
    ],
)
def test_a_state_of_something_else_is_refused_by_name(an_algorithm, name, array, words):
    arrays = state.save_ppo(an_algorithm)
    if array is None:
        del arrays[name]
    else:
        arrays[name] = array
    with pytest.raises(ValueError, match=words):
        state.load_ppo(an_algorithm, arrays, 3)
