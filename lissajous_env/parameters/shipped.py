"""The included scenarios: those of the paper, and others."""

import dataclasses

from lissajous_env.parameters.scenario import Curve, Faults, Formation, Noise, Robot, Scenario, Sensing, Targets, Task

# Section VII prints robots 1 to 5 with R_1 = {2, 4}, R_2 = {1, 5}, R_3 = {4, 5}, R_4 = {1, 3}, R_5 = {2, 3}.
_EXPERIMENT_RING = (0, 1, 4, 2, 3)

# If all targets were present from the start, most would be detected before a fault could have an effect.
_ARRIVING = Targets(count=20, arrival_rate=0.5)

_EXPERIMENT = Scenario(
    name="experiment",
    description="Section VII: five cars on curve (16); robots 0 and 4 stop from 24.5 s to 34.5 s (Fig. 7, 8).",
    curve=Curve(half_width=1.8, half_height=0.8, a=3, b=2),
    formation=Formation(phase_rate=0.3, p=2, ring=_EXPERIMENT_RING, start_noise=0.02),
    robot=Robot(kind="car", radius=0.125, model_offset=3.804),
    faults=Faults(schedule=((0, 24.5, 34.5), (4, 24.5, 34.5))),
    targets=_ARRIVING,
    # Identical cars would preserve the formation without any feedback; real ones do not.
    noise=Noise(wheelbase_spread=0.02, drive_spread=0.02),
    task=Task(duration=60.0),
)

_INTRUDERS = Scenario(
    name="intruders",
    description="Five cars in 10.8 m x 4.8 m with a 0.5 m sensor; targets enter at the boundary, half of them flee.",
    curve=Curve(half_width=5.4, half_height=2.4, a=3, b=2),
    # omega = 2 m/s / max ||r'||: the fastest stretch of the curve requires the car's top speed.
    formation=Formation(phase_rate=0.118, coupling=1.0, start="rotated", start_noise=0.02),
    # The throttle limit makes the steady top speed 2 m/s: (36.81 tau - 3.681) / 0.945 = 2.
    robot=Robot(kind="car", radius=0.125, throttle_max=0.151345, lateral_acceleration_max=4.0, model_offset=3.804),
    sensing=Sensing(radius=0.5),
    targets=Targets(
        count=0,
        arrival_rate=0.5,
        entry="boundary",
        wandering=0.5,
        fleeing=0.5,
        speed=0.15,
        flee_radius=0.9,
        flee_speed=0.6,
    ),
    task=Task(duration=60.0),
)

_EVADERS = dataclasses.replace(
    _EXPERIMENT,
    name="evaders",
    description="Like experiment, but with 0.6 m sensors, too short for (8), 3 m/s cars and evading 0.3 m/s targets.",
    # (36.81 tau - 3.681) / 0.945 = 3; the fastest stretch of the curve requires 1.69 m/s.
    robot=dataclasses.replace(_EXPERIMENT.robot, throttle_max=0.177017),
    sensing=Sensing(radius=0.6),
    targets=Targets(count=0, arrival_rate=0.5, entry="unseen", wandering=0.5, fleeing=0.5, speed=0.3, flee_speed=0.3),
    faults=Faults(),
    task=Task(duration=60.0, contamination=(90, 40)),
)

_ROUGH = dataclasses.replace(
    _EXPERIMENT,
    name="rough",
    description="Like experiment, but with noise, unequal cars, lost and late messages, and random faults.",
    formation=dataclasses.replace(_EXPERIMENT.formation, start="rotated", start_noise=0.1),
    faults=Faults(rate=0.01, mean_duration=5.0),
    noise=Noise(
        actuator=0.05,
        position=0.01,
        heading=0.02,
        speed=0.02,
        wheelbase_spread=0.05,
        drive_spread=0.02,
        message_loss=0.1,
        message_delay=0.1,
    ),
)

