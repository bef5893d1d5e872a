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
from lissajous_env.render.canvas import FINE, transparent
from lissajous_env.render.ground import draw_union
from lissajous_env.world.state import FAILED, NEVER, REMOVED

FREE = (0.9, 0.0)
"""Place without a curve, robots or targets in the first steps."""


def world(name="experiment", steps=3, **overrides) -> tuple[lissajous_env.Simulation, Snapshot]:
    simulation = lissajous_env.Simulation(lissajous_env.scenario(name, **overrides), seed=3)
    for _ in range(steps):
        simulation.step(np.zeros(simulation.action_shape, np.float32))
    return simulation, Snapshot.of(simulation)


def count_near(picture: np.ndarray, colour: tuple[int, int, int], tolerance: int = 40) -> int:
    return int((np.abs(picture.astype(int) - colour).max(axis=-1) < tolerance).sum())


def around(renderer: Renderer, seen: Snapshot, place, reach: int = 36) -> np.ndarray:
    """Return the part of the picture of a world around a place [m]."""
    picture = renderer.draw(seen)
    x, y = (int(coordinate) for coordinate in renderer.view.fine(np.asarray(place)) / FINE)
    return picture[max(y - reach, 0) : y + reach, max(x - reach, 0) : x + reach]


def with_one_target(seen: Snapshot, found_at: int) -> Snapshot:
    """The same world, with one target at a free place."""
    numbers = {"motion": np.array([2]), "appears_at": np.array([0]), "found_at": np.array([found_at])}
    return dataclasses.replace(seen, target_position=np.array([FREE]), found_early=np.zeros(1), **numbers)


def test_pettingzoo_contract():
    render_test(lissajous_env.env)
    assert not pygame.display.get_init()


@pytest.mark.parametrize("name", ["experiment", "knot", "swarm", "hall", "redundant", "watch"])
def test_scenarios_are_drawn(name):
    simulation, _ = world(name, steps=1)
    renderer = Renderer(simulation.scenario)
    picture = renderer.draw(simulation)
    width, height = renderer.view.size
    assert picture.shape == (height, width, 3)
    assert picture.dtype == np.uint8
    assert picture.flags.writeable
    assert count_near(picture, palette.ROBOT) > 100
    assert len(np.unique(picture @ [65536, 256, 1])) > 100
    # Any name can be written.
    for words in ("x" * 10**6, "a\0b\nc", "\ud800"):
        named = dataclasses.replace(simulation.scenario, name=words)
        assert Renderer(named, 0.3).draw(simulation).std() > 5


@pytest.mark.parametrize(("status", "colour"), [(FAILED, palette.FAILED), (REMOVED, palette.REMOVED)])
@pytest.mark.parametrize("name", ["experiment", "failure"])
def test_a_robot_is_drawn_where_it_is_and_a_fault_shows_there(name, status, colour):
    simulation, seen = world(name)
    renderer = Renderer(simulation.scenario)
    failed = np.array(seen.status)
    failed[0] = int(status)
    before = around(renderer, seen, seen.position[0, :2])
    after = around(renderer, dataclasses.replace(seen, status=failed), seen.position[0, :2])
    assert count_near(before, palette.ROBOT) > 200 > count_near(after, palette.ROBOT)
    assert count_near(after, colour) > count_near(before, colour) + 50


def test_a_target_is_red_flashes_when_detected_and_vanishes():
    simulation, seen = world(steps=12)
    renderer = Renderer(simulation.scenario)
    at_large, flash, vanished = (
        around(renderer, with_one_target(seen, found_at), FREE, 16)
        for found_at in (int(NEVER), seen.step - 2, seen.step - 11)
    )
    assert with_one_target(seen, int(NEVER)).mean_detection_time(step=0.1) == pytest.approx(1.2)
    assert count_near(at_large, palette.TARGET) > 20
    assert count_near(flash, palette.TARGET) == 0
    assert count_near(flash, palette.DETECTED, 90) > 10
    assert count_near(vanished, palette.DETECTED, 90) == count_near(vanished, palette.TARGET) == 0


def test_a_contact_is_ringed():
    simulation, seen = world()
    renderer = Renderer(simulation.scenario)
    before, after = (renderer.draw(dataclasses.replace(seen, contact=np.array(pairs))) for pairs in ([], [[0, 1]]))
    assert count_near(after, palette.CONTACT) > count_near(before, palette.CONTACT) + 200
    y, x = np.argwhere((after != before).any(axis=-1)).mean(axis=0)
    assert (x, y) == pytest.approx(renderer.view.fine(seen.position[:2, :2].mean(axis=0)) / FINE, abs=2)


def test_ground_darkens_where_it_was_not_sensed():
    simulation, seen = world(**{"sensing.radius": 0.05, "targets.count": 0, "targets.arrival_rate": 0})
    renderer = Renderer(simulation.scenario)
    x, y = (int(coordinate) for coordinate in renderer.view.fine(np.array(FREE)) / FINE)
    late = dataclasses.replace(seen, step=200)
    sensed = dataclasses.replace(late, sensed_at=np.full_like(seen.sensed_at, 200))
    # The lower half was sensed just now, the upper half never.
    half = np.where(np.arange(16)[:, None] < 8, 200, np.zeros_like(seen.sensed_at))
    lower = dataclasses.replace(late, sensed_at=half)
    pictures = [renderer.draw(snapshot)[:, x].astype(int).sum(axis=1) for snapshot in (late, sensed, lower)]
    assert pictures[0][y] < pictures[1][y]
    assert pictures[2][y - 60] < pictures[2][y + 60]


