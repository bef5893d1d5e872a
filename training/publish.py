"""Add a trained policy to the included ones: `python -m training.publish runs/x learned-x`."""

from pathlib import Path
from typing import Annotated, Any

import tyro

from baselines.benchmark.statistics import summarize
from lissajous_env import evaluate
from lissajous_env.parameters import named
from lissajous_env.storage.folder import Folder
from lissajous_env.world.columns import COLLISIONS, DETECTION_TIME, RECOVERY, RETURN
from training.learned import checkpoint
from training.learned.policy import Learned
from training.pictures import draw_curve

HELD_OUT = range(10_000, 10_064)


def publish(
    source: Annotated[Path, tyro.conf.Positional],
    name: Annotated[str, tyro.conf.Positional],
    made_for: tuple[str, ...] = (),
    before: tuple[Path, ...] = (),
    folder: Path = Path(__file__).parent / "policies",
    command: str = "",
) -> None:
    """Copy a policy without the state of its training, with its curve and its scores on held-out seeds.

    Args:
        source: folder of the checkpoint to copy.
        name: name of the included policy.
        before: checkpoints of earlier stages in order; their curves precede that of `source`.
        made_for: scenarios on which a benchmark plays it by default; by default the scenario of the training.
        folder: folder of the included policies.
        command: command that trained it, if the settings do not show it.
    """
    with checkpoint.hold(folder / name) as held:
        _publish(source, made_for, before, held, command)


def _publish(source: Path, made_for: tuple[str, ...], before: tuple[Path, ...], folder: Folder, command: str) -> None:
    network, card, text = checkpoint.read(source)
    made_for = made_for or (card.scenario,)
    scores = {}
    for each in made_for:
        # The scenario of the training is in its folder and need not be registered.
        scenario = checkpoint.home_scenario(card) if each == card.scenario else named.scenario(each)
        policy = Learned(network, card, scenario, len(HELD_OUT))
        rows = evaluate(policy, scenario, HELD_OUT)
        columns = [each.name for each in (DETECTION_TIME, COLLISIONS, RECOVERY, RETURN)]
        scores[each] = {column: _rounded(summarize([row[column] for row in rows])) for column in columns}
        print(each, scores[each])
    notes = {"made_for": made_for, "command": command, "held_out_scores": scores, "rivals": text.get("rivals") or {}}
    notes["curve"] = _joined([checkpoint.read_text(stage).get("curve") or [] for stage in (*before, source)])
    notes["counters"] = {"steps": notes["curve"][-1]["steps"]}
    checkpoint.save(folder, network, card, notes=notes)
    with folder.replacing("curve.png") as path:
        draw_curve(folder.path, path)


def _joined(curves: list[list[dict[str, Any]]]) -> list[dict[str, Any]]:
    """Join the curves of stages into one with cumulative steps; each point has its `stage`."""
    joined: list[dict[str, Any]] = []
    for stage, curve in enumerate(curves, 1):
        done = joined[-1]["steps"] if joined else 0
        joined += [point | {"stage": stage, "steps": done + point["steps"]} for point in curve]
    return joined


def _rounded(found) -> dict[str, float | None]:
    numbers = {"iqm": found.iqm, "low": found.low, "high": found.high, "mean": found.mean}
    return {name: round(value, 4) if value == value else None for name, value in numbers.items()}


if __name__ == "__main__":
    tyro.cli(publish)