SHIPPED = (
    Scenario(
        name="ideal",
        description="Fig. 2 and 3: 15 points on the curve in equilibrium, 10,000 moving targets from the start.",
        curve=Curve(half_width=5.0, half_height=5.0, a=7, b=8),
        formation=Formation(phase_rate=0.05, coupling=1.0, p=7),
        robot=Robot(kind="curve", radius=0.09),
        sensing=Sensing(targets_seen=0),
        targets=Targets(count=10_000, wandering=1.0, speed=0.2),
        task=Task(duration=10.0),
    ),
    Scenario(
        name="perturbation",
        description="Fig. 4: ten points on the curve, robot 0 displaced along it by 0.25 rad.",
        curve=Curve(half_width=5.0, half_height=5.0, a=7, b=3),
        formation=Formation(phase_rate=0.3, p=3, displaced=((0, 0.25),)),
        robot=Robot(kind="curve", radius=0.125),
        task=Task(duration=30.0),
    ),
    Scenario(
        name="failure",
        description="Fig. 6: five points on curve (16), robots 0 and 1 stop from 9.6 s to 19.5 s.",
        curve=Curve(half_width=1.8, half_height=0.8, a=3, b=2),
        formation=Formation(phase_rate=0.3, p=2, start="rotated"),
        robot=Robot(kind="curve", radius=0.125),
        targets=_ARRIVING,
        faults=Faults(schedule=((0, 9.6, 19.5), (1, 9.6, 19.5))),
        task=Task(duration=30.0),
    ),
    _EXPERIMENT,
    dataclasses.replace(
        _EXPERIMENT,
        name="experiment-printed",
        description="Section VII with the constants as printed (beta = 0.94): infeasible, cars leave the rectangle.",
        robot=Robot(kind="car", radius=0.125, drag=0.94, drive=36.8, offset=0.94, dead_zone=0.0),
    ),
    _INTRUDERS,
    dataclasses.replace(
        _INTRUDERS,
        name="intruders-inside",
        description="Like intruders, but targets appear anywhere, also where patrols of the boundary detect nothing.",
        targets=dataclasses.replace(_INTRUDERS.targets, entry="inside"),
    ),
    _EVADERS,
    dataclasses.replace(
        _EVADERS,
        name="evaders-failure",
        description="Like evaders, but robots 0 and 4 stop from 24.5 s to 34.5 s.",
        faults=_EXPERIMENT.faults,
    ),
    dataclasses.replace(
        _EVADERS,
        name="evaders-lost",
        description="Like evaders, but robot 0 is removed at 20 s.",
        faults=Faults(removed=((0, 20.0),)),
    ),
    dataclasses.replace(
        _EVADERS,
        name="evaders-fast",
        description="Like evaders, but targets of 0.9 m/s; from 0.65 m/s on, one can evade the paper's formation.",
        targets=dataclasses.replace(_EVADERS.targets, speed=0.9, flee_speed=0.9),
    ),
    dataclasses.replace(
        _EVADERS,
        name="evaders-uneven",
        description="Like evaders, but the cars' top speeds are 1.5 to 4 m/s; the curve requires up to 1.69 m/s.",
        # Steady speed (36.81 f tau - 3.681) / 0.945 at full throttle, for factors f; robot 2 is that of `evaders`.
        robot=dataclasses.replace(_EVADERS.robot, drive_factors=((0, 0.7824), (1, 0.855), (3, 1.0725), (4, 1.145))),
    ),
    _ROUGH,
    dataclasses.replace(
        _ROUGH,
        name="rough-lost",
        description="Like rough, but one robot fails for good, which cuts the ring that the paper assumes.",
        faults=dataclasses.replace(_ROUGH.faults, lost=1),
    ),
    Scenario(
        name="team",
        description="Fifteen cars on the curve of Fig. 2; two neighbours stop from 15 s to 25 s.",
        curve=Curve(half_width=5.0, half_height=5.0, a=7, b=8),
        # On this curve 0.02 rad are up to 4.3 m, so without a headway some bodies would overlap at the start. In 0.3 s
        # two cars of 1.4 m/s or more that drive towards each other can turn away: they sense each other within a step,
        # and need 0.28 m.
        formation=Formation(phase_rate=0.05, coupling=1.0, p=7, start="rotated", start_noise=0.02, start_headway=0.3),
        robot=Robot(kind="car", radius=0.09, model_offset=3.804),
        targets=_ARRIVING,
        faults=Faults(schedule=((0, 15.0, 25.0), (1, 15.0, 25.0))),
        noise=Noise(wheelbase_spread=0.02, drive_spread=0.02),
        task=Task(duration=60.0, contamination=(80, 80)),
    ),
    Scenario(
        name="hall",
        description="Seven cars of 1.5 m/s with 8 m sensors in a 40 m x 25 m hall; targets evade at 0.6 m/s.",
        # Not six: no stable equilibrium of theirs has six places, because p must be coprime to N (Lemma 1).
        curve=Curve(half_width=20.0, half_height=12.5, a=3, b=4),
        # 0.9 x 1.5 m/s / max ||r'||: a tenth of the speed remains for robots that have to catch up.
        formation=Formation(phase_rate=0.0173, start="rotated", start_noise=0.02),
        # The turning circle is 0.8 m / tan(0.45) = 1.66 m.
        robot=Robot(kind="car", radius=0.5, wheelbase=0.8, steering_max=0.45, speed_max=1.5),
        # Too short for (8), 10.2 m, and to cover the hall without moving, 8.5 m according to a search. The formation
        # detects rogues of up to 0.75 m/s.
        sensing=Sensing(radius=8.0),
        targets=Targets(
            count=0,
            arrival_rate=0.1,
            entry="unseen",
            wandering=0.5,
            fleeing=0.5,
            speed=0.6,
            flee_radius=12.0,
            flee_speed=0.6,
        ),
        # Gaps between discs are often narrower than 0.5 m: with cells of that size, rogues would get stuck in them.
        task=Task(duration=300.0, grid=(40, 25), contamination=(240, 150)),
    ),
    Scenario(
        name="redundant",
        description="Section V: 30 points, two on each of the places of Fig. 2; one of each stops from 15 s to 25 s.",
        curve=Curve(half_width=5.0, half_height=5.0, a=7, b=8),
        # Robots k and k + 15 share a place (Lemma 1), where they overlap by design: no collision of theirs is counted.
        formation=Formation(phase_rate=0.05, coupling=1.0, p=14, start="rotated"),
        robot=Robot(kind="curve", count=30, radius=0.04),
        targets=_ARRIVING,
        faults=Faults(schedule=tuple((robot, 15.0, 25.0) for robot in range(15))),
        task=Task(duration=60.0, contamination=(80, 80)),
    ),
    Scenario(
        name="knot",
        description="Section IV-A: the failure of Fig. 6 on the knot (10) with z = 0.8 sin(7 gamma), points in space.",
        curve=Curve(half_width=1.8, half_height=0.8, a=3, b=2, half_depth=0.8, c=7),
        formation=Formation(phase_rate=0.3, p=2, start="rotated"),
        robot=Robot(kind="curve", radius=0.125),
        targets=_ARRIVING,
        faults=Faults(schedule=((0, 9.6, 19.5), (1, 9.6, 19.5))),
        task=Task(duration=30.0),
    ),
    Scenario(
        name="swarm",
        description="101 points on the curve in 40 m x 25 m, 2,000 targets.",
        curve=Curve(half_width=20.0, half_height=12.5, a=51, b=50),
        formation=Formation(phase_rate=0.02, coupling=1.0, start="rotated"),
        robot=Robot(kind="curve", radius=0.006),
        targets=Targets(count=2000),
        task=Task(duration=30.0, grid=(80, 50)),
    ),
    Scenario(
        name="city",
        description="1,001 points at some 17 m/s on the curve in 4 km x 2.5 km, a million targets on foot.",
        curve=Curve(half_width=2000.0, half_height=1250.0, a=501, b=500),
        # A robot measures phases to 6e-8 rad, which (1) turns into a rate at its coupling: with 1/s it would drown
        # omega.
        formation=Formation(phase_rate=1.5e-5, coupling=1e-4, start="rotated"),
        # By (6): where the ellipse is flat, larger bodies would have to pass each other at different heights.
        robot=Robot(kind="curve", radius=0.006),
        targets=Targets(count=1_000_000, speed=1.4),
        task=Task(duration=30.0, grid=(400, 250)),
    ),
)
