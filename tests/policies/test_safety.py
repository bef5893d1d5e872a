"""The collision filter: its quadratic program, unchanged actions, resolved encounters, and results."""

import numpy as np
import pytest
import warp as wp
from reference_motion import car_runge_kutta, closest_approach
from reference_program import agrees_with_independent_solvers

import baselines
import lissajous_env
from baselines.policies.base import Policy
from baselines.policies.safety.filter import Safe, SafetyParameters, speed_limit
from baselines.policies.safety.filtered import Filtered
from baselines.policies.safety.quadratic_program import solve_quadratic_program
from lissajous_env.device.devices import compile_quietly
from lissajous_env.theory.geometry import top_speed
from lissajous_env.world.observation import layout

WEIGHT, TOUCH = SafetyParameters().throttle_weight, 0.25
"""Distance at which two cars of the experiment touch [m]."""
TWO_CARS = lissajous_env.scenario(
    "experiment",
    **{"robot.count": 2, "formation.ring": None, "faults.schedule": (), "sensing.radius": 1.158},
).resolve()
"""Two cars that see as far as those of the experiment."""
WIDE = SafetyParameters(clearance=0.07, growth=0.2)
"""Parameters with which two cars alone give way in time; the default gives way late, for the sake of the formation."""


class Wanting(Policy):
    """Wants the same action of each robot at all times."""

    kind = "car"
    arrays = "warp"

    def want(self, action):
        self.action.assign(np.broadcast_to(np.asarray(action, dtype=np.float32), self.action.shape).copy())
        return self

    def decide(self, observation):
        pass


