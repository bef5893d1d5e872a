"""Replay pages in headless Chromium: playing, scrubbing, selecting robots, zoom, addresses, no network access."""

import dataclasses
import time

import numpy as np
import pytest
from browser import (
    HOSTILE,
    ROWS,
    click,
    complaints,
    drag,
    hostile,
    middle,
    numbers,
    opened,
    place_of,
    played,
    press,
    turn_wheel,
    wait,
    webdriver,
)

import baselines
import lissajous_env
from lissajous_env.episodes.missed import missed_rogue
from lissajous_env.episodes.recording import record
from lissajous_env.replay import Replay


@pytest.fixture(scope="module")
def one(browser, folder, recording):
    """Return a function that runs a script in the page of one episode."""
    return opened(browser, folder, Replay(recording).html())


def test_the_page_unpacks_what_was_recorded(browser, one, recording):
    # Oracle: the recording; to the precision that is stated.
    f, n = recording.heading.shape
    for k, name in enumerate("xy"):
        places = numbers(one, f"robots.{name}").reshape(n, f).T
        np.testing.assert_allclose(places, recording.position[..., k], atol=np.ptp(places) / 65_535)
    turned = numbers(one, "robots.heading").reshape(n, f).T - recording.heading
    assert np.abs(np.angle(np.exp(1j * turned))).max() < 2 * np.pi / 65_536
    np.testing.assert_array_equal(numbers(one, "robots.status").reshape(n, f).T, recording.status)
    np.testing.assert_array_equal(numbers(one, "raw.collisions"), recording.collisions)
    scored = recording.score["guaranteed_detection_time"]
    assert numbers(one, "ground.age[0]").max() == pytest.approx(scored, abs=1e-3)
    scores = dict(one(ROWS))
    assert float(scores["collisions"]) == recording.score["collisions"]
    assert float(scores["guaranteed detection time"]) == pytest.approx(scored)
    seen = one("return replay.views[0].episode.events.filter((e) => e.kind === 'detection').length")
    assert seen == np.count_nonzero(recording.found_at < f)
    # The charts state the numbers of the moment, and their bounds.
    one("replay.player.seek(replay.duration)")
    reading = lambda name: one(f"return document.querySelector('[data-chart={name}] .reading').innerText")  # noqa: E731
    assert f"collisions {recording.score['collisions']:.0f}" in reading("collisions")
    assert f"detected {seen}" in reading("detections")
    assert "2 r_s (discs part) 1.20" in reading("distances")
    total = float(one("return replay.charts.find((c) => c.chart.id === 'reward').chart.series[0].values.at(-1)"))
    assert total == pytest.approx(recording.reward_terms.sum(axis=-1).mean(axis=1).sum(), abs=2e-3)
    bound = recording.scenario.detection_time_bound
    assert f"{1.25 * bound:.3g} s or more" in one("return document.querySelector('.legend').textContent")
    assert one("return replay.views[0].stage.ground.full('idle')") == recording.duration < 2 * bound
    assert complaints(browser) == ([], [])


def test_it_plays_pauses_and_goes_where_it_is_told(browser, one, recording):
    now = lambda: one("return replay.player.time")  # noqa: E731
    one("replay.player.seek(0); document.getElementById('play').click()")
    wait(lambda: now() > 0.5)
    assert one("return document.getElementById('play').getAttribute('aria-label')") == "Pause"
    one("document.activeElement.blur()")
    press(browser, " ")
    stopped = now()
    time.sleep(0.15)
    assert now() == stopped
    one("const s = document.getElementById('scrub'); s.value = 4.2; s.dispatchEvent(new Event('input'))")
    assert now() == pytest.approx(4.2)
    assert one("return document.getElementById('now').textContent") == "4.2"
    press(browser, webdriver.Keys.ARROW_RIGHT)
    assert now() == pytest.approx(4.3)
    one("replay.player.seek(0)")
    press(browser, "]")
    assert now() == pytest.approx(one("return replay.timeline.all.find((event) => event.time > 0.001).time"))
    # At its end it begins anew.
    one("replay.player.seek(replay.duration); document.getElementById('play').click()")
    wait(lambda: 0 < now() < 2)
    one("replay.player.toggle(false)")
    # Story: robot 2 is stuck from 3 s on, first seen after the step; a click near that mark goes there and picks it.
    x, y = one(
        "const t = replay.timeline, row = t.rows.findIndex((r) => r.kind === 'fault');"
        "const box = document.getElementById('timeline').getBoundingClientRect();"
        "return [box.left + t.x(3.1) + 3, box.top + 4 + 12 * row + 5]"
    )
    click(browser, x, y)
    assert now() == pytest.approx(3.1)
    assert one("return replay.selected") == 2
    assert "robot 2 has failed" in one("return document.getElementById('event').textContent")
    for key, robot in (("r", 3), (webdriver.Keys.ESCAPE, -1), ("r", 0), (webdriver.Keys.ESCAPE, -1)):
        press(browser, key)
        assert one("return replay.selected") == robot
    assert complaints(browser) == ([], [])


