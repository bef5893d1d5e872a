"""Conversion of docstrings, which are close to Markdown, to reStructuredText for Sphinx."""

from typing import Any

from lissajous_env.world.state import Clock

_SECTIONS = ("Args", "Attributes", "Raises", "Returns", "Yields")


def as_restructured_text(app: Any, what: str, name: str, documented: Any, options: Any, lines: list[str]) -> None:
    """Convert indented blocks below a line that ends in a colon into literal blocks, in place."""
    if isinstance(documented, type(Clock)):
        lines += ["", *arrays_of(documented)]
    # In an attribute's first line Sphinx would read the text before a colon as its type; a comment first prevents it.
    lines[:] = (["..", ""] if what in ("attribute", "property") else []) + [
        without_substitutions(line) for line in with_literal_blocks(lines)
    ]


def arrays_of(struct: Any) -> list[str]:
    """Return an entry of a list for each array of a struct of the state, with the docstring that follows it."""
    from sphinx.pycode import ModuleAnalyzer  # which only a build of the documentation requires

    about = ModuleAnalyzer.for_module(struct.cls.__module__).find_attr_docs()
    return [f"* `{name}`: {' '.join(about[struct.cls.__name__, name]).strip()}" for name in struct.vars]


def with_literal_blocks(lines: list[str]) -> list[str]:
    """Double the colon before each indented block, except in Google-style sections."""
    converted = list(lines)
    for k, line in enumerate(lines[:-2]):
        follows = lines[k + 2]
        is_block = not lines[k + 1].strip() and _indent(follows) > _indent(line) and follows.strip()
        if line.rstrip().endswith(":") and is_block and line.strip().rstrip(":") not in _SECTIONS:
            converted[k] = line.rstrip() + ":"
    return converted


def without_substitutions(line: str) -> str:
    """Escape the bars of absolute values, which would be substitutions, except in code."""
    words = line.split("`")
    words[::2] = [word.replace("|", "\\|") for word in words[::2]]
    return "`".join(words)


def _indent(line: str) -> int:
    return len(line) - len(line.lstrip())
