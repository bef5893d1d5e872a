"""Pages in headless Chromium, for tests: open one, press, click, drag, and read what it shows."""

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

try:
    from selenium import webdriver
except ImportError:
    webdriver = None

HOSTILE = "</script><img src=x onerror=\"document.title='run'\"><script>document.title='run'</script>"
ROWS = "return [...document.querySelectorAll('.rows tr')].map((row) => [...row.cells].map((c) => c.textContent))"
EVADERS = {"task.duration": 8.0, "targets.arrival_rate": 2.0, "faults.schedule": ((2, 3.0, 5.0),)}


def browser_on_this_machine():
    paths = [shutil.which(name) for name in ("chromium", "chromium-browser", "google-chrome")]
    return next(filter(None, paths), None), shutil.which("chromedriver")


@pytest.fixture(scope="session")
def browser():
    program, driver = browser_on_this_machine()
    if program is None or driver is None or webdriver is None:
        words = "Selenium, or Chromium and its driver, are not installed (Debian: chromium, chromium-driver)"
        pytest.fail(words) if os.environ.get("CI") else pytest.skip(words)
    options = webdriver.ChromeOptions()
    options.binary_location = program
    for flag in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--enable-unsafe-swiftshader"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    browser = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
    yield browser
    browser.quit()


def played(name="evaders", policy="kuramoto-mpcc", seed=1, **overrides):
    scenario = lissajous_env.scenario(name, **overrides)
    return record(baselines.make(policy, scenario), scenario, seed)


@pytest.fixture(scope="session")
def recording():
    return played(**EVADERS)


def hostile(recording, words):
    """The same with names that would be script, numbers that are none, and places far away."""
    scenario = dataclasses.replace(recording.scenario, name=words, description=words)
    position = recording.position.copy()
    position[10:30] *= np.float32(1e30)
    score = recording.score | {"policy": words, words: float("nan"), "return_mean": float("inf"), "x": 10**400}
    names = (words, *recording.observation_names[1:])
    changes = {"position": position, "score": score, "observation_names": names, "scenario": scenario}
    return dataclasses.replace(recording, **changes)


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("pages")


def opened(browser, folder, text, width=1280):
    """Open a page at a width [px]; returns a function that runs a script in it."""
    browser.get_log("browser"), browser.get_log("performance")
    metrics = {"width": width, "height": 900, "deviceScaleFactor": 1, "mobile": False}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
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
    """Return the messages of the console that are worse than a note on speed, and all requested addresses but the
    file's."""
    said = [entry["message"] for entry in browser.get_log("browser") if "GPU stall" not in entry["message"]]
    sent = [json.loads(entry["message"])["message"] for entry in browser.get_log("performance")]
    asked = [event["params"]["request"]["url"] for event in sent if event["method"] == "Network.requestWillBeSent"]
    return said, [address for address in asked if not address.endswith("/page.html")]


def press(browser, *keys):
    webdriver.ActionChains(browser).send_keys(*keys).perform()


def click(browser, x, y):
    """Click at a place of the window [px]."""
    chain = webdriver.ActionChains(browser)
    chain.w3c_actions.pointer_action.move_to_location(round(x), round(y))
    chain.click().perform()


def middle(run, view=0):
    """The middle of a picture [px of the window], and its width."""
    return run(
        f"const box = replay.views[{view}].canvas.getBoundingClientRect();"
        "return [box.left + box.width / 2, box.top + box.height / 2, box.width]"
    )


def place_of(run, robot, view=0):
    """Return the place of a robot on a picture [px of the window]."""
    return np.array(
        run(
            f"const {{ stage, canvas }} = replay.views[{view}], box = canvas.getBoundingClientRect();"
            f"return [box.left + stage.nearest[{robot}].x, box.top + stage.nearest[{robot}].y]"
        )
    )


def turn_wheel(browser, place, by):
    """Turn the wheel over a place of the window [px]."""
    x, y = place
    wheel = {"type": "mouseWheel", "x": round(x), "y": round(y), "deltaX": 0, "deltaY": by}
    browser.execute_cdp_cmd("Input.dispatchMouseEvent", wheel)


def drag(browser, x, y, right, down):
    """Drag from a place of the window [px] in steps, with the first button."""
    for kind, share in [("mousePressed", 0), *[("mouseMoved", k / 4) for k in range(1, 5)], ("mouseReleased", 1)]:
        mouse = {"type": kind, "x": x + share * right, "y": y + share * down, "button": "left", "buttons": 1}
        browser.execute_cdp_cmd("Input.dispatchMouseEvent", mouse | {"clickCount": int(kind != "mouseMoved")})


def numbers(run, path):
    return np.array(run(f"return Array.from(replay.views[0].episode.{path})"))