def test_a_robot_that_is_clicked_shows_what_it_sees(browser, one, recording):
    # Oracle: the recorded observation row and action of that robot at that moment, by the names of the layout.
    one("replay.player.seek(6.0); replay.steer((stage) => stage.zoomBy(0.5))")  # robot 3 is far outside
    click(browser, *place_of(one, 3))
    assert one("return replay.selected") == 3
    rows = one(ROWS)
    action, observed = [row for row in rows if row[0] == ""], [row for row in rows if row[0].isdecimal()]
    np.testing.assert_allclose([float(row[2]) for row in action], recording.action[61, 3], atol=1e-3)
    np.testing.assert_allclose([float(row[2]) for row in observed], recording.observation[60, 3], atol=1e-3)
    assert [row[1] for row in observed] == [name.replace("_", " ") for name in recording.observation_names]
    one("replay.steer((stage) => stage.camera.whole()); replay.select(-1)")
    assert complaints(browser) == ([], [])


def test_an_address_names_the_moment_and_the_robot(browser, one, folder, recording):
    address = (folder / "page.html").as_uri()
    one("replay.player.seek(4.2); replay.select(3)")
    wait(lambda: one("return location.href") == f"{address}#t=4.2&robot=3")
    # While it plays the address stays.
    one("replay.select(-1); replay.player.toggle(true)")
    wait(lambda: one("return replay.player.time") > 4.8)
    assert one("return location.hash") == "#t=4.2&robot=3"
    one("replay.player.toggle(false)")
    one("location.hash = '#t=5.1&robot=1'")
    wait(lambda: one("return replay.player.time") == 5.1)
    one("location.hash = '#t=1e9&robot=99'")
    wait(lambda: one("return replay.player.time") == recording.duration)
    assert one("return replay.selected") == 1
    browser.get("about:blank")
    browser.get(f"{address}#t=2&robot=4")
    wait(lambda: one("return document.body.dataset.ready === 'true'"))
    assert one("return [replay.player.time, replay.selected]") == [2, 4]
    assert complaints(browser) == ([], [])


def test_charts_leave_out_robots_that_were_removed_and_those_that_share_a_place(browser, folder):
    # Oracle: the columns of the score, which leave them out. A robot that was removed loses no messages.
    fields = {"robot.count": 6, "formation.alpha": 2, "faults.removed": ((0, 1.0),), "faults.schedule": ()}
    recording = played("failure", "kuramoto", **fields, **{"task.duration": 3.0})
    run = opened(browser, folder, Replay(recording).html())
    charts = dict(run("return replay.charts.map(({ chart }) => [chart.id, chart.series.map((s) => [...s.values])])"))
    largest = np.nanmax(np.abs(np.array(charts["phases"], float)))
    assert largest == pytest.approx(recording.score["phase_error"], abs=1e-3)
    assert 0 < min(charts["collisions"][1]) - recording.score["min_separation"] < 0.1
    assert not run("return replay.episodes[0].losesMessages")


def test_the_rogue_that_a_policy_misses_is_drawn_where_it_is(browser, folder):
    # Oracle: the missed rogue, and the colour of the page's own legend at the rogue's place.
    scenario = lissajous_env.scenario("evaders", **{"task.duration": 8.0})
    policy = baselines.make("kuramoto-mpcc", scenario)
    rogue = missed_rogue(policy, scenario, 1)
    run = opened(browser, folder, Replay(record(policy, scenario, 1), missed=rogue).html())
    (event,) = run("return replay.views[0].episode.events.filter((each) => each.kind === 'rogue')")
    assert event["time"] == pytest.approx(rogue.appears)
    assert event["until"] - event["time"] == pytest.approx(rogue.undetected, abs=1e-3)
    assert "the rogue that this policy misses" in run("return document.querySelector('.legend').textContent")
    half = len(rogue.path.places) // 2
    x, y = rogue.path.places[half].tolist()
    run(f"replay.player.seek({rogue.appears + half * scenario.task.step})")
    pixel = run(
        f"const {{ stage }} = replay.views[0], at = [stage.px({x}), stage.py({y})].map((each) => each * stage.ratio);"
        "return [...stage.context.getImageData(Math.round(at[0]), Math.round(at[1]), 1, 1).data]"
    )
    colour = run("return getComputedStyle(document.documentElement).getPropertyValue('--unseen')")
    assert pixel[:3] == [int(colour[k : k + 2], 16) for k in (1, 3, 5)]
    assert complaints(browser) == ([], [])


