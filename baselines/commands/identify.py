"""The command `lissajous identify`: the constants of cars or differential drives, fitted to a log."""

import math
from dataclasses import replace
from typing import TYPE_CHECKING

from baselines.commands.playing import check_file
from lissajous_env.console.terminal import DEFAULT_OUTPUT, LogFiles, OutFile, Output, ScenarioOption, print_table
from lissajous_env.logs.poses import TOPICS
from lissajous_env.logs.reading import COMMAND, read
from lissajous_env.logs.scoring import own_scenario
from lissajous_env.parameters import named
from lissajous_env.parameters.scenario import Scenario
from lissajous_env.parameters.scenario_file import as_toml
from lissajous_env.storage.files import write_atomically
from lissajous_env.wording import require, shown

if TYPE_CHECKING:
    from lissajous_env.logs.identification import Identified


def identify(
    logs: LogFiles,
    scenario: ScenarioOption = None,
    topics: tuple[str, ...] = TOPICS,
    commands: str = COMMAND,
    out: OutFile = None,
    output: Output = DEFAULT_OUTPUT,
) -> None:
    """Fit the model of a car or differential drive to a log, and print its constants with standard errors.

    Example:
        lissajous identify lab.mcap --out lab-cars.toml

    Args:
        logs: rosbag2 file (.mcap) or folder, with poses and commands of one or more robots, or several that
            belong together.
        scenario: name of a scenario, .toml file, or module:attribute; by default that of the log, or the paper's
            experiment. Its robot.kind, car or differential, selects the model, and a constant that the log does not
            determine is that of its robots.
        topics: topics of the robots' poses in their order, or one name in which {} stands for their numbers; for /tf
            and arrays of poses also with a part, as in /tf:car_{}.
        commands: topic of the commands with {}: sensor_msgs/JointState with the joints steering [rad] and throttle, or
            std_msgs/Float64MultiArray of the two; of drives geometry_msgs/Twist, TwistStamped, or speed and yaw rate.
        out: .toml file to write: a scenario with these robots.
    """
    from lissajous_env.logs.identification import MODELS
    from lissajous_env.logs.identification import identify as fit

    check_file(out, ".toml")
    log = read(logs, topics, commands)
    given = named.scenario(scenario) if scenario is not None else own_scenario(log) or named.scenario("experiment")
    kind = given.robot.kind
    require(kind in MODELS, "scenario", f"must be of robots of kind {' or '.join(MODELS)}", kind)
    units = {name: unit for name, (unit, _) in MODELS[kind].items()}
    require(log.commands, f"log {log.name}", f"must have commands on a topic {commands}", "none")
    robots = {}
    for robot, series in log.commands.items():
        try:
            robots[log.label(robot)] = fit(log.tracks[robot], series, given.robot, log.statuses.get(robot))
        except ValueError as error:
            raise ValueError(f"{log.called([robot])} of {log.name}: {error}") from error
    _print(output, robots, units)
    for note in log.notes:
        output.print(f"note: {note}", "yellow")
    if out is not None:
        write_atomically(out, _as_toml(robots, given, log.name, units))
        output.print(f"wrote {out}")
    output.print_json(robots)


_RESIDUALS = {"position": "m", "heading": "rad", "speed": "m/s"}


def _print(output: Output, robots: "dict[str, Identified]", units: dict[str, str]) -> None:
    titles = [f"{name.replace('_', ' ')}\n[{unit}]" if unit else f"{name}\n" for name, unit in units.items()]
    rows = [
        [label, *(_with_error(robot.values[name], robot.errors[name]) for name in units)]
        for label, robot in robots.items()
    ]
    print_table(output.console(), ["robot", *titles], rows)
    if any(math.isnan(error) for robot in robots.values() for error in robot.errors.values()):
        why = "throttle in it lies within the dead zone" if "dead_zone" in units else "command is beyond the limit"
        output.print(f"(given): the log does not determine this constant; no {why}.")
    for label, robot in robots.items():
        known = {name: size for name, size in robot.residual.items() if not math.isnan(size)}
        sizes = [f"{name} {size:.3g} {_RESIDUALS[name]}" for name, size in known.items()]
        output.print(f"residuals of robot {label} over {robot.samples:,} poses: {', '.join(sizes)}")
        if robot.misfits:
            misfits = " and ".join(robot.misfits)
            words = f"the model does not fit robot {label}: the residual of {misfits} is far above noise"
            output.print(f"warning: {words}; check the units and the order of the commands, and the clocks", "yellow")


def _with_error(value: float, error: float) -> str:
    """Return a value with its standard error in brackets, to two digits of the error."""
    if math.isnan(error):
        return f"{value:g} (given)"
    digits = min(max(1 - math.floor(math.log10(max(error, 1e-9))), 0), 6)
    return f"{value:.{digits}f} ± {error:.{digits}f}"


def _as_toml(robots: "dict[str, Identified]", scenario: Scenario, log: str, units: dict[str, str]) -> str:
    """Return the file of a scenario with the mean of the robots, the standard errors in comments."""
    mean, lines = {}, [f"# Robots identified from {shown(log)}: means with standard errors."]
    for name, unit in units.items():
        values = [robot.values[name] for robot in robots.values()]
        mean[name] = float(f"{sum(values) / len(values):.6g}")
        error = math.sqrt(sum(robot.errors[name] ** 2 for robot in robots.values())) / len(robots)
        lines.append(f"# {name} = {_with_error(mean[name], error)} {unit}".rstrip())
    lines.append("# A scenario has no delay of the commands, nor factors of speeds.")
    robot, limits = scenario.robot, {"drive_factors": ()}
    if robot.kind == "car":
        limits |= {"speed_max": None, "throttle_max": robot.full_throttle, "model_offset": None}
    mean = {name: value for name, value in mean.items() if hasattr(robot, name)}
    return "\n".join([*lines, as_toml(replace(scenario, robot=replace(robot, **limits, **mean)))])
