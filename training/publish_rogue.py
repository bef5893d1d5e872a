"""Add a trained rogue to the included ones: `python -m training.publish_rogue runs/x hide-from-x`."""

import sys
from pathlib import Path
from typing import Annotated, Any

import tyro

from baselines.exploitability.survival import survive
from lissajous_env.parameters.rogues import CHECKPOINT
from training.learned import checkpoint
from training.rogue_settings import RogueTraining

HELD_OUT = range(10_000, 10_064)
SCRIPTS = "wander", "flee", "shadow", "follow-gap"
"""Scripts whose undetected times are stored beside those of the rogue."""


def publish_rogue(
    source: Annotated[Path, tyro.conf.Positional],
    name: Annotated[str, tyro.conf.Positional],
    command: str,
    folder: Path = Path(__file__).parent / "rogues",
) -> None:
    """Copy a rogue without the state of its training, with its undetected times on held-out seeds.

    Args:
        source: folder of the checkpoint to copy.
        name: name of the included rogue.
        command: command that trained it.
        folder: folder of the included rogues.
    """
    network, card, text = checkpoint.read(source)
    stored = dict(card.settings)
    settings = RogueTraining(stored["scenario"], starts=stored["starts"], overrides=stored["overrides"])
    policy = stored["against"]
    rogues = dict(zip((*SCRIPTS, "learned"), (*SCRIPTS, str(source)), strict=True))
    times: dict[str, Any] = {}
    for rogue, moved_by in rogues.items():
        summary = survive(policy, settings.make_scenario(moved_by), HELD_OUT).summary()
        times[rogue] = {key: round(value, 4) for key, value in summary.items()}
        print(policy, rogue, times[rogue])
    notes = {"command": command, "held_out_times": {policy: times}, "rogues": text["rogues"]}
    with checkpoint.hold(folder / name) as held:
        checkpoint.save(held, network, card, notes=notes)
    print(f"wrote {folder / name / CHECKPOINT}", file=sys.stderr)


if __name__ == "__main__":
    tyro.cli(publish_rogue)
