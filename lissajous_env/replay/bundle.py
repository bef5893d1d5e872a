"""One HTML file of a template, style sheets, scripts and data: nothing of it is loaded from anywhere.

The scripts are ES modules, joined into one in the order of their imports. The page allows itself by their hashes to run
these scripts and no others, and to ask no address for anything: whatever the data hold, it is never run.
"""

import base64
import functools
import hashlib
import html
import json
import re
from collections.abc import Mapping, Sequence
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any

ASSETS: Traversable = files("lissajous_env.replay") / "assets"
"""Templates, style sheets and modules."""

_IMPORT = re.compile(r'^import \{[^}]*\} from "\./([\w-]+\.js)";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:async function|function|class|const|let) )", re.MULTILINE)
_DECLARED = re.compile(r"^(?:async function|function|class|const|let) (\w+)", re.MULTILINE)
_SLOT = re.compile(r"<!-- slot: (\w+) -->")


def bundled(
    template: str, entry: str, data: Mapping[str, Any], words: Mapping[str, str], libraries: Sequence[str] = ()
) -> str:
    """Put a page together.

    Args:
        template: Name of a template in `ASSETS`, with the slots `policy`, `styles`, `data`, `scripts` and those of
            `words`.
        entry: Name of the module that runs.
        data: What the page shows, as JSON can hold it; the page finds it as `script#data`.
        words: Texts by the slot that they fill; they are escaped.
        libraries: Vendored scripts by name, which run before; `uPlot` brings a style sheet.

    Returns:
        The page.
    """
    styles = [_text("vendor/uPlot.min.css")] if "uPlot" in libraries else []
    styles.append(_text("style.css"))
    scripts = [_text(f"vendor/{name}.iife.min.js") for name in libraries]
    module = joined(entry)
    allowed = " ".join(map(_hash, (*scripts, module)))
    policy = (
        f"default-src 'none'; script-src {allowed}; style-src {' '.join(map(_hash, styles))}; img-src data: blob:; "
        "connect-src 'none'; base-uri 'none'; form-action 'none'"
    )
    made = [_element("script", text) for text in scripts] + [_element("script", module, ' type="module"')]
    # Half of a pair of surrogates is a character in Python, and none in UTF-8.
    filled = {name: html.escape(text.encode(errors="replace").decode()) for name, text in words.items()}
    filled |= {"styles": "\n".join(_element("style", text) for text in styles), "scripts": "\n".join(made)}
    filled |= {"policy": html.escape(policy, quote=True), "data": as_json(data)}
    return _SLOT.sub(lambda slot: filled[slot[1]], _text(template))


def as_json(data: Any) -> str:
    """JSON in which nothing can end the element around it or begin another."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


@functools.cache
def joined(entry: str) -> str:
    """One module of a module and all that it imports.

    Raises:
        ValueError: two of them declare one name, or one imports or exports in a way that this does not know.
    """
    order: list[str] = []
    _visit(entry, order)
    sources = [_EXPORT.sub("", _IMPORT.sub("", _text(name))) for name in order]
    owner: dict[str, str] = {}
    for name, source in zip(order, sources, strict=True):
        if re.search(r"^\s*(?:import|export)\b", source, re.MULTILINE):
            raise ValueError(f"{name} must import names of modules beside it and export declarations alone")
        for declared in _DECLARED.findall(source):
            if declared in owner:
                raise ValueError(f"{name} must not declare {declared}, which {owner[declared]} does")
            owner[declared] = name
    return "\n".join(sources)


def _visit(name: str, order: list[str]) -> None:
    for needed in _IMPORT.findall(_text(name)):
        _visit(needed, order)
    if name not in order:
        order.append(name)


@functools.cache
def _text(name: str) -> str:
    return ASSETS.joinpath(*name.split("/")).read_text(encoding="utf-8")


def _element(name: str, text: str, attributes: str = "") -> str:
    if re.search(rf"</{name}|<!--", text, re.IGNORECASE):
        raise ValueError(f"a bundled {name} must not hold what ends it")
    return f"<{name}{attributes}>{text}</{name}>"


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
