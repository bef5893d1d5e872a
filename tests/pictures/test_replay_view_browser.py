"""Pictures of replay pages in headless Chromium: zoom, links, labels, scaled episodes, notebooks."""

import dataclasses

import numpy as np
import pytest
from browser import (
    click,
    complaints,
    drag,
    middle,
    opened,
    pinch,
    place_of,
    played,
    press,
    turn_wheel,
    wait,
    webdriver,
)

from lissajous_env.replay import Replay, page


def test_the_picture_is_zoomed_and_moved(browser, folder, recording):
    # Oracle: what is under the pointer stays there; a drag moves everything by as much as the pointer.
    run = opened(browser, folder, page(recording, recording))
    run("replay.player.seek(2)")
    whole = [place_of(run, k) for k in range(5)]
    assert run("return replay.camera.isWhole")
    turn_wheel(browser, whole[3], -600)
    wait(lambda: run("return replay.camera.zoom") > 2)
    zoom = run("return replay.camera.zoom")
    np.testing.assert_allclose(place_of(run, 3), whole[3], atol=zoom)
    np.testing.assert_allclose(place_of(run, 1), whole[3] + zoom * (whole[1] - whole[3]), atol=zoom)
    # Side by side they show the same part.
    apart = place_of(run, 3, view=1) - place_of(run, 3)
    np.testing.assert_allclose(place_of(run, 0, view=1) - place_of(run, 0), apart, atol=0.01)
    x, y, _ = middle(run)
    before = place_of(run, 3)
    drag(browser, x, y, -40, 25)
    np.testing.assert_allclose(place_of(run, 3) - before, [-40, 25], atol=0.5)
    assert run("return replay.selected") == -1  # a drag is no click
    click(browser, *place_of(run, 3))
    assert run("return replay.selected") == 3
    # Keys: closer, to the right, the whole; and never out of the world.
    press(browser, "+")
    assert run("return replay.camera.zoom") == pytest.approx(1.5 * zoom)
    before = place_of(run, 3)
    press(browser, "d")
    assert place_of(run, 3)[0] < before[0] - 20
    press(browser, "v")
    np.testing.assert_allclose([place_of(run, k) for k in range(5)], whole, atol=0.01)
    for _ in range(40):
        press(browser, "d")
    assert abs(run("return replay.camera.x")) <= run("return replay.views[0].stage.extent[0]")
    run("document.querySelector('[data-look=whole]').click()")
    run("document.querySelector('[data-look=closer]').click(); document.querySelector('[data-look=farther]').click()")
    assert run("return replay.camera.isWhole")
    # Of the whole picture the wheel shows no more: the page scrolls.
    turn_wheel(browser, place_of(run, 3), 300)
    wait(lambda: run("return scrollY") > 100)
    assert run("return replay.camera.isWhole")
    assert complaints(browser) == ([], [])


def test_two_fingers_zoom_and_one_moves_what_is_zoomed(browser, folder, recording):
    run = opened(browser, folder, page(recording), width=390)
    browser.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": True, "maxTouchPoints": 2})
    assert run("return replay.views[0].canvas.style.touchAction") == "pan-y"  # one finger scrolls the page
    x, y, _ = middle(run)
    pinch(browser, x, y, [60, 80, 100, 120, 150])
    assert run("return replay.camera.zoom") == pytest.approx(150 / 60, rel=0.05)
    assert run("return replay.views[0].canvas.style.touchAction") == "none"
    before = place_of(run, 2)
    for kind, right in [("touchStart", 0), ("touchMove", 10), ("touchMove", 30), ("touchEnd", None)]:
        fingers = [] if right is None else [{"x": x + right, "y": y, "id": 0}]
        browser.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": kind, "touchPoints": fingers})
    np.testing.assert_allclose(place_of(run, 2) - before, [30, 0], atol=1)
    pinch(browser, x, y, [200, 150, 100, 60, 30, 15])
    assert run("return replay.camera.zoom") < 1  # farther than the rectangle: who has left it is seen
    browser.execute_cdp_cmd("Emulation.setTouchEmulationEnabled", {"enabled": False})
    assert complaints(browser) == ([], [])


def test_a_link_leads_to_a_moment_and_a_robot(browser, folder, recording):
    run = opened(browser, folder, page(recording))
    address = (folder / "page.html").as_uri()
    assert run("return location.href") == address
    run("replay.player.seek(4.2); replay.select(3)")
    wait(lambda: run("return location.hash") == "#t=4.2&robot=3")
    press(browser, webdriver.Keys.ESCAPE)
    wait(lambda: run("return location.hash") == "#t=4.2")
    # While it plays the address stays; where it is paused the address follows.
    run("replay.player.toggle(true)")
    wait(lambda: run("return replay.player.time") > 4.8)
    assert run("return location.hash") == "#t=4.2"
    run("replay.player.toggle(false); replay.player.seek(5.1); replay.select(1)")
    browser.execute_cdp_cmd("Browser.grantPermissions", {"permissions": ["clipboardReadWrite"]})
    press(browser, "l")
    wait(lambda: run("return document.getElementById('link').textContent") == "Copied")
    copied = browser.execute_async_script("navigator.clipboard.readText().then(arguments[0])")
    assert copied == f"{address}#t=5.1&robot=1"
    for end, time_, robot in [
        ("#t=5.1&robot=1", 5.1, 1),
        ("#robot=4", 0, 4),
        ("#t=1e9", recording.duration, -1),
        ("#t=no&robot=99", 0, -1),
        ("#robot=-1&t=-3", 0, -1),
    ]:
        browser.get("about:blank")
        browser.get(address + end)
        wait(lambda: run("return document.body.dataset.ready === 'true'"))
        assert run("return [replay.player.time, replay.selected]") == [pytest.approx(time_), robot]
    run("location.hash = '#t=2&robot=0'")
    wait(lambda: run("return replay.selected") == 0)
    assert run("return replay.player.time") == 2
    assert complaints(browser) == ([], [])


