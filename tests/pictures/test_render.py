"""Pictures: they show the state, do not change it, and need no display."""

import dataclasses
import subprocess
import sys

import numpy as np
import pygame
import pytest
from pettingzoo.test import render_test

import lissajous_env
from lissajous_env.render import Renderer, Snapshot, palette
from lissajous_env.world.state import NEVER, REMOVED, STUCK


def world(name="experiment", steps=3, **overrides) -> tuple[lissajous_env.Simulation, Snapshot]:
    simulation = lissajous_env.Simulation(lissajous_env.scenario(name, **overrides), seed=3)
    for _ in range(steps):
        simulation.step(np.zeros(simulation.action_shape, np.float32))
    return simulation, Snapshot.of(simulation)


def changed(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    return np.argwhere((before != after).any(axis=-1))


def count_near(picture: np.ndarray, colour: tuple[int, int, int], tolerance: int = 40) -> int:
    return int((np.abs(picture.astype(int) - colour).max(axis=-1) < tolerance).sum())


def with_one_target(seen: Snapshot, found_at: int, place: tuple[float, float] = (0.9, 0.0)) -> Snapshot:
    """The same world, with one target at a free place."""
    return dataclasses.replace(
        seen,
        target_position=np.array([place]),
        motion=np.array([2]),
        appears_at=np.array([0]),
        found_at=np.array([found_at]),
        found_early=np.zeros(1),
    )


def test_pettingzoo_contract():
    render_test(lissajous_env.env)
    assert not pygame.display.get_init()


@pytest.mark.parametrize("name", lissajous_env.scenarios())
def test_every_scenario_is_drawn(name):
    simulation, _ = world(name, steps=1)
    renderer = Renderer(simulation.scenario)
    picture = renderer.draw(simulation)
    width, height = renderer.view.size
    assert picture.shape == (height, width, 3)
    assert picture.dtype == np.uint8
    assert picture.flags.writeable
    assert count_near(picture, palette.ROBOT) > 100
    assert len(np.unique(picture @ [65536, 256, 1])) > 100


@pytest.mark.parametrize(
    "size",
    [
        (159, 400), (400,), (400.5, 300), (10**5, 10**5), (3841, 2160), (float("nan"), 300), (1e30, 300), "ab",
        ["9", "9"],
    ],
)  # fmt: skip
def test_bad_size_is_refused(size):
    with pytest.raises(ValueError, match="size must be"):
        Renderer("experiment", size)


def test_a_robot_is_drawn_where_it_is():
    _, seen = world(steps=0, **{"sensing.radius": 0.01})
    renderer = Renderer("experiment")
    moved = np.array(seen.position)
    moved[0, :2] = 0.7, 0.1
    place = renderer.view.place(moved[0, :2])
    before = renderer.draw(seen)
    renderer.reset()
    after = renderer.draw(dataclasses.replace(seen, position=moved, step=0))
    assert (
        count_near(
            after[int(place[1]) - 20 : int(place[1]) + 20, int(place[0]) - 20 : int(place[0]) + 20], palette.ROBOT
        )
        > 200
    )
    assert len(changed(before, after)) > 500


@pytest.mark.parametrize(("status", "colour"), [(STUCK, palette.STUCK), (REMOVED, palette.REMOVED)])
@pytest.mark.parametrize("name", ["experiment", "failure"])
def test_a_fault_shows_at_the_robot(name, status, colour):
    simulation, seen = world(name)
    renderer = Renderer(simulation.scenario)
    failed = np.array(seen.status)
    failed[0] = int(status)
    before, after = renderer.draw(seen), renderer.draw(dataclasses.replace(seen, status=failed))
    x, y = (int(each) for each in renderer.view.place(seen.position[0, :2]))
    there = np.s_[max(y - 36, 0) : y + 36, max(x - 36, 0) : x + 36]
    assert count_near(after[there], colour) > count_near(before[there], colour) + 50
    assert count_near(after[there], palette.ROBOT) < count_near(before[there], palette.ROBOT)


def test_a_target_is_red_flashes_when_detected_and_vanishes():
    simulation, seen = world(steps=12)
    renderer = Renderer(simulation.scenario)
    x, y = (int(each) for each in renderer.view.place(np.array([0.9, 0.0])))
    there = np.s_[y - 16 : y + 16, x - 16 : x + 16]

    def around(found_at: int) -> np.ndarray:
        return renderer.draw(with_one_target(seen, found_at))[there]

    at_large, flash, vanished = around(int(NEVER)), around(seen.step - 2), around(seen.step - 11)
    assert count_near(at_large, palette.TARGET) > 20
    assert count_near(flash, palette.TARGET) == 0
    assert count_near(flash, palette.FOUND, 90) > 10
    assert count_near(vanished, palette.FOUND, 90) == count_near(vanished, palette.TARGET) == 0


def test_a_contact_is_ringed():
    simulation, seen = world()
    renderer = Renderer(simulation.scenario)
    touching = dataclasses.replace(seen, contact=np.array([[0, 1]]))
    before, after = renderer.draw(seen), renderer.draw(touching)
    assert count_near(after, palette.CONTACT) > count_near(before, palette.CONTACT) + 200


def test_ground_darkens_where_it_was_not_sensed():
    simulation, seen = world(**{"sensing.radius": 0.05, "targets.count": 0, "targets.arrival_rate": 0})
    renderer = Renderer(simulation.scenario)
    x, y = (int(each) for each in renderer.view.place(np.array([0.9, 0.0])))
    late = dataclasses.replace(seen, step=200)
    sensed = dataclasses.replace(late, sensed_at=np.full_like(seen.sensed_at, 200))
    # The lower half was sensed just now, the upper half never.
    half = np.where(np.arange(16)[:, None] < 8, 200, np.zeros_like(seen.sensed_at))
    lower = dataclasses.replace(late, sensed_at=half)
    pictures = [renderer.draw(each)[:, x].astype(int).sum(axis=1) for each in (late, sensed, lower)]
    assert pictures[0][y] < pictures[1][y]
    assert pictures[2][y - 60] < pictures[2][y + 60]


def test_trails_grow_with_time_and_are_forgotten():
    simulation, _ = world("failure", steps=0)
    scenario = simulation.scenario
    go = np.full(
        simulation.action_shape, scenario.formation.phase_rate / scenario.alpha / scenario.robot.phase_rate_max
    )
    renderer = Renderer(scenario)
    for _ in range(4):
        renderer.draw(simulation)
        simulation.step(go)
    with_trail = renderer.draw(simulation)
    np.testing.assert_array_equal(renderer.draw(simulation), with_trail)
    renderer.reset()
    assert len(changed(with_trail, renderer.draw(simulation))) > 100
    # Another episode does not draw on from the last one.
    simulation.reset(seeds=[77])
    fresh = Renderer(scenario).draw(simulation)
    np.testing.assert_array_equal(renderer.draw(simulation), fresh)


def test_a_robot_that_leaves_the_picture_is_pointed_out():
    simulation, seen = world()
    renderer = Renderer(simulation.scenario)
    position = np.array(seen.position)
    position[0, :2] = 30.0, 0.0
    picture = renderer.draw(dataclasses.replace(seen, position=position))
    assert count_near(picture[:, -30:], palette.ROBOT) > 30


def test_drawing_changes_nothing():
    drawn, plain = (lissajous_env.Simulation(lissajous_env.scenario("rough"), 2, seed=5) for _ in range(2))
    renderer = Renderer(drawn.scenario)
    rng = np.random.default_rng(0)
    for _ in range(20):
        action = rng.uniform(-1, 1, drawn.action_shape).astype(np.float32)
        renderer.draw(drawn, world=1)
        for simulation in (drawn, plain):
            simulation.step(action)
        np.testing.assert_array_equal(drawn.observation.numpy(), plain.observation.numpy())
    assert str(drawn.score()) == str(plain.score())


def test_a_world_of_a_batch_looks_as_it_does_alone():
    batch, alone = (lissajous_env.Simulation(lissajous_env.scenario("rough"), w, seed=s) for w, s in ((3, 7), (1, 9)))
    np.testing.assert_array_equal(Renderer("rough").draw(batch, world=2), Renderer("rough").draw(alone))


def test_rgb_array_needs_neither_display_nor_sound():
    # In a process of its own: what another test has started does not count.
    code = """
import os
os.environ.pop("SDL_VIDEODRIVER", None)
import lissajous_env, pygame
env = lissajous_env.parallel_env("experiment", render_mode="rgb_array")
env.reset(seed=0)
assert env.render().std() > 5
assert not pygame.display.get_init() and not pygame.mixer.get_init() and not pygame.get_init()
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "pygame" not in done.stdout


def test_window_that_is_closed_stays_closed():
    env = lissajous_env.parallel_env("experiment", render_mode="human")
    env.reset(seed=0)
    assert pygame.display.get_init()
    assert "experiment" in pygame.display.get_caption()[0]
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    action = {agent: np.zeros(2, np.float32) for agent in env.agents}
    env.step(action)
    assert not pygame.display.get_init()
    env.step(action)
    env.close()
    env.close()
    assert not pygame.display.get_init()


def test_window_without_a_display_is_refused_with_a_way_out(monkeypatch):
    simulation, _ = world()
    renderer = Renderer(simulation.scenario)
    renderer.draw(simulation)
    monkeypatch.setenv("SDL_VIDEODRIVER", "no such driver")
    with pytest.raises(OSError, match="rgb_array"):
        renderer.show(10)


@pytest.mark.parametrize(("count", "pixels"), [(100, 90.0), (2, 250.0)])
def test_a_crowd_of_discs_or_wide_ones_are_drawn_as_their_union(count, pixels):
    # Oracle: the distance to the nearest middle, pixel by pixel.
    from lissajous_env.render.canvas import FINE, opaque
    from lissajous_env.render.ground import Sensors

    room = pygame.Rect(30, 20, 400, 200)
    middles = np.random.default_rng(0).uniform([-50, -50], [250, 250], (count, 2))
    surface = opaque((460, 240))
    surface.fill(palette.GROUND)
    Sensors(pixels, count, room).draw(surface, middles)
    x, y = np.meshgrid(np.arange(30, 430), np.arange(20, 220), indexing="ij")
    nearest = np.min([np.hypot(x - mx, y - my) for mx, my in middles], axis=0)
    shown = pygame.surfarray.array3d(surface)[30:430, 20:220]
    assert (shown[nearest > pixels + 1] == palette.GROUND).all()
    inner, rim = shown[nearest < pixels - FINE - 1], shown[(nearest < pixels - 1) & (nearest > pixels - FINE + 1)]
    assert len(inner) > 1000 < 10 * len(rim)
    # A circle may be off by a pixel.
    fill, edge = np.median(inner, axis=0), np.median(rim, axis=0)
    assert (inner == fill).all(axis=1).mean() > 0.999
    assert (rim == edge).all(axis=1).mean() > 0.9
    assert edge.sum() < fill.sum() < sum(palette.GROUND)


@pytest.mark.parametrize("far", [1e3, 1e9, 1e30, 3e38])
def test_robots_and_targets_however_far_away(far):
    simulation, seen = world()
    renderer = Renderer(simulation.scenario)
    seen = with_one_target(seen, int(NEVER))
    plain = renderer.draw(seen)
    position = np.array(seen.position)
    position[:3, :2] = [[far, 0.0], [-far, far], [0.0, -far]]
    trail = np.arange(4), np.stack([seen.position[:, :2], position[:, :2], -position[:, :2], position[:, :2]])
    away = dataclasses.replace(
        seen,
        position=position,
        trail=trail,
        target_position=np.full_like(seen.target_position, far),
        contact=np.array([[0, 1], [3, 4], [2, 3]]),
    )
    picture = renderer.draw(away)
    assert count_near(picture[:, -30:], palette.ROBOT) > 30
    assert len(changed(plain, picture)) > 500
    assert count_near(picture, palette.TARGET) < count_near(plain, palette.TARGET)


@pytest.mark.parametrize("end", [pygame.quit, pygame.font.quit])
def test_pictures_after_something_else_has_ended_pygame(end):
    simulation, _ = world()
    renderer = Renderer(simulation.scenario)
    picture = renderer.draw(simulation)
    for begin in (lambda: None, pygame.font.init):
        end()
        begin()
        # The same words again, which are kept, and others, which are not.
        np.testing.assert_array_equal(renderer.draw(simulation), picture)
        np.testing.assert_array_equal(Renderer(simulation.scenario).draw(simulation), picture)
        simulation.step(np.zeros(simulation.action_shape, np.float32))
        renderer.reset()
        picture = renderer.draw(simulation)


@pytest.mark.parametrize("end", [pygame.quit, lambda: pygame.display.set_mode((30, 20))])
def test_a_window_is_opened_again_after_something_else_has_closed_it(end):
    env = lissajous_env.parallel_env("experiment", render_mode="human")
    env.reset(seed=0)
    end()
    env.step({agent: np.zeros(2, np.float32) for agent in env.agents})
    assert pygame.display.get_surface().get_size() == (988, 584)
    assert pygame.surfarray.array3d(pygame.display.get_surface()).std() > 5
    env.close()


@pytest.mark.parametrize("name", ["x" * 10**6, "a\0b\nc", "\ud800"])
def test_any_name_can_be_written(name):
    scenario = dataclasses.replace(lissajous_env.scenario("experiment"), name=name)
    assert Renderer(scenario).draw(lissajous_env.Simulation(scenario)).std() > 5
