"""Laws of every adapter: rows of the simulation, time limits, seeds, copies, padding, and refused actions.

An adapter here plays W worlds with arrays by side, `robot` or `rogue`: rows and actions (W, N, ...). A new library is
one more class. What is a library's own, its checker and a short training, is in the test file of that library.
"""

import copy
import pickle

import numpy as np
import pytest

import baselines
import lissajous_env
from lissajous_env import ScenarioSpace, Simulation

CARS = {"task.duration": 1.0}
MESSAGES = CARS | {"messages.size": 4}
ROGUES = {"targets.count": 3, "targets.arrival_rate": 0.0, "targets.entry": "unseen", "sensing.radius": 0.4} | CARS
SPACE = ScenarioSpace("small", lissajous_env.scenario("evaders"), {
    "curve": {"choices": [{"a": 1, "b": 2}, {"a": 3, "b": 2}], "half_height": "uniform(0.8, 1.0)"},
    "task": {"duration": "choice(0.5, 1.0)", "contamination": None},
})  # fmt: skip


class Dicts:
    """PettingZoo's parallel environment, and RLlib's: dicts of agents."""

    worlds, roles = 1, ("robots", "messages", "both", "space")

    def __init__(self, name, scenario, **settings):
        if name == "rllib":
            from training.rllib import LissajousMultiAgentEnv

            self.env = LissajousMultiAgentEnv({"scenario": scenario, **settings})
        else:
            self.env = lissajous_env.parallel_env(scenario, **settings)
        self.sizes = {agent: space.shape[0] for agent, space in self.env.observation_spaces.items()}

    def _arrays(self, values, size=lambda agent: ()):
        arrays = {}
        for agent in self.env.possible_agents:
            value = values.get(agent, np.zeros(size(agent), np.float32))
            arrays.setdefault(agent.partition("_")[0], []).append(value)
        return {side: np.array([rows]) for side, rows in arrays.items()}

    def reset(self, seed=None):
        return self._arrays(self.env.reset(seed=seed)[0], lambda agent: (self.sizes[agent],))

    def step(self, actions):
        chosen = {}
        for agent in self.env.agents:
            side, place = agent.split("_")
            chosen[agent] = actions[side][0, int(place)]
        observations, rewards, terminated, truncated, _ = self.env.step(chosen)
        rows = self._arrays(observations, lambda agent: (self.sizes[agent],))
        over = not self.env.agents
        late = over and any(truncated[a] and not terminated.get(a, False) for a in truncated)
        return rows, self._arrays(rewards), np.array([over and not late]), np.array([late])

    @property
    def scenario(self):
        return self.env.scenario


class Turns(Dicts):
    """PettingZoo's AEC environment: agents act in turn."""

    roles = ("robots", "messages", "both")

    def __init__(self, name, scenario, **settings):
        self.env = lissajous_env.env(scenario, **settings)
        self.sizes = {agent: self.env.observation_space(agent).shape[0] for agent in self.env.possible_agents}

    def reset(self, seed=None):
        self.env.reset(seed=seed)
        return self._arrays({a: self.env.observe(a) for a in self.env.agents}, lambda agent: (self.sizes[agent],))

    def step(self, actions):
        for _ in range(len(self.env.agents)):
            agent = self.env.agent_selection
            ended = self.env.terminations[agent] or self.env.truncations[agent]
            side, place = agent.split("_")
            self.env.step(None if ended else actions[side][0, int(place)])
        ends = [(self.env.terminations[a], self.env.truncations[a]) for a in self.env.agents]
        rows = {a: self.env.observe(a) for a in self.env.agents}
        late, gone = any(end[1] for end in ends), all(end[0] for end in ends)
        return (self._arrays(rows, lambda a: (self.sizes[a],)), self._arrays(self.env.rewards), np.array([gone]),
                np.array([late]))  # fmt: skip

    @property
    def scenario(self):
        return self.env.unwrapped.scenario


