"""Scenario spaces: draws, splits, shifts, rules, files and names."""

import itertools
import pickle

import numpy as np
import pytest

import lissajous_env
from baselines.commands.playing import split_scenarios_and_policy
from lissajous_env import ScenarioSpace, register_scenario, scenario, scenario_space
from lissajous_env.identity import digest_of
from lissajous_env.parameters.named import expanded
from lissajous_env.parameters.scenario_file import UnknownSettingError
from lissajous_env.parameters.space import SPLITS
from lissajous_env.settings.formulas import Formula

DRAW = {
    "curve": {"choices": [{"a": 3, "b": 2}, {"a": 5, "b": 2}], "half_height": "log_uniform(0.8, 3.2)"},
    "sensing": {"radius": "uniform(0.5, 1.0) * curve.half_height"},
}

FROZEN = {
    "monitoring-v1": "c70de5a81797be2b",
    "watch-v1": "b90560cde1a01486",
    "intercept-v1": "03bc4fce20bc33b5",
    "hotspots-v1": "a9bd7c2dc9081d09",
}
"""Digest of the first scenarios of each split and shift of the included spaces."""

TOML = """
base = "experiment"
require = ["sensing_radius < 0.9 * curve.half_height"]
[draw.curve]
half_height = "uniform(0.8, 1.2)"
[draw.sensing]
radius = "uniform(0.5, 1.0) * curve.half_height"
[shift.wide.curve]
half_width = 4.0
"""


def space(name="space", draw=DRAW, **changes):
    return ScenarioSpace(name, scenario("experiment"), draw, **changes)


def first(space, split, count):
    return list(itertools.islice(space.scenarios(split), count))


def test_a_seed_gives_the_same_scenario_always_and_other_seeds_others():
    samples = [space().sample(seed) for seed in range(50)]
    assert samples == [pickle.loads(pickle.dumps(space())).sample(seed) for seed in range(50)]
    assert len({sample.digest() for sample in samples}) == 50
    assert samples[7].name == "space-7"


def test_values_are_in_their_ranges_and_spread_over_them():
    samples = [space().sample(seed) for seed in range(200)]
    heights = np.array([sample.curve.half_height for sample in samples])
    shares = np.array([sample.sensing.radius for sample in samples]) / heights
    assert 0.8 <= heights.min() <= heights.max() <= 3.2
    assert 0.5 <= shares.min() <= shares.max() <= 1.0
    assert abs((heights < 1.6).mean() - 0.5) < 0.08  # the middle of the logarithms
    assert abs((shares < 0.75).mean() - 0.5) < 0.08
    assert abs(np.mean([sample.curve.a == 5 for sample in samples]) - 0.5) < 0.08
    assert abs(np.corrcoef(heights, shares)[0, 1]) < 0.15


def test_a_draw_that_is_added_changes_no_other_value():
    more = {**DRAW, "targets": {"count": "whole(1, 9)"}}
    for seed in range(20):
        sample = space(draw=more).sample(seed)
        assert 1 <= sample.targets.count <= 9
        assert sample.curve == space().sample(seed).curve


def test_splits_share_no_scenario_and_have_their_shares():
    sample_space = space()
    seeds = {split: set(itertools.takewhile(lambda seed: seed < 2000, sample_space.seeds(split))) for split in SPLITS}
    assert sum(map(len, seeds.values())) == len(set.union(*seeds.values())) == 2000
    for split, share in SPLITS.items():
        assert abs(len(seeds[split]) / 2000 - share) < 0.03
        assert all(sample_space.split_of(seed) == split for seed in seeds[split])