@pytest.mark.parametrize(
    ("half_width", "half_height"), [(1.35, 0.6), (1.5, 4.0), (20.0, 12.5)], ids=["experiment", "tall", "hall"]
)
def test_the_rectangle_fills_the_picture(browser, folder, half_width, half_height):
    sides = {"curve.half_width": half_width, "curve.half_height": half_height, "robot.radius": 0.05 * half_width}
    kept = played("intruders", "still", **sides, **{"task.duration": 2.0})
    position = kept.position.copy()
    position[-1, 0, :2] = 1.4 * half_width, 1.4 * half_height  # a robot that was outside for a moment
    text = page(dataclasses.replace(kept, position=position))
    for width in (390, 1280):
        run = opened(browser, folder, text, width)
        shown, canvas = run(
            "const { stage } = replay.views[0], [, , wide, high] = stage.rectangle();"
            "return [[wide, high], [stage.width, stage.height]]"
        )
        assert shown[1] > 0.7 * canvas[1]
        assert width == 1280 or half_width < half_height or shown[0] > 0.75 * canvas[0]
        # The picture is on the screen as a whole, above the player.
        assert canvas[1] < run("return innerHeight - document.querySelector('.transport').offsetHeight")
        assert run("return document.documentElement.scrollWidth") <= width
        # Beside a high picture stand the charts, where the screen is wide.
        left, right = run(
            "const boxes = ['episodes', 'charts'].map((id) => document.getElementById(id).getBoundingClientRect());"
            "return [boxes[0].right, boxes[1].left]"
        )
        assert (left < right) == (width == 1280 and half_width < half_height)


def test_what_is_beyond_the_colours_is_said(browser, folder, recording):
    # Story: nobody moves, so that an age grows until the end, beyond what the colours tell apart.
    kept = played("evaders", "still", **{"task.duration": 40.0})
    words = "return document.querySelector('.sign.ramp').parentElement.textContent"
    run = opened(browser, folder, page(kept))
    scale = run("return replay.views[0].stage.ground.scales.unseen")
    assert scale["most"] == pytest.approx(kept.score["guaranteed_detection_time"], abs=0.3)
    assert scale["most"] > 1.02 * scale["full"] > 0
    assert run(words).endswith(f"and more (longest {scale['most']:.2g} s)")
    # Side by side both have the wider scale; where nothing is beyond it, nothing is said.
    run = opened(browser, folder, page(recording, kept))
    assert run("return replay.views[0].stage.ground.scales") == run("return replay.views[1].stage.ground.scales")
    run("replay.lay('idle')")
    scale = run("return replay.views[0].stage.ground.scales.idle")
    assert ("and more" in run(words)) == (scale["most"] > 1.02 * scale["full"])


def test_no_label_covers_another(browser, folder, recording):
    # Story: five robots on one heap; their numbers stand around it. Bounds are named above their chart, not in it.
    heap = recording.position.copy()
    heap[:, :, :2] = np.array([[0, 0], [0.05, 0.02], [0.1, 0.0], [0.03, -0.06], [0.08, -0.05]])
    run = opened(browser, folder, page(dataclasses.replace(recording, position=heap)))
    boxes = np.array(
        run(
            "const { labels, body, width, height, nearest } = replay.views[0].stage;"
            "return labels.place(nearest.map((place, i) => ({ i, ...place })), body, width, height)"
        )
    )
    apart = np.abs(boxes[:, None] - boxes[None])
    clear = (apart[..., 0] >= 9) | (apart[..., 1] >= 12.9)
    assert clear[~np.eye(5, dtype=bool)].all()
    run = opened(browser, folder, page(recording))
    named = run("return document.querySelector('[data-chart=distances] .reading').innerText")
    assert "2 r_s (discs part) 1.20" in named
    assert "2 r (collision) 0.250" in named


@pytest.mark.parametrize(("length", "time_"), [(0.125, 4.0)])
def test_a_scaled_episode_looks_the_same(browser, folder, recording, length, time_):
    # Oracle: the picture of the episode that was not scaled; factors that are powers of two change no rounding.
    places = {name: getattr(recording, name) * np.float32(length) for name in ("position", "target_position")}
    scaled = dataclasses.replace(
        recording, scenario=recording.scenario.scaled(length, time_), speed=recording.speed * length / time_, **places
    )
    pictures = []
    for episode, factor in ((recording, 1), (scaled, time_)):
        run = opened(browser, folder, page(episode))
        run(f"replay.select(2); replay.player.seek({4.2 * factor})")
        pictures.append(run("return replay.views[0].canvas.toDataURL()"))
        press(browser, "]", "+")
        pictures.append(run("return replay.views[0].canvas.toDataURL()"))
    assert pictures[:2] == pictures[2:]


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