class Team:
    """Gymnasium's environment of one world, whose agent is a team."""

    worlds, roles = 1, ("robots", "messages", "rogues", "space")

    def __init__(self, name, scenario, **settings):
        self.env = lissajous_env.LissajousEnv(scenario, **settings)
        self.side = "rogue" if "robots" in settings else "robot"

    def reset(self, seed=None):
        return {self.side: self.env.reset(seed=seed)[0][None]}

    def step(self, actions):
        rows, _, terminated, truncated, info = self.env.step(actions[self.side][0])
        return ({self.side: rows[None]}, {self.side: info[f"{self.side}_reward"][None]}, np.array([terminated]),
                np.array([truncated]))  # fmt: skip

    @property
    def scenario(self):
        return self.env.scenario


class Vector:
    """Gymnasium's vector environment; a row is a team or, if `as_rows`, a robot."""

    worlds, roles = 2, ("robots", "messages")

    def __init__(self, name, scenario, **settings):
        self.as_rows = name == "vector rows"
        settings |= {"autoreset_mode": "DISABLED", "agents_as_rows": self.as_rows}
        self.env = lissajous_env.vector_env(scenario, 2, **settings)

    def reset(self, seed=None):
        return {"robot": self.env.reset(seed=seed)[0].reshape(2, self.env.scenario.num_robots, -1)}

    def step(self, actions):
        action = actions["robot"].reshape(self.env.action_space.shape)
        rows, reward, terminated, truncated, infos = self.env.step(action)
        rewards = reward.reshape(2, -1) if self.as_rows else infos["robot_reward"]
        ends = [flags.reshape(2, -1).all(axis=1) for flags in (terminated, truncated)]
        return {"robot": rows.reshape(2, self.env.scenario.num_robots, -1)}, {"robot": rewards}, *ends

    @property
    def scenario(self):
        return self.env.scenario