def test_weights_and_whole_numbers():
    draw = {
        "task": {"choices": [{"substeps": 1}, {"substeps": 2}, {"substeps": 3}], "weights": [3, 0, 1]},
        "targets": {"count": "whole(2, 4)", "entry": "choice('inside', 'boundary')"},
    }
    samples = [space(draw=draw).sample(seed) for seed in range(400)]
    assert abs(np.mean([sample.task.substeps == 1 for sample in samples]) - 0.75) < 0.08
    assert {sample.task.substeps for sample in samples} == {1, 3}
    counts = [sample.targets.count for sample in samples]
    assert abs(np.mean([sample.targets.entry == "inside" for sample in samples]) - 0.5) < 0.08
    assert {k: counts.count(k) > 90 for k in counts} == {2: True, 3: True, 4: True}


def test_rules_hold_and_impossible_ones_are_named():
    sample_space = space(require=("sensing_radius < 0.7 * curve.half_height",))
    assert all(sample.sensing_radius < 0.7 * sample.curve.half_height for sample in first(sample_space, "train", 50))
    with pytest.raises(ValueError, match=r"require must be met .* seed 0 of space, .*: sensing_radius < 0\.1"):
        space(require=("sensing_radius < 0.1",))
    with pytest.raises(ValueError, match="require must be a list of formulas, got 'sensing_radius < 9'"):
        space(require="sensing_radius < 9")


def test_a_draw_of_a_hash_that_rounds_to_1_is_the_last_one(monkeypatch):
    monkeypatch.setattr(lissajous_env.parameters.space, "_hashed", lambda text: 2**64 - 1)
    sample = space(draw={**DRAW, "targets": {"count": "whole(1, 9)", "entry": "choice('inside', 'unseen')"}}).sample(0)
    assert (sample.curve.a, sample.targets.count, sample.targets.entry) == (5, 9, "unseen")


def test_a_scale_scales_the_whole_scenario():
    plain = space().sample(3)
    scaled = space(draw={**DRAW, "scale": {"length": 4.0, "time": 0.5}}).sample(3)
    assert scaled == ScenarioSpace.sample(space(), 3).scaled(4.0, 0.5)
    assert scaled.curve.half_height == 4 * plain.curve.half_height


def test_a_given_field_is_not_drawn_and_changes_no_other_field():
    # Oracle: the space itself; a scaled scenario has the field in its own units.
    space = scenario_space("monitoring-v1")
    fixed = space.overridden({"targets.arrival_rate": 2 * space.base.targets.arrival_rate})
    for seed in range(5):
        before, after = space.sample(seed), fixed.sample(seed)
        assert after.targets.arrival_rate == pytest.approx(2 * before.targets.arrival_rate)
        assert scenario(after, **{"targets.arrival_rate": before.targets.arrival_rate}) == before


@pytest.mark.parametrize(
    "overrides", [{"curve.a": 3, "curve.b": 2}, {"curve": {"a": 3, "b": 2}}, {"curve": scenario("evaders").curve}]
)
def test_a_field_is_given_by_any_name_and_for_shifts_too(overrides):
    # The shift `larger` draws a and b.
    space = scenario_space("monitoring-v1").overridden(overrides)
    for sample in (space.sample(3), space.shifted("larger").sample(3)):
        assert (sample.curve.a, sample.curve.b) == (3, 2)


def test_an_environment_takes_given_fields_as_a_training_does():
    # Both are before the scale, in the units of the space.
    given = scenario_space("monitoring-v1").overridden({"sensing.radius": 0.9})
    env = lissajous_env.parallel_env("monitoring-v1:test", **{"sensing.radius": 0.9})
    env.reset(seed=4)
    assert env.scenario.sensing.radius == given.sample(int(env.scenario.name.rpartition("-")[2])).sensing.radius
    for wrong in ({"sensing.radios": 0.9}, {"duration": 3.0}):
        with pytest.raises(UnknownSettingError):
            lissajous_env.parallel_env("monitoring-v1", **wrong)


def test_a_shift_changes_its_draws_alone():
    sample_space = space(shifts={"high": {"curve": {"half_height": "uniform(5.0, 6.0)"}}})
    with pytest.raises(ValueError, match="name of a shift must be text, and neither that of a split nor a number, got"):
        space(shifts={"7": {}})  # `space-7` is the scenario of seed 7
    samples = first(sample_space, "high", 20)
    assert [sample.name for sample in samples[:2]] == ["space-high-0", "space-high-1"]
    assert all(5 <= sample.curve.half_height <= 6 and sample.curve.a in (3, 5) for sample in samples)
    assert first(sample_space, "train", 5) == first(space(), "train", 5)


