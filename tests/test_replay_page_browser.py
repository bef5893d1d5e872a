"""Replay pages in a real browser, Chromium without a window: they play, are scrubbed, pick robots, and ask nobody."""

import dataclasses
import json
import os
import shutil
import time

import numpy as np
import pytest

import baselines
import lissajous_env
from lissajous_env.episodes.recording import record
from lissajous_env.replay import Replay, page

if os.environ.get("CI"):
    from selenium import webdriver
else:
    webdriver = pytest.importorskip("selenium.webdriver")

HOSTILE = "</script><img src=x onerror=\"document.title='run'\"><script>document.title='run'</script>"
ROWS = "return [...document.querySelectorAll('.rows tr')].map((row) => [...row.cells].map((c) => c.textContent))"
EVADERS = {"task.duration": 8.0, "targets.arrival_rate": 2.0, "faults.schedule": ((2, 3.0, 5.0),)}


def browser_on_this_machine():
    paths = [shutil.which(name) for name in ("chromium", "chromium-browser", "google-chrome")]
    return next(filter(None, paths), None), shutil.which("chromedriver")


@pytest.fixture(scope="module")
def browser():
    program, driver = browser_on_this_machine()
    if program is None or driver is None:
        words = "Chromium and its driver are not installed (Debian: chromium, chromium-driver)"
        pytest.fail(words) if os.environ.get("CI") else pytest.skip(words)
    options = webdriver.ChromeOptions()
    options.binary_location = program
    for flag in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--enable-unsafe-swiftshader"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    browser = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    yield browser
    browser.quit()


def played(scenario, policy="kuramoto-mpcc", **overrides):
    made = lissajous_env.scenario(scenario, **overrides)
    return record(baselines.make(policy, made), made, 1)


@pytest.fixture(scope="module")
def recording():
    return played("evaders", **EVADERS)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("pages")


def opened(browser, folder, text, width=1280, dark=False):
    """Open a page at a width [px] and in a theme; returns a function that runs a script in it."""
    browser.get_log("browser"), browser.get_log("performance")
    metrics = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    features = [{"name": "prefers-color-scheme", "value": "dark" if dark else "light"}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    (folder / "page.html").write_text(text, encoding="utf-8")
    browser.get((folder / "page.html").as_uri())
    run = browser.execute_script
    wait(lambda: run("return document.body.dataset.ready === 'true' || !document.getElementById('notice').hidden"))
    assert run("return document.getElementById('notice').hidden"), run("return document.body.innerText")
    return run


def wait(until, seconds=20.0):
    deadline = time.monotonic() + seconds
    while not until():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def complaints(browser):
    """What the console said that is worse than a note on speed, and every address that was asked but the file's own."""
    said = [entry["message"] for entry in browser.get_log("browser") if "GPU stall" not in entry["message"]]
    sent = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    asked = [each["params"]["request"]["url"] for each in sent if each["method"] == "Network.requestWillBeSent"]
    return said, [address for address in asked if not address.endswith("/page.html")]


def press(browser, *keys):
    webdriver.ActionChains(browser).send_keys(*keys).perform()


def click(browser, x, y):
    """Click at a place of the window [px]."""
    chain = webdriver.ActionChains(browser)
    chain.w3c_actions.pointer_action.move_to_location(round(x), round(y))
    chain.click().perform()


def numbers(run, path):
    return np.array(run(f"return Array.from(replay.views[0].episode.{path})"))


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
    assert "robot 2 is stuck" in run("return document.getElementById('event').textContent")


def test_a_robot_that_is_clicked_shows_what_it_sees(browser, folder, recording):
    # Oracle: the recorded observation row and action of that robot at that moment, by the names of the layout.
    run = opened(browser, folder, page(recording))
    run("replay.player.seek(6.0)")
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
        "return replay.charts.map(({ head, plot }) => (head.getBoundingClientRect().left + 0.5"
        " - plot.over.getBoundingClientRect().left) / plot.over.clientWidth)"
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


def test_fifteen_robots_and_five_hundred_targets_play_smoothly(browser, folder):
    # Oracle: 60 pictures a second leave 16.7 ms for each; the middle one of many, as the machine has other work too.
    overrides = {"targets.count": 500, "sensing.radius": 0.4, "task.duration": 8.0}
    run = opened(browser, folder, page(played("team", **overrides)))
    run("replay.select(3); replay.player.toggle(true)")
    wait(lambda: run("return replay.player.frames.length") > 60)
    frames = run("return replay.player.frames")
    assert np.median(frames) < 16.7
    assert complaints(browser) == ([], [])


def test_the_knot_stands_in_space(browser, folder):
    recording = played("knot", "kuramoto", **{"task.duration": 3.0, "faults.schedule": ((0, 1.0, 2.0),)})
    run = opened(browser, folder, page(recording))
    assert run("return replay.views[0].stage.constructor.name") == "Space"
    run("replay.player.seek(1.5)")
    # Oracle: the projection of the recorded place of robot 2; a click there picks it.
    at = run(
        "const { stage, canvas } = replay.views[0], p = stage.robots[2].ball.position.clone().project(stage.camera);"
        "return [p.x, p.y, canvas.clientWidth, canvas.clientHeight, ...stage.robots[2].ball.position.toArray()]"
    )
    np.testing.assert_allclose(at[4:], recording.position[15, 2], atol=1e-4)
    assert run(f"return replay.views[0].stage.pick({(at[0] + 1) / 2 * at[2]}, {(1 - at[1]) / 2 * at[3]})") == 2
    said, asked = complaints(browser)
    assert [words for words in said if "WebGL" not in words] == []
    assert asked == []


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
