"""Pages of the scenarios and drawings, made from the code when the documentation is built.

Everything goes into `docs/scenarios` and `docs/drawn`, which git ignores.
"""

from pathlib import Path
from typing import Any

from docs.generator import concepts, design, docstrings, scenarios
from docs.generator.files import write_changed


def setup(app: Any) -> None:
    """Register with Sphinx: make the pages before it reads sources, and convert docstrings."""
    app.connect("config-inited", lambda app, config: make(Path(app.srcdir)))
    app.connect("autodoc-process-docstring", docstrings.as_restructured_text, priority=400)


def make(docs: Path) -> None:
    """Write the pages, drawings and replays below a folder, if they have changed."""
    (docs / "drawn" / "site").mkdir(parents=True, exist_ok=True)
    for name, drawing in {**concepts.DRAWINGS, **design.DRAWINGS}.items():
        write_changed(docs / "drawn" / f"{name}.svg", drawing())
    scenarios.make(docs / "scenarios", docs / "drawn" / "site" / "replays")
