"""The report page of a log that was scored: that of a benchmark, with the log in place of a policy."""

from baselines.benchmark import summary_files
from baselines.benchmark.comparison import compare
from baselines.benchmark.detections import share_detected
from baselines.benchmark.replays import Played
from baselines.benchmark.report_page import Report
from baselines.benchmark.types import Benchmark, Outcome
from lissajous_env.logs.scoring import Scored
from lissajous_env.replay.contents import BRIEF, contents


def log_report(scored: Scored) -> str:
    """Return the page: the statistics of a log's score rows, and the episode of the first, which it can play."""
    scenario, rows, first = scored.scenario, scored.rows, scored.rows[0]
    name, policy = scenario.name, first["policy"]
    settings = Benchmark((name,), (policy,), episodes=len(rows), seed=first["seed"])
    scenarios, curves = {name: scenario}, {name: {policy: share_detected(scored.found, scored.unfound)}}
    outcome = Outcome(settings, [], rows, [], 0, 0.0, {}, scenarios, rows, curves)
    machine = summary_files.machine("cpu")
    made = {"command": summary_files.command(), "machine": f"{machine['cpu']}, {machine['cores']} cores"}
    made["versions"] = ", ".join(f"{name} {number}" for name, number in summary_files.versions().items())
    report = Report(outcome, compare(rows, scenarios), made, {}, frozenset((policy,)))
    played = {(name, policy, first["seed"]): Played(contents(scored.recording, BRIEF), True)}
    return report.html(report.ranked(), played)
