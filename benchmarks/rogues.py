"""Undetected times of the included learned rogues and of the scripts: `python benchmarks/rogues.py`.

Prints the table of docs/rogues.md from the times that are stored beside the weights, which were measured by
`python benchmarks/publish.py` on held-out seeds.
"""

from lissajous_env import rogues
from lissajous_env.parameters.rogues import folder_of
from training.learned import checkpoint

LEARNED = {name: folder for name in rogues() if (folder := folder_of(name)) is not None}
"""Folders of the included learned rogues, by name."""


def rows() -> list[str]:
    """Return a row of the table for each included rogue and each policy that it was trained against."""
    lines = []
    for name, folder in LEARNED.items():
        description = checkpoint.read_description(folder)
        for policy, times in description["held_out_times"].items():
            learned = times.pop("learned")
            best = {key: max(summary[key] for summary in times.values()) for key in ("mean", "longest")}
            cells = [f"{summary['mean']:.2f} ({summary['longest']:.1f})" for summary in (best, learned)]
            lines.append(f"| `{name}` | `{description['card'].scenario}`, `{policy}` | {' | '.join(cells)} |")
    return lines


if __name__ == "__main__":
    print("| rogue | trained on, against | best script | learned |")
    print("|---|---|---|---|")
    print("\n".join(rows()))
