"""Size of the packages: it may only fall, until a change of scope raises a limit in the same commit."""

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FILES = [path for package in ("lissajous_env", "baselines", "training") for path in (ROOT / package).rglob("*.py")]
LINES = 40_916
"""Lines of the packages."""
MODULES = 259
"""Files of the packages."""
TESTS = 26_000
"""Lines of the tests."""


def lines_of(paths):
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)


def test_neither_the_packages_nor_the_tests_grow():
    assert lines_of(FILES) <= LINES
    assert len(FILES) <= MODULES
    assert lines_of((ROOT / "tests").rglob("*.py")) <= TESTS


def lines_of_code(function, lines):
    """Return the number of lines of a function without docstring, comments, blank lines and functions within it."""
    body = function.body[1:] if ast.get_docstring(function) else function.body
    inner = {
        line
        for node in ast.walk(function)
        if isinstance(node, ast.FunctionDef) and node is not function
        for line in range(node.lineno, node.end_lineno + 1)
    }
    numbers = range(body[0].lineno, function.end_lineno + 1) if body else ()
    texts = [lines[number - 1].strip() for number in numbers if number not in inner]
    return sum(bool(text) and not text.startswith("#") for text in texts)


def test_files_have_at_most_400_lines_and_functions_80_of_code():
    for path in FILES:
        lines = path.read_text(encoding="utf-8").splitlines()
        assert len(lines) <= 400, path
        for node in ast.walk(ast.parse("\n".join(lines))):
            if isinstance(node, ast.FunctionDef):
                assert lines_of_code(node, lines) <= 80, (path, node.name)
