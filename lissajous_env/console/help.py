"""Help of a command, read from its function: signature, docstring and, of a parameter that is a dataclass, its fields.

The docstring's section `Example:` contains command lines. Its section `Options:` sorts the options into groups, `Title:
name, name`; those of no group come first.
"""

import dataclasses
import inspect
import re
import types
import typing
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple

import tyro
from rich.table import Table
from rich.text import Text

from lissajous_env.console.terminal import Output, make_console
from lissajous_env.settings.checks import meanings

_METAVARS = {int: "INT", float: "FLOAT", str: "TEXT", Path: "PATH", bool: ""}
_WIDEST = 30
"""Largest number of columns for the names of options."""


class _Option(NamedTuple):
    name: str
    usage: str
    text: str
    positional: bool


def print_help(function: Callable[..., Any], program: str) -> None:
    """Print what a command does, an example, and its options in groups."""
    console = make_console()
    about, sections = _sections(inspect.getdoc(function) or "")
    options = list(_options(function, _entries(sections.get("Args", ""))))
    places = [option for option in options if option.positional]
    console.print(" ".join(["usage:", program, *(option.usage for option in places), "[OPTIONS]"]), markup=False)
    for paragraph in [each for each in about.split("\n\n") if each]:
        console.print("\n" + " ".join(paragraph.split()), markup=False, highlight=False)
    if "Example" in sections:
        console.print("\n[b]example[/b]")
        console.print(sections["Example"].rstrip(), markup=False, highlight=False, soft_wrap=True)
    grouped = groups_of(function)
    grouped["output"] = [*(field.name for field in dataclasses.fields(Output)), "help"]
    sorted_ones = {name for names in grouped.values() for name in names}
    others = [option for option in options if option not in places and option.name not in sorted_ones]
    named = {option.name: option for option in options}
    named["help"] = _Option("help", "-h, --help", "Print this help.", False)
    groups = {"arguments": places, "options": others}
    groups |= {title: [named[name] for name in names] for title, names in grouped.items()}
    width = min(max(len(option.usage) for group in groups.values() for option in group), _WIDEST)
    for title, group in groups.items():
        if group:
            table = Table(box=None, padding=(0, 2, 0, 0), show_header=False, pad_edge=False)
            table.add_column(width=width + 2, style="cyan")
            table.add_column()
            for option in group:
                table.add_row(Text(f"  {option.usage}"), Text(option.text))
            console.print(f"\n[b]{title}[/b]")
            console.print(table)


def groups_of(function: Callable[..., Any]) -> dict[str, list[str]]:
    """Return the names of a command's options by the title of their group, from the section `Options:`."""
    entries = _entries(_sections(inspect.getdoc(function) or "")[1].get("Options", ""))
    return {title: re.split(r",\s*", names) for title, names in entries.items()}


def _sections(doc: str) -> tuple[str, dict[str, str]]:
    """Split a docstring into what precedes its sections, and the sections by title."""
    about, *parts = re.split(r"^(\w+):\n", doc, flags=re.MULTILINE)
    return about, dict(zip(parts[::2], parts[1::2], strict=True))


def _entries(section: str) -> dict[str, str]:
    """Return the texts of a section by name, each on one line."""
    found = re.findall(r"^ {4}(\w[\w ]*): (.*(?:\n {5,}.*)*)", section, flags=re.MULTILINE)
    return {name: " ".join(text.split()) for name, text in found}


def _options(function: Callable[..., Any], texts: dict[str, str]) -> Iterator[_Option]:
    for parameter in inspect.signature(function, eval_str=True).parameters.values():
        kind = typing.get_args(parameter.annotation)[:1]
        if kind and isinstance(kind[0], type) and dataclasses.is_dataclass(kind[0]):
            hints, words = typing.get_type_hints(kind[0], include_extras=True), meanings(kind[0])
            for field in dataclasses.fields(kind[0]):
                if tyro.conf.Suppress not in typing.get_args(hints[field.name]):
                    yield _option(
                        field.name, hints[field.name], field.default, " ".join(words.get(field.name, "").split())
                    )
        else:
            yield _option(parameter.name, parameter.annotation, parameter.default, texts.get(parameter.name, ""))


def _option(name: str, hint: Any, default: Any, text: str) -> _Option:
    kind, *marks = typing.get_args(hint) if typing.get_origin(hint) is typing.Annotated else (hint,)
    given = {key: value for mark in marks for key in ("name", "metavar") if (value := getattr(mark, key, None))}
    name, metavar = given.get("name", name), given.get("metavar") or _metavar(kind)
    if tyro.conf.Positional in marks:
        return _Option(name, metavar, _sentence(text), True)
    if not any(default is each for each in (None, (), False, inspect.Parameter.empty, dataclasses.MISSING)):
        shown = " ".join(map(str, default)) if isinstance(default, tuple) else str(default)
        text = f"{text.rstrip('.')} (default: {shown})."
    return _Option(name, f"--{name.replace('_', '-')} {metavar}".rstrip(), _sentence(text), False)


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:].rstrip(".") + "."


def _metavar(kind: Any) -> str:
    """Return the placeholder for the value of an option: `INT`, `{a,b}` or `TEXT ...`."""
    args = [each for each in typing.get_args(kind) if each not in (types.NoneType, ...)]
    if typing.get_origin(kind) is Literal:
        return f"{{{','.join(map(str, args))}}}"
    if typing.get_origin(kind) is tuple:
        return f"{_metavar(args[0])} ..."
    return _metavar(args[0]) if args else _METAVARS.get(kind, "VALUE")