@pytest.mark.parametrize(
    ("draw", "words"),
    [
        ({"curves": {}}, r"draw must name one of .*did you mean curve\?"),
        ({"curve": {"half_hight": 1.0}}, r"curve.half_hight'.*did you mean curve.half_height\?"),
        ({"curve": {"half_height": "log_uniform(0.0, 1.0)"}}, "must have a value, got float division by zero"),
        ({"curve": {"half_height": "uniform(2, 1.5)"}}, "must have a value, got a range from 2 to 1.5"),
        ({"curve": {"half_height": "uniform(-2.0, -1.0)"}}, "seed 0 of space: curve.half_height must be from"),
        ({"curve": {"choices": []}}, "draw.curve.choices must be a list of at least one mapping"),
        ({"curve": {"choices": [1, 2]}}, r"of at least one mapping from fields to values, got \[1, 2\]"),
        ({"curve": {"choices": [{"a": 1}], "weights": [1, 2]}}, "draw.curve.weights must be 1 numbers"),
        ({"curve": {"weights": [1, 2]}}, r"draw.curve.weights must be given with choices, got \[1, 2\]"),
        ({"curve": {"half_height": "__import__('os')"}}, "formula must be an expression of .*, uniform, log_uniform"),
        ({"curve": {"half_height": "robot.nothing"}}, "robot.nothing, which is neither a field nor a variable"),
        ({"targets": {"count": "2 * num_robots"}}, "seed 0 of space: .*num_robots, which is neither a field nor a"),
        ({"targets": {"count": "whole(0.5, 3)"}}, "space: .*'float' object cannot be interpreted as an integer"),
        ({"curve": {"half_height": "uniform(1, 2) + uniform(1, 2)"}}, "draw.curve.half_height must call at most one"),
        ({"noise": {"speed": "noise.position", "position": "noise.speed"}}, "noise.speed, which depends on itself"),
        ({"curve": 3}, "draw.curve must be a mapping from fields to draws, got 3"),
        ({"scale": {"depth": 2.0}}, "draw.scale must contain length or time, got 'depth'"),
    ],
)  # fmt: skip
def test_an_invalid_draw_is_refused_by_name(draw, words):
    with pytest.raises(ValueError, match=words):
        space(draw=draw)


def test_the_order_of_the_draws_changes_nothing():
    draw = {
        "robot": {"wheelbase": "robot.radius + noise.heading", "radius": "uniform(0.05, 0.1)"},
        "noise": {"choices": [{"heading": 0.01}, {"speed": 0.2}], "position": "uniform(0.1, 0.2) * robot.radius"},
        "task": {"substeps": 3, "choices": [{"substeps": 1}], "duration": "10.0 * task.substeps"},
    }
    samples = [space(draw=draw).sample(seed) for seed in range(20)]
    assert {(sample.task.substeps, sample.task.duration) for sample in samples} == {(3, 30.0)}
    turned = {part: dict(reversed(fields.items())) for part, fields in reversed(draw.items())}
    assert samples == [space(draw=turned).sample(seed) for seed in range(20)]
    assert {round(sample.robot.wheelbase - sample.robot.radius, 9) for sample in samples} == {0.0, 0.01}


@pytest.mark.parametrize("seed", [-1, 2**31, 0.5, "3", True])
def test_an_invalid_seed_is_refused(seed):
    with pytest.raises(ValueError, match="seed must be a whole number from 0 to 2147483647"):
        space().sample(seed)


