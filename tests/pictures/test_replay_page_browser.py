"""Replay pages in headless Chromium: playing, scrubbing, selecting robots, no network access."""

import dataclasses
import json
import time

import numpy as np
import pytest
from browser import HOSTILE, ROWS, click, complaints, numbers, opened, press, wait, webdriver

import baselines
import lissajous_env
from lissajous_env.episodes.missed import missed_rogue
from lissajous_env.episodes.missed.replayed import record_again
from lissajous_env.replay import page


def test_the_page_unpacks_what_was_recorded(browser, folder, recording):
    # Oracle: the recording; to the precision that is stated.
    run = opened(browser, folder, page(recording))
    f, n = recording.heading.shape
    for k, name in enumerate("xy"):
        places = numbers(run, f"robots.{name}").reshape(n, f).T
        np.testing.assert_allclose(places, recording.position[..., k], atol=np.ptp(places) / 65_535)
    turned = numbers(run, "robots.heading").reshape(n, f).T - recording.heading
    assert np.abs(np.angle(np.exp(1j * turned))).max() < 2 * np.pi / 65_536
    np.testing.assert_array_equal(numbers(run, "robots.status").reshape(n, f).T, recording.status)
    np.testing.assert_array_equal(numbers(run, "collisions"), recording.collisions)
    scored = recording.score["guaranteed_detection_time"]
    assert numbers(run, "ground.ageWorst").max() == pytest.approx(scored, abs=1e-3)
    scores = dict(
        run("return [...document.querySelectorAll('.rows tr')].map((r) => [...r.cells].map((c) => c.innerText))")
    )
    assert float(scores["collisions"]) == recording.score["collisions"]
    assert float(scores["guaranteed detection time"]) == pytest.approx(recording.score["guaranteed_detection_time"])
    run("replay.player.seek(replay.duration)")
    tiles = run("return [...document.querySelectorAll('.tile b')].map((tile) => tile.textContent)")
    assert float(tiles[1].split()[0]) == pytest.approx(recording.score["detection_time_mean"], abs=6e-4)
    found = recording.found_at < f
    seen = run(
        "const { episode } = replay.views[0]; return episode.events.filter((e) => e.kind === 'detection').length"
    )
    assert seen == np.count_nonzero(found)
    assert complaints(browser) == ([], [])