class Rows:
    """Stable-Baselines3: a row for each agent; the rows after an end are in the infos."""

    worlds, roles = 2, ("robots", "messages", "rogues")

    def __init__(self, name, scenario, **settings):
        pytest.importorskip("stable_baselines3")
        from training.sb3 import RobotVecEnv, RogueVecEnv

        self.side = "rogue" if "robots" in settings else "robot"
        self.env = (RogueVecEnv if "robots" in settings else RobotVecEnv)(scenario, 2, **settings)

    def reset(self, seed=None):
        n = self.env.num_envs // 2
        if seed is not None:
            self.env._seeds = [seed + k // n for k in range(2 * n)]
        return {self.side: self.env.reset().reshape(2, n, -1)}

    def step(self, actions):
        action = actions[self.side].reshape(self.env.num_envs, -1)
        rows, rewards, dones, infos = self.env.step(action)
        for k in np.flatnonzero(dones):
            rows[k] = infos[k]["terminal_observation"]
        late = np.array([info["TimeLimit.truncated"] for info in infos]).reshape(2, -1).any(axis=1)
        over = dones.reshape(2, -1).all(axis=1)
        return {self.side: rows.reshape(2, -1, rows.shape[1])}, {self.side: rewards.reshape(2, -1)}, over & ~late, late

    @property
    def scenario(self):
        return self.env.scenario


class Tensors:
    """TorchRL: a group for each side."""

    worlds, roles = 2, ("robots", "messages", "both", "space")

    def __init__(self, name, scenario, **settings):
        pytest.importorskip("torchrl")
        from training.torchrl import LissajousTorchEnv

        self.env = LissajousTorchEnv(scenario, 2, **settings)

    def reset(self, seed=None):
        if seed is not None:
            self.env.set_seed(seed)
        self.data = self.env.reset()
        return {side: self.data[side, "observation"].numpy() for side in self.env.group_map}

    def step(self, actions):
        import torch

        for side in self.env.group_map:
            self.data[side, "action"] = torch.as_tensor(actions[side])
        after = self.env.step(self.data)["next"]
        rows = {side: after[side, "observation"].numpy() for side in self.env.group_map}
        rewards = {side: after[side, "reward"][..., 0].numpy() for side in self.env.group_map}
        self.data = after
        return rows, rewards, after["terminated"].numpy().ravel(), after["truncated"].numpy().ravel()

    @property
    def scenario(self):
        return self.env.batch.scenario


ADAPTERS = {"parallel": Dicts, "rllib": Dicts, "aec": Turns, "gymnasium": Team, "vector": Vector, "vector rows": Vector,
            "sb3": Rows, "torchrl": Tensors}  # fmt: skip
SETTINGS = {"robots": CARS, "messages": MESSAGES, "rogues": ROGUES | {"robots": "still"},
            "both": ROGUES | {"rogues": "agents"}, "space": {}}  # fmt: skip
PLAYED = [(name, roles) for name, adapter in ADAPTERS.items() for roles in adapter.roles]


def make(name, roles="robots", **more):
    if name == "rllib":
        pytest.importorskip("ray")
    return ADAPTERS[name](name, SPACE if roles == "space" else "experiment", **SETTINGS[roles] | more)


def drawn(adapter, rows, draw):
    """Return random actions of all sides."""
    sizes = {"robot": adapter.scenario.action_size, "rogue": 2}
    return {side: draw.uniform(-1.2, 1.2, (*of.shape[:2], sizes[side])).astype(np.float32) for side, of in rows.items()}


@pytest.mark.parametrize(("name", "roles"), PLAYED, ids=str)
def test_rows_and_rewards_are_those_of_the_simulation_until_the_time_limit_which_is_no_termination(name, roles):
    # Oracle: the simulation with the same seeds and actions, bit for bit. Places without an agent are zero.
    adapter = make(name, roles)
    rows, draw = adapter.reset(seed=7), np.random.default_rng(0)
    scenario = adapter.scenario
    if roles == "space":
        episode = adapter.env.batch if name == "torchrl" else getattr(adapter.env, "inner", adapter.env).batch
        simulation = Simulation(scenario, adapter.worlds, seed=int(episode.simulation.score()[0]["seed"]))
    else:
        simulation = Simulation(scenario, adapter.worlds, seed=7)
    driver = baselines.make("still", scenario, adapter.worlds) if roles == "rogues" else None
    n, compared = scenario.num_robots, 0
    for step in range(1, scenario.task.steps + 1):
        for side, block in rows.items():
            own = simulation.observation.numpy() if side == "robot" else simulation.rogues.observation.numpy()
            live = np.ones(own.shape[:2], bool) if side == "robot" else simulation.rogues.present.numpy()
            assert (block[:, : own.shape[1]][live] == own[live]).all()
            assert not block[:, own.shape[1] :].any()
            compared += live.sum()
        actions = drawn(adapter, rows, draw)
        of_robots = driver.act(simulation.observation) if driver else np.clip(actions["robot"][:, :n], -1, 1)
        of_rogues = () if scenario.targets.rogues is None else (np.clip(actions["rogue"], -1, 1),)
        simulation.step(of_robots, *of_rogues)
        rows, rewards, terminated, truncated = adapter.step(actions)
        for side, block in rewards.items():
            own = simulation.reward.numpy() if side == "robot" else simulation.rogues.reward.numpy()
            assert (block[:, : own.shape[1]] == own).all()
        if terminated.any():
            assert roles == "rogues"  # all were detected
            break
        assert truncated.tolist() == [step == scenario.task.steps] * adapter.worlds
    assert compared > 0
    if roles == "messages":
        heard = [name.startswith("neighbour_") and "message" in name for name in simulation.layout.names]
        assert rows["robot"][..., heard].all()


@pytest.mark.parametrize(("name", "roles"), PLAYED, ids=str)
def test_a_seed_repeats_an_episode_and_without_one_episodes_differ(name, roles):
    first, again, other = make(name, roles), make(name, roles), make(name, roles)
    same = [adapter.reset(seed=3) for adapter in (first, again)]
    assert all((same[0][side] == same[1][side]).all() for side in same[0])
    for _ in range(2):
        changed = [adapter.reset() for adapter in (first, again)]
        assert all((changed[0][side] == changed[1][side]).all() for side in changed[0])
    unseeded = other.reset()
    if roles != "rogues":  # these enter unseen
        assert unseeded["robot"].tolist() != same[0]["robot"].tolist() != changed[0]["robot"].tolist()


@pytest.mark.parametrize(("name", "roles"), PLAYED, ids=str)
def test_a_copy_goes_on_bit_for_bit_and_returned_arrays_do_not_change(name, roles):
    # Oracle: the adapter that was pickled, before the first reset or in mid-episode, over the end of the episode.
    adapter, draw = make(name, roles), np.random.default_rng(0)
    adapter = pickle.loads(pickle.dumps(adapter))
    rows = adapter.reset(seed=4)
    for _ in range(3):
        rows, *_ = adapter.step(drawn(adapter, rows, draw))
    returned, before = rows, {side: block.copy() for side, block in rows.items()}
    copies = [pickle.loads(pickle.dumps(adapter)), copy.deepcopy(adapter)]
    over = np.array([False])
    while not over.all():
        actions = drawn(adapter, rows, draw)
        rows, *mine = adapter.step(actions)
        for of_copy, *its in [clone.step(actions) for clone in copies]:
            assert all((rows[side] == of_copy[side]).all() for side in rows)
            assert str(mine) == str(its)
        over = mine[1] | mine[2]
    assert all((returned[side] == before[side]).all() for side in before)
    begun = adapter.reset()
    for of_copy in [clone.reset() for clone in copies]:
        assert all((begun[side] == of_copy[side]).all() for side in begun)


@pytest.mark.parametrize("name", [name for name in ADAPTERS if not name.startswith("vector")])
@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_an_action_that_is_not_finite_is_refused_by_the_name_of_its_robot(name, wrong):
    adapter = make(name)
    rows = adapter.reset(seed=1)
    actions = drawn(adapter, rows, np.random.default_rng(0))
    actions["robot"][-1, 3, 0] = wrong
    with pytest.raises(ValueError, match=r"action of robot_3 .*must be finite, got"):
        adapter.step(actions)


@pytest.mark.parametrize("name", ["parallel", "gymnasium", "sb3", "torchrl"])
def test_rogues_that_do_not_fit_the_roles_are_refused(name):
    one_side, none = ("gymnasium", "sb3"), "targets.rogues must be None or a scripted rogue"
    for names, roles, fields, words in (
        (one_side, "robots", {"rogues": "agents"}, f"{none} if the robots alone"),
        (one_side, "rogues", {"rogues": "flee"}, "targets.rogues must be agents if the rogues are agents, got flee"),
        (one_side, "rogues", {"targets.count": 0}, "targets.count or targets.arrival_rate must be above 0 if the rog"),
        (("parallel", "gymnasium", "torchrl"), "space", {"rogues": "agents"}, f"{none} in an environment of a"),
    ):
        if name in names:
            with pytest.raises(ValueError, match=words):
                make(name, roles, **fields)


@pytest.mark.parametrize("name", ["parallel", "gymnasium", "torchrl"])
def test_a_space_draws_another_scenario_at_each_reset_and_pads_to_its_largest_team(name):
    adapter, teams = make(name, "space"), {}
    for seed in range(8):
        rows = adapter.reset(seed=seed)["robot"]
        teams[adapter.scenario.digest()] = adapter.scenario.num_robots
        assert rows.shape[1] == 5
        assert rows[:, : adapter.scenario.num_robots, 2:4].any(axis=2).all()
    assert len(teams) > 4
    assert set(teams.values()) == {3, 5}
