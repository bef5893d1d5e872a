"""Reports in headless Chromium: sortable tables, replays and narrow pages."""

import pytest
from browser import HOSTILE, complaints, opened, wait
from rich.console import Console

import lissajous_env
from baselines.benchmark.running import run as run_benchmark
from baselines.benchmark.types import Benchmark

QUIET = Console(quiet=True)
SHORT = {"task.duration": 4.0}
THEIRS = "mine" + HOSTILE
SCREEN = {"height": 900, "deviceScaleFactor": 1, "mobile": False}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("reports")


@pytest.fixture(scope="module")
def text(folder):
    """Two scenarios, the second without a guarantee, three policies, one of them somebody's, four episodes."""
    scenarios = [lissajous_env.scenario(name, **SHORT) for name in ("evaders", "intruders")]
    settings = Benchmark(("evaders", "intruders"), ("kuramoto-mpcc", "laps"), 4, out=folder / "out", replays=6,
                         overrides=SHORT)  # fmt: skip

    def still(observation):
        return observation[:, :, :2] * 0

    run_benchmark(settings, {THEIRS: still}, scenarios, QUIET)
    return (folder / "out" / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def run(browser, folder, text):
    """Return a function that runs a script in the report."""
    return opened(browser, folder, text)


def shown(run):
    """The rows of the table of episodes that are shown: (scenario, policy, seed)."""
    rows = "return [...list.tBodies[0].rows].map((row) => [0, 1, 2].map((k) => row.cells[k].textContent))"
    return [(scenario, policy, int(seed)) for scenario, policy, seed in run(rows)]


def data_of(run):
    return run("return report.report")


def test_the_table_of_episodes_is_put_in_order_and_narrowed_down(browser, run):
    episodes = data_of(run)["episodes"]
    assert len(shown(run)) == len(episodes["seed"]) == 24
    failed = [bin(bits).count("1") for bits in episodes["failed"]]
    assert failed == sorted(failed, reverse=True)  # the worst first
    # Oracle: Python's sort of the same numbers; a click turns it round, what is missing stays last.
    run("document.querySelector('[data-column=detection_time_mean]').click()")
    known = [(value, k) for k, value in enumerate(episodes["detection_time_mean"]) if value is not None]
    wanted = [episodes["seed"][k] for _, k in sorted(known, key=lambda pair: (-pair[0], pair[1]))]
    assert [seed for *_, seed in shown(run)][: len(wanted)] == wanted
    run("document.querySelector('[data-column=detection_time_mean]').click()")
    place = run("return document.querySelector('[data-column=detection_time_mean]').closest('th').cellIndex")
    least = run(f"return Number(list.tBodies[0].rows[0].cells[{place}].textContent)")
    assert least == pytest.approx(min(known)[0], abs=6e-4)
    assert run("return document.querySelector('[aria-sort] .sort').dataset.column") == "detection_time_mean"
    run("const p = document.getElementById('of-policy'); p.value = '1'; p.dispatchEvent(new Event('change'))")
    assert {policy for _, policy, _ in shown(run)} == {"laps"}
    assert complaints(browser) == ([], [])


def test_it_begins_with_all_scenarios_and_its_tables_are_put_in_order(browser, run):
    parts = run("return [...document.querySelectorAll('main .part')].map((part) => part.id)")
    assert parts == ["overall", "failures", "scenario-0", "scenario-1", "episodes", "made"]
    names = "return [...document.querySelectorAll('.together tbody th')].map((name) => name.textContent)"
    (overall,) = data_of(run)["overall"]
    columns = [measure["column"] for measure in overall["measures"]]
    best = [policy["cells"][columns[0]]["value"] for policy in overall["policies"]]
    assert best == sorted(best)
    before = run(names)
    run(f"document.querySelectorAll('.together .sort')[{columns.index('collisions') + 1}].click()")
    collisions = [policy["cells"]["collisions"]["value"] for policy in overall["policies"]]
    assert run(names) == [before[k] for k in sorted(range(len(before)), key=lambda k: collisions[k])]
    # Seed by seed: the reference has no share of seeds.
    shares = run("""const heads = [...document.querySelectorAll('#scenario-0 .policies thead .sort')];
        const at = heads.findIndex((head) => head.textContent === 'better');
        return [...document.querySelectorAll('#scenario-0 .policies tbody tr')]
            .map((row) => [row.cells[0].querySelector('span').textContent, row.cells[at].textContent])""")
    assert [share.startswith("\N{EM DASH}") for name, share in shares if name.startswith("kuramoto-mpcc")] == [True]
    assert [" %" in share for name, share in shares if name.startswith("laps")] == [True]
    assert complaints(browser) == ([], [])


def test_what_failed_leads_to_its_episodes(browser, run):
    data = data_of(run)
    tallies = run("return [...document.querySelectorAll('.tally b')].map((b) => b.textContent)")
    counted = [sum(bits >> k & 1 for bits in data["episodes"]["failed"]) for k in range(3)]
    assert tallies == [f"{count} of {judged}" for count, judged in zip(counted, (24, 12, 24), strict=True)]
    assert counted[0] > 0  # cars that do not move leave half unseen
    run("document.querySelector('.tally').click()")
    assert len(shown(run)) == counted[0]
    # The worst policy of the matrix is the first row; its cell leads to its episodes on that scenario.
    run("document.querySelector('#matrix tbody tr td .meters').click()")
    first = run("return document.querySelector('#matrix tbody th').textContent")
    assert {(scenario, policy) for scenario, policy, _ in shown(run)} == {("evaders", first)}
    bars = run("return [...document.querySelectorAll('.meter > i > i')].map((i) => parseFloat(i.style.width))")
    assert bars
    assert all(0 < bar <= 100 for bar in bars)
    words = {of["cells"]["collisions"]["words"] for scenario in data["scenarios"] for of in scenario["policies"]}
    assert {*run("return [...document.querySelectorAll('.meter.collided > span')].map((s) => s.textContent)")} <= words
    assert complaints(browser) == ([], [])


def test_a_click_plays_the_episode_beside_the_reference(browser, run):
    run(
        "const all = report.report.replays, p = report.report.policies.findIndex((each) => each.name === 'laps');"
        "const [id] = Object.entries(all).find(([, [s, q]]) => s === 0 && q === p);"
        "report.episodes.narrow({ scenario: 0, policy: p });"
        "document.querySelector(`[data-replay=${id}]`).click()"
    )
    assert run("return document.getElementById('viewer').open")
    browser.switch_to.frame(browser.find_element("id", "frame"))
    wait(lambda: run("return document.body?.dataset.ready === 'true'"))
    (laps, seed), other = run("return replay.episodes.map((e) => [e.raw.policy, e.raw.seed])")
    assert (laps, other) == ("laps", ["kuramoto-mpcc", seed])
    run("replay.player.toggle(true)")
    wait(lambda: run("return replay.player.time") > 0.5)
    browser.switch_to.default_content()
    # It has an address of its own; alone it plays too; closed, the address is the report's.
    address = run("return location.href")
    assert "#replay-" in address
    run("const b = document.getElementById('beside'); b.value = ''; b.dispatchEvent(new Event('change'))")
    browser.switch_to.frame(browser.find_element("id", "frame"))
    wait(lambda: run("return document.body?.dataset.ready === 'true' && replay.episodes.length === 1"))
    browser.switch_to.default_content()
    run("document.getElementById('close').click()")
    wait(lambda: "#" not in run("return location.href"))
    said, asked = complaints(browser)
    assert said == []
    assert [address for address in asked if not address.startswith("about:")] == []


def test_names_are_no_script(run):
    run("report.episodes.narrow({})")
    assert run("return document.querySelectorAll('img').length") == 0
    assert THEIRS in run("return document.getElementById('list').textContent")
    assert run("return document.title") == "Benchmark"


def test_it_fits_narrow_and_wide_screens(browser, run):
    for width in (390, 1280):
        browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", SCREEN | {"width": width})
        wait(lambda: run("return document.querySelectorAll('.figure svg').length") == 2)
        assert run("return document.documentElement.scrollWidth") <= width
        marks = "(picture) => picture.querySelectorAll('path, circle').length"
        assert all(run(f"return [...document.querySelectorAll('.figure svg')].map({marks})"))
    assert complaints(browser) == ([], [])


def test_a_link_into_a_report_opens_its_replay_at_a_moment(browser, folder, text):
    opened(browser, folder, text)
    browser.get("about:blank")
    browser.get(f"{(folder / 'page.html').as_uri()}#replay-0&t=2.5&robot=4")
    run = browser.execute_script
    for end, place in (("", [2.5, 4]), ("t=1;alert(1)", [0, -1])):
        if end:  # what is no moment opens the replay all the same, from its beginning
            run(f"location.hash = '#replay-0&{end}'")
        wait(lambda: run("return document.getElementById('frame')?.srcdoc.length") > 1000)
        browser.switch_to.frame(browser.find_element("id", "frame"))
        wait(lambda: run("return document.body?.dataset.ready === 'true'"))
        wait(lambda place=place: run("return [replay.player.time, replay.selected]") == place)
        assert run("return replay.selected") == place[1]
        browser.switch_to.default_content()
