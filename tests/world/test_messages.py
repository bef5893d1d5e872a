"""Messages that policies send: who hears what and when, and that nothing else changes."""

import numpy as np
import pytest

import lissajous_env
from lissajous_env.envs.sides import action_table
from lissajous_env.world.observation import layout, message_start

QUIET = {"targets.count": 4, "targets.arrival_rate": 0.0, "task.grid": None, "task.duration": 8.0}
LOSSY = {"noise.message_loss": 0.4, "noise.message_delay": 0.2}


def speaking(name="failure", k=2, **overrides):
    return lissajous_env.scenario(name, **{**QUIET, "messages.size": k, **overrides})


def draws(simulation, steps, seed=0, most=1.0):
    """Actions (steps, W, N, A), of which a tenth beyond the range if `most` is 1.1."""
    draw = np.random.default_rng(seed)
    return draw.uniform(-most, most, (steps, *simulation.action_shape)).astype(np.float32)


def heard(simulation):
    """Messages (W, N, 2, k) in the rows of a simulation, by the names of the entries."""
    names, rows = simulation.layout.names, simulation.observation.numpy()
    k = simulation.scenario.messages.size
    places = [[names.index(f"neighbour_{side}_message_{m}") for m in range(k)] for side in range(2)]
    return rows[:, :, places].copy()


def entry(simulation, name):
    return simulation.observation.numpy()[..., simulation.layout.names.index(name)].copy()


class Ring:
    """The ring in NumPy: messages of one step, of which each robot hears those of its two neighbours.

    It goes by the documentation alone. Which messages are lost it takes from the age of the phase messages, with which
    they come.
    """

    def __init__(self, simulation):
        self.simulation, scenario = simulation, simulation.scenario
        w, n, k = simulation.num_worlds, simulation.num_robots, scenario.messages.size
        self.ring, self.late = scenario.ring, round(scenario.noise.message_delay / scenario.task.step)
        self.sent, self.last = [np.zeros((w, n, k), dtype=np.float32)], np.zeros((w, n, 2, k), dtype=np.float32)
        self._hear()

    def step(self, action):
        """Send what an action says: the last k numbers, limited to [-1, 1]."""
        gone = self.simulation.terminated.numpy().copy()
        self.simulation.step(action)
        works, there = self._works()
        works |= self.simulation.terminated.numpy() & ~gone  # it spoke in the step of its collision
        said = np.clip(action[..., action.shape[-1] - self.sent[0].shape[-1] :], -1, 1)
        self.sent.append(np.where(works[..., None], said, np.where(there[..., None], self.sent[-1], 0)))
        self._hear()

    def _works(self):
        status = self.simulation.robots.status.numpy()
        return status == 0, status != 2

    def _hear(self):
        _, there = self._works()
        for place, i in enumerate(self.ring):
            for side, j in ((0, self.ring[place - 1]), (1, self.ring[(place + 1) % len(self.ring)])):
                age = entry(self.simulation, f"neighbour_{side}_age")[:, i]
                new = entry(self.simulation, f"neighbour_{side}_heard")[:, i] == 1
                new &= np.isclose(age * self.simulation.scenario.time_unit, self.late * 0.1, atol=0.01)
                if len(self.sent) > self.late:
                    self.last[new, i, side] = self.sent[len(self.sent) - 1 - self.late][new, j]
        self.expected = np.where(there[..., None, None], self.last, 0)


@pytest.mark.parametrize(("robots", "targets", "k"), [(2, 4, 3), (0, 0, 1)])
def test_the_layout_is_the_one_that_is_promised(robots, targets, k):
    # Oracle: names, places and ranges by hand; the entries before them are those without messages.
    counts = {"sensing.robots_seen": robots, "sensing.targets_seen": targets}
    without, with_messages = layout(speaking(k=0, **counts)), layout(speaking(k=k, **counts))
    promised = [f"neighbour_{side}_message_{m}" for side in range(2) for m in range(k)]
    assert with_messages.names == (*without.names, *promised)
    assert message_start(speaking(k=k, **counts)) == len(without.names)
    assert (with_messages.low[without.size :] == -1).all()
    assert (with_messages.high[without.size :] == 1).all()
    extended = layout(speaking(k=k, extensions=[lissajous_env.observation_entry(size=2)(noughts)], **counts))
    assert extended.names == (*with_messages.names, "noughts_0", "noughts_1"), "those of extensions stay the last"