def test_a_space_in_a_file_and_the_names_of_its_scenarios(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text(TOML)
    sample_space = scenario_space("mine.toml")
    assert (sample_space.name, sample_space.shifts.keys()) == ("mine", {"wide"})
    assert scenario("mine.toml:12") == sample_space.sample(12)
    assert scenario("mine.toml:wide-12") == sample_space.shifted("wide").sample(12)
    names = expanded(["evaders", "mine.toml:test:3", "mine.toml:wide:2"])
    assert (names[0], *names[4:]) == ("evaders", "mine.toml:wide-0", "mine.toml:wide-1")
    assert [scenario(name) for name in names[1:4]] == first(sample_space, "test", 3)
    with pytest.raises(ValueError, match=r"must end in a number from 1 to 10000, got '0'"):
        expanded(["mine.toml:test:0"])
    with pytest.raises(ValueError, match=r"split must be one of .*did you mean test\?"):
        expanded(["mine.toml:tset"])
    with pytest.raises(ValueError, match=r"only commands that play several .*; got mine\.toml:test:3"):
        scenario("mine.toml:test:3")
    for part in ("mine.toml:test", "mine.toml:wide"):
        with pytest.raises(ValueError, match=f"accept SPACE:SPLIT.*one of its scenarios, as {expanded([part])[0]}$"):
            scenario(part)


def test_the_base_in_a_file_is_registered_and_no_other_file(tmp_path, monkeypatch):
    # Story: a space names itself as its base.
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text(TOML.replace("experiment", "mine.toml:0"))
    with pytest.raises(ValueError, match=r"mine.toml: base must be the name of a scenario.*, got 'mine.toml:0'"):
        scenario_space("mine.toml")


def test_a_registered_space_is_known_by_name():
    sample_space = register_scenario(space("of-mine"))
    assert scenario("of-mine-4") == sample_space.sample(4)
    assert "of-mine" in lissajous_env.scenario_spaces()
    assert register_scenario(space("of-mine-4")).sample(2) == scenario("of-mine-4-2")
    with pytest.raises(ValueError, match="name of a scenario must be new, got 'of-mine'"):
        register_scenario(space("of-mine", draw={}))
    with pytest.raises(ValueError, match=r"space must be one of .*did you mean of-mine\?"):
        scenario_space("of-min")


def test_a_command_takes_the_scenario_of_a_space_beside_a_policy():
    for name in ("monitoring-v1-17", "monitoring-v1-larger-3", "mine.toml:4", "mine.toml:wide-4"):
        assert split_scenarios_and_policy([name, "kuramoto-mpcc"]) == ((name,), "kuramoto-mpcc")
    with pytest.raises(ValueError, match="scenario must be one of"):
        scenario(split_scenarios_and_policy(["monitoring-v2-17", "kuramoto-mpcc"])[0][0])


def test_the_shipped_spaces_never_change():
    for name, digest in FROZEN.items():
        shipped = scenario_space(name)
        digests = [sample.digest() for split in (*SPLITS, *shipped.shifts) for sample in first(shipped, split, 1)]
        assert digest_of("".join(digests).encode()) == digest, name


@pytest.mark.parametrize(
    ("text", "value"),
    [("2 * x - 1", 5), ("-x / 2", -1.5), ("sqrt(x + 1)", 2), ("max(x, 7) <= 7", True), ("(round(2.6), x)", (3, 3))],
)
def test_formulas_compute(text, value):
    assert Formula(text)(lambda name: 3) == value


@pytest.mark.parametrize(
    "text", ["x ** 9", "x.__class__()", "lambda: 1", "1 if x else 2", "b'a'", "", "(" * 300, "open(x)", "{1}"]
)
def test_other_expressions_are_no_formulas(text):
    with pytest.raises(ValueError, match="formula must be an expression"):
        Formula(text)


def test_a_formula_that_has_no_value_says_which():
    with pytest.raises(ValueError, match=r"formula 'sqrt\(x\)' must have a value"):
        Formula("sqrt(x)")(lambda name: -1)
    with pytest.raises(ValueError, match="must have a value, got 'a', which is no number"):
        Formula("'a' * 10000000000")(lambda name: 0)
    assert Formula("x")(lambda name: np.inf) == np.inf
