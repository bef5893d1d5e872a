"""The command `lissajous benchmark`: policies compared on scenarios."""

import dataclasses

from baselines.benchmark.results_folder import SUMMARY
from baselines.benchmark.running import measure
from baselines.benchmark.types import Benchmark
from baselines.benchmark.written import summarized
from lissajous_env.console.terminal import (
    DEFAULT_OUTPUT,
    CommandError,
    Output,
    Overrides,
    RogueName,
    parse_overrides,
)


def benchmark(
    settings: Benchmark,
    rogues: RogueName = None,
    output: Output = DEFAULT_OUTPUT,
    overrides: Overrides = (),
) -> None:
    """Compare policies on scenarios, with the same seeds for all: tables, files and a report page.

    An interrupted benchmark resumes when the same command is run again.

    Example:
        lissajous benchmark --scenarios evaders team --policies kuramoto-mpcc sweep --episodes 8

    Args:
        settings: Episodes to play, and the folder of the results.
    """
    settings = dataclasses.replace(settings, overrides=parse_overrides(overrides, rogues))
    try:
        outcome = measure(settings, console=output.console(), progress_console=output.progress())
    except KeyboardInterrupt:
        words = f"finished episodes are stored in {settings.out}; run the same command again to resume"
        raise KeyboardInterrupt(words) from None
    if output.json:
        output.print_json({**summarized(outcome), "episodes": outcome.rows})
    if outcome.failures:
        names = dict.fromkeys(f"{failure.policy} on {failure.scenario}" for failure in outcome.failures)
        raise CommandError(f"{', '.join(names)} failed; {settings.out / SUMMARY} has the tracebacks")