def noughts(world):
    """Zeros."""
    return np.zeros((*world.robots.status.shape, 2))


@pytest.mark.parametrize(
    ("name", "overrides"),
    [
        ("failure", {**LOSSY, "faults.rate": 0.3, "faults.mean_duration": 0.5, "faults.lost": 2}),
        ("experiment", {"task.on_collision": "remove", "robot.radius": 0.1, "noise.message_delay": 0.3}),
        ("failure", {"robot.count": 7, "formation.p": 3, "noise.message_delay": 0.7}),
    ],
)
def test_the_ring_in_numpy_hears_the_same(name, overrides):
    # Oracle: `Ring`, bit for bit; that anything was lost, repeated or silenced is asserted of it.
    simulation = lissajous_env.Simulation(speaking(name, 2, **overrides), 6, seed=3)
    ring = Ring(simulation)
    stale = 0
    for action in draws(simulation, 60, seed=4, most=1.1):
        before = ring.expected.copy()
        ring.step(action)
        np.testing.assert_array_equal(heard(simulation), ring.expected)
        stale += (before == ring.expected).all(axis=-1).sum()
    assert ring.expected.any()
    assert stale > 0
    if "faults.rate" in overrides:
        assert (simulation.robots.status.numpy() == 2).any()


@pytest.mark.parametrize("name", ["rough"])
def test_messages_change_nothing_else(name):
    # Oracle: the same scenario without them, bit for bit: entries, reward and every column of the score.
    overrides = {"noise.actuator": 0.2, "task.reward_effort": -0.3, "task.duration": 4.0}
    plain = lissajous_env.Simulation(lissajous_env.scenario(name, **overrides), 3, seed=5)
    spoken = lissajous_env.Simulation(lissajous_env.scenario(name, **overrides, **{"messages.size": 5}), 3, seed=5)
    size, moving = plain.layout.size, plain.action_shape[2]
    for action in draws(spoken, 40, most=1.1):
        plain.step(np.ascontiguousarray(action[..., :moving]))
        spoken.step(action)
        assert spoken.observation.numpy()[..., :size].tobytes() == plain.observation.numpy().tobytes()
        assert spoken.reward_terms.numpy().tobytes() == plain.reward_terms.numpy().tobytes()
    assert str(spoken.score()) == str(plain.score())
    own = {"messages.sending", "messages.sent", "messages.heard"}
    assert spoken.save_state().keys() - plain.save_state().keys() == own


def test_a_message_that_is_not_finite_zeroes_the_whole_action_and_flags_its_world():
    simulation = lissajous_env.Simulation(speaking(k=2, **{"faults.schedule": ()}), 2, seed=1)
    action = np.full(simulation.action_shape, 0.5, dtype=np.float32)
    action[1, 3, 2] = np.nan
    before = simulation.robots.position.numpy().copy()
    simulation.step(action)
    assert simulation.invalid.numpy().tolist() == [0, 1]
    moved = np.abs(simulation.robots.position.numpy() - before).max(axis=-1) > 0
    assert moved.tolist() == [[True] * 5, [True, True, True, False, True]]
    silent = heard(simulation)[1][simulation.scenario.neighbours == 3]
    assert (silent == 0).all()
    assert np.isfinite(simulation.observation.numpy()).all()


def test_the_table_of_discrete_actions_has_one_word_or_none():
    # Oracle: by hand, as MPE's communication: silence or one of k words, for each motion.
    moves, table = action_table(speaking("rough", 0)), action_table(speaking("rough", 2))
    assert table.shape == (3 * len(moves), 4)
    np.testing.assert_array_equal(table[:, :2], np.concatenate([moves] * 3))
    said = np.repeat([[0, 0], [1, 0], [0, 1]], len(moves), axis=0)
    np.testing.assert_array_equal(table[:, 2:], said)


# Scenarios.