def test_the_rogue_that_a_policy_misses_is_drawn_where_it_is(browser, folder):
    # Oracle: the witness, and the colour of the page's own legend at the rogue's place.
    made = lissajous_env.scenario("evaders", **{"task.duration": 8.0})
    found = missed_rogue(baselines.make("kuramoto-mpcc", made), made, 1)
    run = opened(browser, folder, page(record_again(found.played, found.policy), missed=found))
    (event,) = run("return replay.views[0].episode.events.filter((each) => each.kind === 'rogue')")
    assert event["time"] == pytest.approx(found.appears)
    assert event["until"] - event["time"] == pytest.approx(found.undetected, abs=1e-3)
    assert "the rogue that this policy misses" in run("return document.querySelector('.legend').textContent")
    middle = len(found.path.places) // 2
    x, y = found.path.places[middle].tolist()
    run(f"replay.player.seek({found.appears + middle * made.task.step})")
    pixel = run(
        f"const {{ stage }} = replay.views[0], at = [stage.px({x}), stage.py({y})].map((each) => each * stage.ratio);"
        "return [...stage.context.getImageData(Math.round(at[0]), Math.round(at[1]), 1, 1).data]"
    )
    colour = run("return replay.viewing.colours.unseen")
    assert pixel[:3] == [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    assert complaints(browser) == ([], [])


def test_it_plays_pauses_and_goes_where_it_is_told(browser, folder, recording):
    run = opened(browser, folder, page(recording))
    now = lambda: run("return replay.player.time")  # noqa: E731
    run("document.getElementById('play').click()")
    wait(lambda: now() > 0.5)
    assert run("return document.getElementById('play').getAttribute('aria-label')") == "Pause"
    press(browser, " ") if run("document.activeElement.blur(); return true") else None
    stopped = now()
    time.sleep(0.15)
    assert now() == stopped
    run("const s = document.getElementById('scrub'); s.value = 4.2; s.dispatchEvent(new Event('input'))")
    assert now() == pytest.approx(4.2)
    assert run("return document.getElementById('now').textContent") == "4.2"
    keys = webdriver.Keys
    press(browser, keys.ARROW_RIGHT)
    assert now() == pytest.approx(4.3)
    press(browser, keys.HOME)
    assert now() == 0
    press(browser, "]")
    first = run("return replay.timeline.all.find((event) => event.time > 0.001).time")
    assert now() == pytest.approx(first)
    press(browser, keys.END)
    assert now() == pytest.approx(recording.duration)
    # At its end it begins anew.
    run("document.getElementById('play').click()")
    wait(lambda: 0 < now() < 2)
    assert complaints(browser) == ([], [])


def test_a_mark_on_the_timeline_is_gone_to(browser, folder, recording):
    # Story: robot 2 is stuck from 3 s on, first seen after the step; a click near that mark goes there and picks it.
    run = opened(browser, folder, page(recording))
    x, y = run(
        "const t = replay.timeline, row = t.rows.findIndex((r) => r.kind === 'fault');"
        "const box = document.getElementById('timeline').getBoundingClientRect();"
        "return [box.left + t.x(3.1) + 3, box.top + 4 + 11 * row + 5]"
    )
    click(browser, x, y)
    assert run("return replay.player.time") == pytest.approx(3.1)
    assert run("return replay.selected") == 2
    assert "robot 2 has failed" in run("return document.getElementById('event').textContent")


def test_a_robot_that_is_clicked_shows_what_it_sees(browser, folder, recording):
    # Oracle: the recorded observation row and action of that robot at that moment, by the names of the layout.
    run = opened(browser, folder, page(recording))
    run("replay.player.seek(6.0); replay.steer((stage) => stage.zoomBy(0.5))")  # robot 3 is far outside
    x, y = run(
        "const { stage, canvas } = replay.views[0], box = canvas.getBoundingClientRect();"
        "return [box.left + stage.nearest[3].x, box.top + stage.nearest[3].y]"
    )
    click(browser, x, y)
    assert run("return replay.selected") == 3
    rows = run(ROWS)
    action, observed = [r for r in rows if r[0] == ""], [r for r in rows if r[0].isdecimal()]
    np.testing.assert_allclose([float(r[2]) for r in action], recording.action[61, 3], atol=1e-3)
    assert [int(r[0]) for r in observed] == list(range(len(recording.observation_names)))
    np.testing.assert_allclose([float(r[2]) for r in observed], recording.observation[60, 3], atol=1e-3)
    for name, row in zip(recording.observation_names, observed, strict=True):
        assert name.replace("_", " ").endswith(row[1])
    heads = run("return [...document.querySelectorAll('.rows .group')].map((row) => row.textContent)")
    assert heads[:3] == ["itself", "neighbour 0", "neighbour 1"]
    press(browser, webdriver.Keys.ESCAPE)
    assert run("return replay.selected") == -1
    assert complaints(browser) == ([], [])


@pytest.mark.parametrize("dark", [False, True])
@pytest.mark.parametrize("width", [390, 1280])
def test_it_fits_phones_and_screens_in_light_and_dark(browser, folder, recording, width, dark):
    run = opened(browser, folder, page(recording, recording), width, dark)
    assert run("return document.documentElement.scrollWidth") <= width
    paper = "return getComputedStyle(document.body).backgroundColor"
    brightness = lambda: sum(json.loads("[" + run(paper)[4:-1] + "]"))  # noqa: E731
    assert (brightness() < 150) == dark
    run("document.getElementById('theme').click()")
    assert (brightness() < 150) != dark
    # Everything that is said is as wide as its card at most, and every button says what it does.
    assert run("return [...document.querySelectorAll('.card')].every((box) => box.scrollWidth <= box.clientWidth + 1)")
    assert run("return [...document.querySelectorAll('button')].every((b) => b.textContent.trim() || b.ariaLabel)")
    # Two episodes, one cursor: the same robots, in pictures of one scale.
    assert run("replay.player.seek(2); return replay.views.map((view) => view.stage.scale)")[0] > 0
    places = run("return replay.views.map((view) => view.stage.nearest.map((place) => [place.x, place.y]))")
    np.testing.assert_allclose(places[0], places[1], atol=0.01)
    heads = run(
        "return replay.charts.map(({ head, over }) => (head.getBoundingClientRect().left + 0.5"
        " - over.getBoundingClientRect().left) / over.clientWidth)"
    )
    np.testing.assert_allclose(heads, 2 / recording.duration, atol=0.005)
    assert complaints(browser) == ([], [])


def test_nothing_of_a_hostile_recording_is_run(browser, folder, recording):
    # Story: names that would be script, places beyond all bounds; the page shows the words and plays on.
    position = recording.position.copy()
    position[10:30] *= np.float32(1e30)
    scenario = dataclasses.replace(recording.scenario, name=HOSTILE, description=HOSTILE)
    names = (HOSTILE, *recording.observation_names[1:])
    score = recording.score | {"policy": HOSTILE, "return_mean": float("nan")}
    odd = dataclasses.replace(recording, position=position, scenario=scenario, score=score, observation_names=names)
    run = opened(browser, folder, page(odd))
    run("replay.select(1); replay.player.seek(2.05); replay.player.toggle(true)")
    wait(lambda: run("return replay.player.time") > 3)
    assert run("return document.querySelectorAll('img').length") == 0
    assert run("return document.title") != "run"
    assert HOSTILE in run("return document.getElementById('name').textContent")
    # Even what is written into the page later does not run: its policy allows the bundled scripts alone.
    run("document.body.insertAdjacentHTML('beforeend', '<img src=x onerror=\"document.title=1\">')")
    time.sleep(0.1)
    assert run("return document.title") != "1"
    said, asked = complaints(browser)
    assert all("Content Security Policy" in words or "ERR_FILE_NOT_FOUND" in words for words in said)
    assert [address for address in asked if address.startswith("http")] == []