def test_two_episodes_share_time_scale_and_camera(browser, folder, recording):
    # Oracle: what is under the pointer stays there; a drag moves everything by as much as the pointer.
    run = opened(browser, folder, Replay(recording, recording).html())
    run("replay.player.seek(2)")
    whole, other = ([place_of(run, k, view) for k in range(5)] for view in (0, 1))
    apart = other[0] - whole[0]
    heads = run(
        "return replay.charts.map(({ head, over }) => (head.getBoundingClientRect().left + 0.5"
        " - over.getBoundingClientRect().left) / over.clientWidth)"
    )
    np.testing.assert_allclose(heads, 2 / recording.duration, atol=0.005)
    turn_wheel(browser, whole[3], -600)
    wait(lambda: run("return replay.camera.zoom") > 2)
    zoom = run("return replay.camera.zoom")
    np.testing.assert_allclose(place_of(run, 3), whole[3], atol=zoom)
    np.testing.assert_allclose(place_of(run, 1), whole[3] + zoom * (whole[1] - whole[3]), atol=zoom)
    np.testing.assert_allclose(place_of(run, 0, view=1) - place_of(run, 0), apart, atol=0.01)
    x, y, _ = middle(run)
    before = place_of(run, 3)
    drag(browser, x, y, -40, 25)
    np.testing.assert_allclose(place_of(run, 3) - before, [-40, 25], atol=0.5)
    assert run("return replay.selected") == -1  # a drag is no click
    for look in ("whole", "closer", "farther"):
        run(f"document.querySelector('[data-look={look}]').click()")
    np.testing.assert_allclose([place_of(run, k) for k in range(5)], whole, atol=0.01)
    # Of the whole picture the wheel shows no more: the page scrolls.
    turn_wheel(browser, place_of(run, 3), 300)
    wait(lambda: run("return scrollY") > 100)
    assert run("return replay.camera.isWhole")
    assert complaints(browser) == ([], [])


@pytest.mark.parametrize(("half_width", "half_height"), [(1.5, 4.0), (20.0, 12.5)], ids=["tall", "hall"])
def test_the_rectangle_fills_the_picture_on_phones_and_screens(browser, folder, recording, half_width, half_height):
    scenario = lissajous_env.scenario("intruders", **{"curve.half_width": half_width, "curve.half_height": half_height})
    position = recording.position * np.float32(min(half_width, half_height))
    position[-1, 0, :2] = 1.4 * half_width, 1.4 * half_height  # a robot that was outside for a moment
    moved = dataclasses.replace(recording, scenario=scenario.resolve(), position=position)
    run = opened(browser, folder, Replay(moved).html())
    for width in (1280, 390):
        metrics = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
        run("replay.resize()")
        (_, high), (_, canvas) = run(
            "const { stage } = replay.views[0], [, , wide, high] = stage.rectangle();"
            "return [[wide, high], [stage.width, stage.height]]"
        )
        assert high > 0.7 * canvas
        # The picture is on the screen as a whole, above the player; nothing is wider than its card.
        assert canvas < run("return innerHeight - document.querySelector('.transport').offsetHeight")
        assert run("return document.documentElement.scrollWidth") <= width
        fits = "(box) => box.scrollWidth <= box.clientWidth + 1"
        assert run(f"return [...document.querySelectorAll('.card')].every({fits})")
        assert run("return [...document.querySelectorAll('button')].every((b) => b.textContent.trim() || b.ariaLabel)")
        # Beside a high picture stand the charts, where the screen is wide.
        left, right = run(
            "const boxes = ['episodes', 'charts'].map((id) => document.getElementById(id).getBoundingClientRect());"
            "return [boxes[0].right, boxes[1].left]"
        )
        assert (left < right) == (width == 1280 and half_width < half_height)


def test_nothing_of_a_hostile_recording_is_run(browser, folder, recording):
    # Story: names that would be script, places beyond all bounds; the page shows the words and plays on.
    run = opened(browser, folder, Replay(hostile(recording, HOSTILE)).html())
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


def test_a_scaled_episode_looks_the_same(browser, folder, recording):
    # Oracle: the picture of the episode that was not scaled; factors that are powers of two change no rounding.
    length, duration = 0.125, 4.0
    fields = {name: getattr(recording, name) * np.float32(length) for name in ("position", "target_position")}
    fields |= {"speed": recording.speed * length / duration, "scenario": recording.scenario.scaled(length, duration)}
    pictures = []
    for episode, factor in ((recording, 1), (dataclasses.replace(recording, **fields), duration)):
        run = opened(browser, folder, Replay(episode).html())
        run(f"replay.select(2); replay.player.seek({4.2 * factor})")
        press(browser, "]")
        pictures.append(run("return replay.views[0].canvas.toDataURL()"))
    assert pictures[0] == pictures[1]


def test_a_notebook_shows_it_in_a_frame_of_its_own(browser, folder, recording):
    # Story: a notebook puts what the object returns into a page of its own; the frame plays, and cannot reach out.
    (folder / "notebook.html").write_text(f"<body>{Replay(recording)._repr_html_()}</body>", encoding="utf-8")
    browser.get((folder / "notebook.html").as_uri())
    browser.switch_to.frame(0)
    wait(lambda: browser.execute_script("return document.body.dataset.ready === 'true'"))
    browser.execute_script("document.getElementById('play').click()")
    wait(lambda: browser.execute_script("return replay.player.time") > 0.2)
    assert browser.execute_script("return self.origin") == "null"
    browser.switch_to.default_content()
    assert browser.execute_script("return document.body.dataset.ready") is None
