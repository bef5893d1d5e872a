"""The report page of a log that was scored: that of a benchmark, with the log in place of a policy."""

from baselines.benchmark import summary_files
from baselines.benchmark.detections import share_detected
from baselines.benchmark.replays import Played
from baselines.benchmark.report_page import Report
from baselines.benchmark.table import Table
from lissajous_env.logs.scoring import Scored
from lissajous_env.replay.contents import BRIEF, contents


def log_report(scored: Scored) -> str:
    """Return the page: the table of a log's score rows, and the episode of the first, which it can play."""
    scenario, first = scored.scenario, scored.rows[0]
    name, policy = scenario.name, first["policy"]
    curves = {name: {policy: share_detected(scored.found, scored.unfound)}}
    table = Table.of(scored.rows, {name: scenario}, curves=curves)
    report = Report(table, summary_files.provenance("cpu"), nameless=frozenset((policy,)))
    played = {(name, policy, first["seed"]): Played(contents(scored.recording, BRIEF), True)}
    return report.html(report.ranked(), played)
