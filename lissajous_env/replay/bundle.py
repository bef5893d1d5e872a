"""Bundle a template, style sheets, scripts and data into one HTML file that loads nothing else.

The scripts are ES modules, which are joined in the order of their imports. The page's security policy permits only
these scripts, by their hashes, and no network access, so that data are never run.
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
_INCLUDED = re.compile(r"<!-- include: ([\w.]+) -->\n")
_SLOT = re.compile(r"<!-- slot: (\w+) -->")
_ALLOWED = re.compile(r"script-src ([^;]*); style-src ([^;]*);")

Folders = tuple[Traversable, ...]
"""Folders of templates, style sheets and modules, in the order of search."""


def bundled(
    template: str,
    entry: str,
    data: Mapping[str, Any],
    words: Mapping[str, str],
    libraries: Sequence[str] = (),
    styles: Sequence[str] = ("style.css",),
    folders: Folders = (ASSETS,),
    blocks: Mapping[str, Any] | None = None,
    framed: str = "",
) -> str:
    """Return a page made from a template.

    Args:
        template: Name of a template, with the slots `policy`, `styles`, `data`, `scripts` and those of `words`; it may
            include others.
        entry: Name of the main module.
        data: Data of the page as JSON values, in the element `script#data`.
        words: Texts by slot; they are escaped.
        libraries: Names of vendored scripts, which run first; `uPlot` includes a style sheet.
        styles: Names of the style sheets.
        folders: Folders of the files.
        blocks: More data by the id of their elements, for the slot `blocks`.
        framed: Page of this module that is shown in a frame; its scripts are permitted too.

    Returns:
        The page.
    """
    sheets = [_text("vendor/uPlot.min.css", folders)] if "uPlot" in libraries else []
    sheets += [_text(name, folders) for name in styles]
    scripts = [_text(f"vendor/{name}.iife.min.js", folders) for name in libraries]
    module = joined(entry, folders)
    within = _ALLOWED.search(html.unescape(framed))
    of_scripts, of_styles = within.groups() if within else ("", "")
    policy = (
        f"default-src 'none'; script-src {' '.join(map(_hash, (*scripts, module)))} {of_scripts}; "
        f"style-src {' '.join(map(_hash, sheets))} {of_styles}; img-src data: blob:; "
        "connect-src 'none'; base-uri 'none'; form-action 'none'"
    ).replace(" ;", ";")
    made = [_element("script", text) for text in scripts] + [_element("script", module, ' type="module"')]
    # A lone surrogate is a character in Python, but invalid in UTF-8.
    filled = {name: html.escape(text.encode(errors="replace").decode()) for name, text in words.items()}
    filled |= {"styles": "\n".join(_element("style", text) for text in sheets), "scripts": "\n".join(made)}
    filled |= {"policy": html.escape(policy, quote=True), "data": as_json(data)}
    kept = [
        _element("script", as_json(value), f' type="application/json" id="{html.escape(name, quote=True)}"')
        for name, value in (blocks or {}).items()
    ]
    filled["blocks"] = "\n".join(kept)
    whole = _INCLUDED.sub(lambda part: _text(part[1], folders), _text(template, folders))
    return _SLOT.sub(lambda slot: filled[slot[1]], whole)


def as_json(data: Any) -> str:
    """Return JSON that cannot end the element around it or begin another."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


@functools.cache
def joined(entry: str, folders: Folders = (ASSETS,)) -> str:
    """Join a module and all modules that it imports.

    Raises:
        ValueError: two modules declare the same name, or the form of an import or export is unsupported.
    """
    order: list[str] = []
    _visit(entry, order, folders)
    sources = [_EXPORT.sub("", _IMPORT.sub("", _text(name, folders))) for name in order]
    owner: dict[str, str] = {}
    for name, source in zip(order, sources, strict=True):
        if re.search(r"^\s*(?:import|export)\b", source, re.MULTILINE):
            raise ValueError(f"{name} must import only names of modules beside it, and export only declarations")
        for declared in _DECLARED.findall(source):
            if declared in owner:
                raise ValueError(f"{name} must not declare {declared}, which {owner[declared]} does")
            owner[declared] = name
    return "\n".join(sources)


def _visit(name: str, order: list[str], folders: Folders) -> None:
    for needed in _IMPORT.findall(_text(name, folders)):
        _visit(needed, order, folders)
    if name not in order:
        order.append(name)


@functools.cache
def _text(name: str, folders: Folders) -> str:
    found = [folder.joinpath(*name.split("/")) for folder in folders]
    return next((each for each in found if each.is_file()), found[-1]).read_text(encoding="utf-8")


def _element(name: str, text: str, attributes: str = "") -> str:
    if re.search(rf"</{name}|<!--", text, re.IGNORECASE):
        raise ValueError(f"a bundled {name} must not contain its end tag or a comment")
    return f"<{name}{attributes}>{text}</{name}>"


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