def observed(cars):
    """Rows (W, N, D) of cars (W, N, 4) x, y, heading, speed, with the nearest robots in the disc."""
    scenario, seen = TWO_CARS, 2
    names = layout(scenario).names
    rows = np.zeros((*cars.shape[:2], len(names)), dtype=np.float32)
    column = {name: k for k, name in enumerate(names)}
    x, y, heading, speed = np.moveaxis(cars, -1, 0)
    top, radius = scenario.robot.top_speed, scenario.sensing.radius
    own = {
        "x": x / scenario.curve.half_width,
        "y": y / scenario.curve.half_height,
        "cos_heading": np.cos(heading),
        "sin_heading": np.sin(heading),
        "speed": speed / top,
        "works": 1.0,
    }
    for name, value in own.items():
        rows[..., column[name]] = value
    place = cars[..., :2]
    velocity = speed[..., None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    for w, i in np.ndindex(cars.shape[:2]):
        away = place[w] - place[w, i]
        distance = np.linalg.norm(away, axis=1)
        near = [j for j in np.argsort(distance) if j != i and distance[j] < radius][:seen]
        for k, j in enumerate(near):
            first = column[f"robot_{k}_present"]
            relative = np.clip((velocity[w, j] - velocity[w, i]) / (2 * top), -1, 1)
            rows[w, i, first : first + 5] = [1, *away[j] / radius, *relative]
    return rows


def drive(cars, action, step=0.1):
    """Cars (W, N, 4) after a step by the float64 reference, and the least distance of each world's pairs in it."""
    robot = TWO_CARS.robot
    moved, nearest = cars.copy(), np.full(len(cars), np.inf)
    for _ in range(2):
        before = moved.copy()
        for w, i in np.ndindex(cars.shape[:2]):
            throttle = robot.throttle_min + (action[w, i, 1] + 1) / 2 * (robot.throttle_max - robot.throttle_min)
            moved[w, i] = car_runge_kutta(robot, before[w, i], action[w, i, 0] * robot.steering_max, throttle, step / 2)
        for w in range(len(cars)):
            for i in range(cars.shape[1]):
                for j in range(i):
                    apart = closest_approach(before[w, i, :2] - before[w, j, :2], moved[w, i, :2] - moved[w, j, :2])
                    nearest[w] = min(nearest[w], apart)
    return moved, nearest


def least_distance(cars, wanted, filtered, steps=30):
    """Least distance [m] in each world when cars (W, N, 4) want an action all the way."""
    cars = np.asarray(cars, dtype=float)
    policy = Wanting(TWO_CARS, len(cars)).want(wanted)
    policy = Filtered(policy, Safe, WIDE) if filtered else policy
    least = np.full(len(cars), np.inf)
    for _ in range(steps):
        action = policy.act(observed(cars))
        assert (np.abs(action) <= 1).all()
        cars, nearest = drive(cars, action)
        least = np.minimum(least, nearest)
    return least


def cruising(speed, steering=0.0):
    """Action that holds a speed [m/s]."""
    return [steering, 2 * ((0.945 * speed + 3.681) / 36.81 - 0.1) / 0.15 - 1]


def test_two_cars_that_meet_head_on_pass_on_the_right():
    cars = np.array([[[-0.5, 0, 0, 1.1], [0.5, 0, np.pi, 1.1]]])
    action = Filtered(Wanting(TWO_CARS).want(cruising(1.1)), Safe, WIDE).act(observed(cars))
    assert (action[0, :, 0] < -0.2).all()


@pytest.mark.parametrize(("aside", "speed"), [(-0.2, 0.5), (0.0, 1.1), (0.1, 2.0)])
def test_a_car_drives_around_one_that_stands(aside, speed):
    """A physical story: the car ahead is stuck, and the other cannot brake."""
    cars = np.array([[[-1.5, 0, 0, speed], [0, aside, 1.0, 0]]])
    policy = Filtered(Wanting(TWO_CARS).want(cruising(speed)), Safe)
    least = np.inf
    for _ in range(int(3 / speed / 0.1)):
        action = policy.act(observed(cars))
        action[0, 1] = [0, -1]
        cars, nearest = drive(cars, action)
        least = min(least, nearest[0])
    assert least > TOUCH
    assert cars[0, 1, 3] == 0


def test_random_meetings_of_two_cars():
    """A physical story, 100 times: cars aimed to be at one place at one time, from any side, at 0.4 to 2 m/s."""
    rng = np.random.default_rng(4)
    heading, speed = rng.uniform(-np.pi, np.pi, (100, 2)), rng.uniform(0.4, 2.0, (100, 1)) * np.ones((100, 2))
    heading[:, 1] = heading[:, 0] + rng.uniform(0.5, 2 * np.pi - 0.5, 100)
    away = 1.5 * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    cars = np.concatenate([-away + rng.normal(0, 0.03, away.shape), heading[..., None], speed[..., None]], axis=-1)
    wanted = np.stack([np.array([cruising(v) for v in each]) for each in speed])
    assert (least_distance(cars, wanted, filtered=False) < TOUCH).mean() > 0.6
    assert (least_distance(cars, wanted, filtered=True) < TOUCH).mean() < 0.02


def test_far_from_all_the_action_passes_bit_for_bit():
    """Oracle: the wanted action, for one car alone, for two that part, and for one that another follows."""
    rng = np.random.default_rng(1)
    wanted = rng.uniform(-1, 1, (3, 2, 2)).astype(np.float32)
    alone = [[-1.5, 0, 0, 1.1], [1.5, 0, 0, 1.1]]
    parting = [[-0.4, 0, np.pi, 1.1], [0.4, 0, 0, 1.1]]
    following = [[-0.5, 0, 0, 1.0], [0.5, 0, 0, 1.0]]
    cars = np.array([alone, parting, following])
    policy = Filtered(Wanting(TWO_CARS, 3).want(wanted), Safe)
    np.testing.assert_array_equal(policy.act(observed(cars)), wanted)


def test_the_throttle_leads_to_the_speed_limit_and_no_further():
    """Oracle: v' = push - c v, solved for the push of a step; at full throttle the car would do 5.8 m/s."""
    policy = Filtered(Wanting(TWO_CARS).want([0, 1]), Safe)
    limit = speed_limit(TWO_CARS, policy.filter.parameters)
    assert limit == pytest.approx(1.5 * top_speed(TWO_CARS.curve, TWO_CARS.formation.phase_rate))
    cars = np.array([[[-50.0, 0, 0, 0.0], [50.0, 0, 0, 4.0]]])
    fastest = 0.0
    for _ in range(40):
        cars, _ = drive(cars, policy.act(observed(cars)))
        fastest = max(fastest, cars[0, 0, 3])
    assert limit - 0.02 < fastest < limit + 0.02
    assert cars[0, 1, 3] < limit + 0.02


@wp.kernel
def solve_programs(
    rows: wp.array2d(dtype=wp.vec3),
    count: wp.array(dtype=int),
    top: wp.array(dtype=float),
    wanted: wp.array(dtype=wp.vec2),
    weight: float,
    out: wp.array(dtype=wp.vec3),
):
    k = wp.tid()
    out[k] = solve_quadratic_program(count[k], rows[k], weight, top[k], wanted[k])


def test_programs_are_solved():
    """Oracle: CasADi's active-set solver and HiGHS in float64, for feasible programs and for those that contradict."""
    rng = np.random.default_rng(2)
    rows = (rng.normal(0, 0.5, (150, 8, 3)) - [0, 0, 0.2]).astype(np.float32)
    count, top = rng.integers(1, 9, 150).astype(np.int32), rng.uniform(-0.5, 1.0, 150).astype(np.float32)
    wanted, out = rng.uniform(-1.2, 1.2, (150, 2)).astype(np.float32), wp.zeros(150, dtype=wp.vec3, device="cpu")
    given = [wp.array(rows, dtype=wp.vec3, device="cpu"), *(wp.array(each, device="cpu") for each in (count, top))]
    inputs = [*given, wp.array(wanted, dtype=wp.vec2, device="cpu"), WEIGHT]
    with compile_quietly():
        wp.launch(solve_programs, 150, inputs, [out], device="cpu")
    actions = out.numpy()[:, :2]
    assert (np.abs(actions) <= 1).all()
    assert (actions[:, 1] <= top).all()
    entries = zip(rows, count, top, wanted, actions, strict=True)
    solved = [agrees_with_independent_solvers(each[:n], float(t), want, u) for each, n, t, want, u in entries]
    feasible, judged = np.mean(solved, axis=0)
    assert 0.3 < feasible < 1
    assert judged > 0.95


@pytest.mark.parametrize(("name", "scenario"), [("kuramoto-mpcc", "experiment"), ("random", "rough")])
def test_collisions_are_cut_to_a_fifth(name, scenario):
    """Oracle: the same policy without the filter, on the same seeds."""
    rows, plain = (
        lissajous_env.evaluate(baselines.make(each, scenario, num_worlds=8), scenario, range(8))
        for each in (f"{name}-safe", name)
    )
    collisions, before = (np.mean([row["collisions"] for row in each]) for each in (rows, plain))
    assert collisions <= 0.2 * before
    spacing, was = (np.mean([row["spacing_factor"] for row in each]) for each in (rows, plain))
    assert spacing < was + 0.4


def test_ring_neighbours_beyond_the_disc_are_known_from_their_messages():
    """Oracle: places and velocities of the cars themselves; before the second message no velocity is known."""
    scenario = lissajous_env.scenario("intruders")
    simulation, policy = lissajous_env.Simulation(scenario, 3), baselines.make("laps-safe", scenario, 3)
    assert isinstance(policy.filter, Safe)
    places = []
    for _ in range(5):
        places.append(simulation.robots.position.numpy()[:, :, :2].copy())
        policy.filter._others.zero_()
        simulation.step(policy.act(simulation.observation))
        known = policy.filter._others.numpy()
        checked = 0
        for w in range(3):
            for i in range(5):
                for j in ((i - 1) % 5, (i + 1) % 5):
                    away = places[-1][w, j] - places[-1][w, i]
                    if np.linalg.norm(away) < scenario.sensing_radius + 0.01:
                        continue
                    near = known[w, i][np.abs(known[w, i, :, :2] - away).max(axis=1) < 1e-3]
                    if len(places) == 1:
                        assert len(near) == 0
                        continue
                    velocity = (places[-1][w, j] - places[-2][w, j]) / scenario.task.step
                    assert near[0, 2:] == pytest.approx(velocity, abs=1e-3)
                    checked += 1
        assert checked > 20 or len(places) == 1
    policy.reset([True, False, False])
    kept = policy.filter._memory.numpy()[..., 2]
    assert kept[0].max() == 0
    assert kept[1:].min() == 1


def test_cars_that_leave_the_curve_for_a_patrol_do_not_meet():
    """Oracle: the patrol without the filter, and with one that sees no further than the disc: 0.107 an episode."""
    rows = lissajous_env.evaluate(baselines.make("laps-safe", "intruders", 128), "intruders", range(2000, 2128))
    plain = lissajous_env.evaluate(baselines.make("laps", "intruders", 128), "intruders", range(2000, 2128))
    assert np.mean([row["collisions"] for row in rows]) < 0.05
    assert np.mean([row["collisions"] for row in plain]) > 0.08


def test_an_action_that_is_not_a_number_is_passed_on():
    """The simulation flags such a world by name; the filter must neither hide it nor spread it."""
    wanted = np.zeros((2, 5, 2), dtype=np.float32)
    wanted[1, 3, 0] = np.nan
    simulation = lissajous_env.Simulation("experiment", num_worlds=2)
    action = Filtered(Wanting("experiment", 2).want(wanted), Safe).act(simulation.observation.numpy())
    assert np.isnan(action[1, 3, 0])
    assert np.isfinite(action).sum() == action.size - 1
