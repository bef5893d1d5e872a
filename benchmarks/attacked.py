"""Attack on the proved filter in random scenarios: `python benchmarks/attacked.py --pairs 10000000`.

Draws scenarios over wide ranges: speeds, drags, motors, steps, losses, failures, removals and walls. In each, an
adversary that knows the true state drives all cars, and the smallest distance of two cars is compared with the promised
one in every step in which `Proved.tails_compatible` is True. `--store` puts the table into docs/figures.json.
"""

import warnings
from collections import Counter

import figures
import numpy as np
import warp as wp

import lissajous_env
from baselines.benchmark.statistics import number
from baselines.policies.safety.proved import Proved, ProvedParameters, unmet_conditions

WORKING, REMOVED = 0, 2
FAULTS = ("none", "stop dead", "coast", "stop dead, by schedule", "coast, by schedule")
REMOVALS = ("none", "by time", "at random", "at the boundary", "after a collision")


def drawn(rng):
    """Return the kinds of failures and removals, and a scenario that `rng` draws; None if it cannot exist."""
    fault, removal = str(rng.choice(FAULTS)), str(rng.choice(REMOVALS))
    count = int(rng.choice([2, 3, 5, 15], p=[0.15, 0.2, 0.35, 0.3]))
    speed, step = float(np.exp(rng.uniform(np.log(0.1), np.log(10)))), float(rng.choice([0.02, 0.05, 0.1, 0.2, 0.5]))
    width = float(max(rng.uniform(0.8, 3), rng.uniform(0.4, 2) * speed) * (2 if count == 15 else 1))
    fields = {
        "robot.count": count, "formation.ring": tuple(map(int, rng.permutation(count))), "robot.throttle_max": None,
        "robot.speed_max": speed, "curve.half_width": width, "curve.half_height": width * float(rng.uniform(0.4, 1)),
        "formation.phase_rate": float(rng.uniform(0.05, 1)) * speed / (2.5 * width), "formation.start": "random",
        "formation.start_noise": 1.0, "task.step": step, "task.substeps": int(rng.choice([1, 2, 8, 64])),
        "task.duration": 80 * step, "task.grid": None, "task.contamination": None, "targets.count": 0,
        "targets.arrival_rate": 0.0, "sensing.radius": float(rng.uniform(0.05, 2)),
        "noise.message_loss": float(rng.choice([0, 0.2, 0.5, 0.7])), "messages.size": int(rng.choice([0, 2])),
        "noise.drive_spread": float(rng.choice([0, 0.02, 0.1, 0.3])), "robot.drag": float(rng.uniform(0.4, 3)),
        "noise.wheelbase_spread": float(rng.choice([0, 0.02, 0.1, 0.3])), "robot.offset": float(rng.uniform(0, 5)),
        "robot.wheelbase": float(rng.uniform(0.05, 0.4)), "robot.throttle_min": float(rng.uniform(0, 0.1)),
        "robot.drive_factors": tuple((i, float(rng.uniform(0.5, 2))) for i in range(count) if rng.random() < 0.3),
        "robot.lateral_acceleration_max": float(rng.choice([0.5, 5, np.inf])), "faults.schedule": (),
        "task.boundary": "remove" if removal == "at the boundary" else str(rng.choice(["open", "wall"])),
        "task.on_collision": "remove" if removal == "after a collision" else "count",
    }  # fmt: skip
    fields |= failures(rng, fault, count, step) | removals(rng, removal, count, step)
    try:
        return fault, removal, lissajous_env.scenario("experiment", **fields)
    except ValueError:
        return None


def failures(rng, kind, count, step):
    """Return the fields of a kind of failures."""
    if kind == "none":
        return {}
    fields = {"faults.stop": "coast" if kind.startswith("coast") else "dead"}
    if "schedule" not in kind:
        rates = {"faults.rate": rng.uniform(0.02, 0.5) / step / 10, "faults.mean_duration": rng.uniform(1, 30) * step}
        return fields | {name: float(value) for name, value in rates.items()}
    starts = np.round(rng.uniform(0, 60, count)) * step
    lengths = np.where(rng.random(count) < 0.4, np.inf, np.round(rng.uniform(1, 30, count)) * step)
    rows = [(i, float(starts[i]), float(starts[i] + lengths[i])) for i in range(count) if rng.random() < 0.6]
    return fields | {"faults.schedule": tuple(rows)}


def removals(rng, kind, count, step):
    """Return the fields of a kind of removals."""
    if kind == "by time":
        rows = [(i, float(np.round(rng.uniform(0, 60) * rng.choice([0, 1])) * step)) for i in range(count)]
        return {"faults.removed": tuple(row for row in rows if rng.random() < 0.5)}
    return {"faults.lost": int(rng.integers(1, count))} if kind == "at random" else {}


def drive_to(robots, goal):
    """Return actions of full throttle towards goals (W, N, 2)."""
    away = goal - robots.position.numpy()[..., :2]
    angle = np.arctan2(away[..., 1], away[..., 0]) - robots.heading.numpy()
    turn = np.clip(4 * ((angle + np.pi) % (2 * np.pi) - np.pi), -1, 1)
    return np.stack([turn, np.ones_like(turn)], axis=-1)