def test_discs_are_drawn_as_their_union():
    # Oracle: the distance to the nearest middle, pixel by pixel.
    middles, radius = np.random.default_rng(0).uniform([-50, -50], [450, 250], (30, 2)).round(), 60.0
    layer = transparent((400, 200))
    draw_union(layer, middles, radius)
    x, y = np.meshgrid(np.arange(400), np.arange(200), indexing="ij")
    nearest = np.min([np.hypot(x - mx, y - my) for mx, my in middles], axis=0)
    opacity = pygame.surfarray.array_alpha(layer)
    assert (opacity[nearest > radius + 1] == 0).all()
    inner, rim = opacity[nearest < radius - FINE - 1], opacity[(nearest < radius - 1) & (nearest > radius - FINE + 1)]
    assert len(inner) > 1000 < 10 * len(rim)
    # A circle may be off by a pixel.
    assert (inner == np.median(inner)).mean() > 0.999
    assert (rim == np.median(rim)).mean() > 0.9
    assert 0 < np.median(inner) < np.median(rim)


def test_trails_grow_with_time_and_are_forgotten():
    simulation, _ = world("failure", steps=0)
    renderer = Renderer(simulation.scenario)
    for _ in range(4):
        renderer.draw(simulation)
        simulation.step(np.full(simulation.action_shape, 0.3, np.float32))
    with_trail = renderer.draw(simulation)
    np.testing.assert_array_equal(renderer.draw(simulation), with_trail)
    trailing, other = Renderer(simulation.scenario), dataclasses.replace(Snapshot.of(simulation), seed=77, step=5)
    moved = np.array(other.position) + 0.3
    trailing.draw(simulation)
    away = dataclasses.replace(other, position=moved)  # of another episode, which does not draw on from the last one
    np.testing.assert_array_equal(trailing.draw(away), Renderer(simulation.scenario).draw(away))
    renderer.reset()
    assert (with_trail != renderer.draw(simulation)).any(axis=-1).sum() > 100


def test_drawing_changes_nothing_and_a_world_of_a_batch_looks_as_it_does_alone():
    drawn, plain, alone = (lissajous_env.Simulation("rough", worlds, seed=6 - worlds) for worlds in (2, 2, 1))
    np.testing.assert_array_equal(Renderer("rough").draw(drawn, world=1), Renderer("rough").draw(alone))
    renderer, rng = Renderer("rough", 0.3), np.random.default_rng(0)
    for _ in range(5):
        action = rng.uniform(-1, 1, drawn.action_shape).astype(np.float32)
        renderer.draw(drawn, world=1)
        for simulation in (drawn, plain):
            simulation.step(action)
        np.testing.assert_array_equal(drawn.observation.numpy(), plain.observation.numpy())
    assert str(drawn.score()) == str(plain.score())


@pytest.mark.parametrize("far", [30.0, 1e30, 3e38])
def test_robots_that_leave_the_picture_are_pointed_out_however_far_away(far):
    simulation, seen = world()
    renderer = Renderer(simulation.scenario)
    seen = with_one_target(seen, int(NEVER))
    renderer.draw(dataclasses.replace(seen, step=2))
    plain = renderer.draw(seen)
    position = np.array(seen.position)
    position[:3, :2] = [[far, 0.0], [-far, far], [0.0, -far]]
    contact = np.array([[0, 1], [3, 4], [2, 3]])
    away = {"position": position, "target_position": np.full_like(seen.target_position, far), "contact": contact}
    picture = renderer.draw(dataclasses.replace(seen, step=4, **away))
    assert count_near(picture[:, -30:], palette.ROBOT) > 30
    assert count_near(picture, palette.TARGET) < count_near(plain, palette.TARGET)


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
    action = {agent: np.zeros(2, np.float32) for agent in env.agents}
    assert "experiment" in pygame.display.get_caption()[0]
    # What else in the process closes or replaces it does not count.
    for end in (pygame.quit, lambda: pygame.display.set_mode((30, 20))):
        end()
        env.step(action)
        assert pygame.display.get_surface().get_size() == (988, 584)
        assert pygame.surfarray.array3d(pygame.display.get_surface()).std() > 5
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    for _ in range(2):
        env.step(action)
        assert not pygame.display.get_init()
    env.close()
    env.close()


@pytest.mark.parametrize("driver", [{"SDL_VIDEODRIVER": "no such driver"}, {}])
def test_window_without_a_display_is_refused_with_a_way_out(driver, monkeypatch):
    pygame.display.quit()
    monkeypatch.delenv("SDL_VIDEODRIVER")
    for name, value in {"DISPLAY": ":no", "WAYLAND_DISPLAY": "no", **driver}.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(OSError, match="rgb_array"):
        Renderer("experiment").show(10)


@pytest.mark.parametrize("end", [pygame.quit, pygame.font.quit])
def test_pictures_after_something_else_has_ended_pygame(end):
    simulation, _ = world()
    renderer = Renderer(simulation.scenario)
    picture = renderer.draw(simulation)
    end()
    np.testing.assert_array_equal(renderer.draw(simulation), picture)  # the same words
    simulation.step(np.zeros(simulation.action_shape, np.float32))
    assert (renderer.draw(simulation) != picture).any()  # others
