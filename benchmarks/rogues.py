"""Undetected times of the included learned rogues and of the scripts: `python benchmarks/rogues.py`.

Prints the table of docs/rogues.md from the times that are stored beside the weights, which were measured by
`python benchmarks/publish.py` on held-out seeds.
"""

from lissajous_env.parameters.rogues import folder_of, rogue_of, shipped_rogues
from training.learned import checkpoint


def rows() -> list[str]:
    """Return a row of the table for each included rogue and each policy that it was trained against."""
    found = []
    for name in shipped_rogues():
        for policy, times in checkpoint.read_contents(folder_of(name))["held_out_times"].items():
            learned = times.pop("learned")
            best = {each: max(of[each] for of in times.values()) for each in ("mean", "longest")}
            cells = [f"{of['mean']:.2f} ({of['longest']:.1f})" for of in (best, learned)]
            found.append(f"| `{name}` | `{rogue_of(name).trained_on}`, `{policy}` | {' | '.join(cells)} |")
    return found


if __name__ == "__main__":
    print("| rogue | trained on, against | best script | learned |")
    print("|---|---|---|---|")
    print("\n".join(rows()))
