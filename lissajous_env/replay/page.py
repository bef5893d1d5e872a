"""A page of a template, style sheets, scripts and data as one HTML file that loads nothing else.

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
from typing import Any

_FOLDERS = [files("lissajous_env") / "replay" / part for part in ("assets", "report")]
"""Folders of templates, style sheets and modules: those of replays, and those of the report of a benchmark."""

_IMPORT = re.compile(r'^import \{[^}]*\} from "\./([\w-]+\.js)";\n', re.MULTILINE)
_EXPORT = re.compile(r"^export (?=(?:async function|function|class|const|let) )", re.MULTILINE)
_INCLUDED = re.compile(r"<!-- include: ([\w.]+) -->\n")
_SLOT = re.compile(r"<!-- slot: (\w+) -->")
_ALLOWED = re.compile(r"script-src ([^;]*); style-src ([^;]*);")


def html_page(
    template: str,
    script: str,
    data: Mapping[str, Any],
    texts: Mapping[str, str],
    styles: Sequence[str] = ("style.css",),
    blocks: Mapping[str, Any] | None = None,
    framed: str = "",
) -> str:
    """Return a page made from a template.

    Args:
        template: Name of a template, with the slots `policy`, `styles`, `data`, `scripts` and those of `texts`; it may
            include others.
        script: Name of the main module.
        data: Data of the page as JSON values, in the element `script#data`.
        texts: Texts by slot; they are escaped.
        styles: Names of the style sheets.
        blocks: More data by the id of their elements, for the slot `blocks`.
        framed: Page of this module that is shown in a frame; its scripts are permitted too.

    Returns:
        The page.
    """
    sheets = [text_of(name) for name in styles]
    # No two modules declare the same name.
    module = "\n".join(_EXPORT.sub("", _IMPORT.sub("", text_of(name))) for name in _modules(script))
    within = _ALLOWED.search(html.unescape(framed))
    of_scripts, of_styles = within.groups() if within else ("", "")
    policy = (
        f"default-src 'none'; script-src {_hash(module)} {of_scripts}; "
        f"style-src {' '.join(map(_hash, sheets))} {of_styles}; img-src data: blob:; "
        "connect-src 'none'; base-uri 'none'; form-action 'none'"
    ).replace(" ;", ";")
    # A lone surrogate is a character in Python, but invalid in UTF-8.
    filled = {name: html.escape(text.encode(errors="replace").decode()) for name, text in texts.items()}
    filled |= {
        "styles": "\n".join(_element("style", text) for text in sheets),
        "scripts": _element("script", module, ' type="module"'),
    }
    filled |= {"policy": html.escape(policy, quote=True), "data": as_json(data)}
    filled["blocks"] = "\n".join(
        _element("script", as_json(value), f' type="application/json" id="{html.escape(name, quote=True)}"')
        for name, value in (blocks or {}).items()
    )
    whole = _INCLUDED.sub(lambda part: text_of(part[1]), text_of(template))
    return _SLOT.sub(lambda slot: filled[slot[1]], whole)


def as_json(data: Any) -> str:
    """Return JSON that cannot end the element around it or begin another."""
    text = json.dumps(data, separators=(",", ":"), allow_nan=False)
    return text.replace("&", "\\u0026").replace("<", "\\u003c").replace(">", "\\u003e")


@functools.cache
def text_of(name: str) -> str:
    """Return the text of a template, a style sheet or a module."""
    paths = (folder.joinpath(*name.split("/")) for folder in _FOLDERS)
    return next(file for file in paths if file.is_file()).read_text(encoding="utf-8")


@functools.cache
def _modules(entry: str) -> tuple[str, ...]:
    """Return the names of all modules that a module imports, each after those that it imports, and its own."""
    return *dict.fromkeys(name for imported in _IMPORT.findall(text_of(entry)) for name in _modules(imported)), entry


def _element(name: str, text: str, attributes: str = "") -> str:
    if re.search(rf"</{name}|<!--", text, re.IGNORECASE):
        raise ValueError(f"{name} of a page must not contain its end tag or a comment")
    return f"<{name}{attributes}>{text}</{name}>"


def _hash(text: str) -> str:
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