def attacks(simulation, rng, kind):
    """Return the adversary's actions: chase the nearest or failed robots, surround one, leave, or act at random."""
    robots = simulation.robots
    place, status = robots.position.numpy()[..., :2], robots.status.numpy()
    far = np.linalg.norm(place[:, :, None] - place[:, None], axis=-1) + 1e9 * np.eye(place.shape[1])
    far += 1e6 * (status == REMOVED)[:, None]
    if kind == "failed":
        far += 1e3 * (status == WORKING)[:, None]
    goal = np.take_along_axis(place, far.argmin(axis=-1)[..., None], axis=1)
    if kind in ("box", "leave"):
        goal = np.repeat(place[:, 1:2], place.shape[1], axis=1)
    if kind == "leave":
        goal[:, ::2] = 50 * place[:, ::2]
    move = drive_to(robots, goal)
    if kind == "random":
        move = rng.uniform(-1, 1, move.shape)
    slow = rng.random(move.shape[:2]) < 0.15  # around the edge of the dead zone, where a weak motor brakes
    robot = simulation.scenario.robot
    edge = 2 * (robot.dead_zone - robot.throttle_min) / (robot.full_throttle - robot.throttle_min) - 1
    move[..., 1] = np.where(slow, edge + rng.choice([0, 1e-7, 0.05], slow.shape), move[..., 1])
    action = np.zeros(simulation.action_shape, dtype=np.float32)
    action[..., :2] = move
    action[..., 2:] = rng.choice([0.5, np.nan], action[..., 2:].shape, p=[0.8, 0.2])
    return action


def nearest_approach(track):
    """Return the least distance (W, P) of each pair of robots on the straight pieces of a step (W, N, S, 2)."""
    one, other = np.triu_indices(track.shape[1], 1)
    apart = (track[:, one] - track[:, other]).astype(float)
    start, change = apart[:, :, :-1], np.diff(apart, axis=2)
    square = (change**2).sum(axis=-1)
    share = np.clip(-(start * change).sum(axis=-1) / np.where(square > 0, square, 1), 0, 1)
    return np.linalg.norm(start + share[..., None] * change, axis=-1).min(axis=-1)


def attack(scenario, seed, worlds=40, steps=60):
    """Return the pair-steps with a proof, the smallest distance over the promised one in them, and those below 1."""
    rng = np.random.default_rng(seed)
    simulation = lissajous_env.Simulation(scenario, worlds, seed=seed)
    repeats = int(rng.choice([1, 3]))
    margin = ProvedParameters().of(scenario).margin
    filter = Proved(scenario, worlds, parameters=ProvedParameters(margin=margin, repeats=repeats))
    kind = str(rng.choice(["nearest", "failed", "box", "leave", "random"]))
    one, other = np.triu_indices(scenario.num_robots, 1)
    promised = 2 * scenario.robot.radius + margin
    count, least, broken = 0, np.inf, 0
    for _ in range(steps):
        wanted = wp.array(attacks(simulation, rng, kind), dtype=wp.float32, device="cpu")
        action = filter(simulation.observation, wanted)
        compatible, there = filter.tails_compatible, simulation.robots.status.numpy() != REMOVED
        simulation.step(action)
        there &= simulation.robots.status.numpy() != REMOVED
        pairs = there[:, one] & there[:, other] & (compatible & ~simulation.over)[:, None]
        ratio = nearest_approach(simulation.robots.path.numpy()[..., :2])[pairs] / promised
        count, least = count + len(ratio), min(least, ratio.min(initial=np.inf))
        broken += int((ratio < 1).sum())
    return count, least, broken


def campaign(pairs, first_seed=0):
    """Attack random scenarios until `pairs` pair-steps with a proof; return the rows of results, and unmet conditions.

    A row is the kinds of failures and removals, the seed, and what `attack` returns.
    """
    rows, unmet, seed = [], Counter(), first_seed
    while sum(row[3] for row in rows) < pairs:
        seed += 1
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            case = drawn(np.random.default_rng(seed))
            if case is None:
                continue
            if conditions := unmet_conditions(case[2]):
                unmet.update(words.split(" must")[0] for words in conditions)
                continue
            rows.append((*case[:2], seed, *attack(case[2], seed)))
    return rows, unmet


def table_of(rows):
    """Return the table of a campaign: each kind of failures, each of removals, and all."""
    groups = [(f"failures: {kind}", [row for row in rows if row[0] == kind]) for kind in FAULTS]
    groups += [(f"removals: {kind}", [row for row in rows if row[1] == kind]) for kind in REMOVALS]
    lines = [
        [name, str(len(group)), f"{sum(row[3] for row in group):,}", f"{min(row[4] for row in group):.5f}",
         str(sum(row[5] for row in group))]
        for name, group in [*groups, ("all", rows)] if group
    ]  # fmt: skip
    columns = ["scenarios with", "number", "pair-steps with a proof", "smallest distance / promised", "below it"]
    return {"columns": columns, "rows": lines}


def main():
    parser = figures.parser(__doc__)
    parser.add_argument("--pairs", type=int, default=200_000, help="pair-steps with a proof")
    parser.add_argument("--seed", type=int, default=0, help="seed before that of the first scenario")
    options = parser.parse_args()
    rows, unmet = campaign(options.pairs, options.seed)
    for fault, removal, seed, _, least, broken in rows:
        if broken:
            print(f"seed {seed}, failures {fault}, removals {removal}: {broken} below, least {number(least)}")
    print("scenarios left out, by their unmet condition:", dict(unmet))
    figures.publish("attacked", "attack on the proved filter", table_of(rows), options.store)


if __name__ == "__main__":
    main()
