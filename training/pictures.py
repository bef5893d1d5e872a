"""Picture of the learning curves."""

from itertools import groupby
from pathlib import Path

from training.learned import checkpoint
from training.learned.card import Card
from training.learned.history import History

_PANELS = (
    ("detection_time", "detection time, interquartile mean [s]"),
    ("collisions", "collisions per episode"),
    ("return", "return per robot"),
)


def draw_curve(folder: str | Path, path: str | Path) -> None:
    """Draw the evaluations of a training over its steps, with rivals as dashed lines and dotted lines between stages.

    Args:
        folder: Folder of a checkpoint.
        path: PNG file to write.

    Raises:
        ValueError: the checkpoint is damaged or has no evaluations.
    """
    from matplotlib.figure import Figure

    from lissajous_env.render.plotting import own_settings

    text = checkpoint.read_text(folder)
    history = History.read(text)
    curve, rivals = history.curve, history.rivals
    if not curve:
        raise ValueError(f"{folder} must contain evaluations of a training, got a checkpoint without any")
    # Returns of stages are not comparable, because their settings differ.
    stages = [list(points) for _, points in groupby(curve, key=lambda point: point.get("stage"))]
    with own_settings({}):
        figure = Figure(figsize=(12, 3.6), layout="constrained", dpi=120)
        axes = figure.subplots(1, len(_PANELS))
        for axis, (name, title) in zip(axes, _PANELS, strict=True):
            for points in stages:
                steps = [point["steps"] / 1e6 for point in points]
                values = [float("nan") if point[name] is None else point[name] for point in points]
                label = "policy" if points is stages[0] else None
                axis.plot(steps, values, color="tab:blue", marker="." if len(curve) < 30 else "", label=label)
                if points is not stages[-1]:
                    axis.axvline(steps[-1], color="tab:blue", linestyle=":", linewidth=1)
            for k, (rival, scores) in enumerate(rivals.items()):
                if scores[name] is not None:
                    axis.axhline(scores[name], color=f"C{k + 1}", linestyle="--", linewidth=1, label=rival)
            axis.set(xlabel="robot steps [million]", title=title)
            axis.grid(alpha=0.3)
            axis.spines[["top", "right"]].set_visible(False)
            if name != "return":
                axis.set_ylim(bottom=0)
        axes[0].legend(frameon=False, fontsize=8)
        card = Card.from_dict(text["policy"], text["settings"], text.get("scenario"))
        base = f" on top of {card.base}" if card.base else ""
        parts = f", {len(stages)} stages" if len(stages) > 1 else ""
        algorithm, seed = (card.settings.get(name, "?") for name in ("algorithm", "seed"))
        figure.suptitle(f"{card.scenario}: {algorithm}{base}{parts}, seed {seed}", parse_math=False)
        figure.savefig(path)
