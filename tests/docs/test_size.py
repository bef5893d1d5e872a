"""Size of the packages: it may only fall, until a change of scope raises a limit in the same commit."""

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FILES = [path for package in ("lissajous_env", "baselines", "training") for path in (ROOT / package).rglob("*.py")]
LINES = 56_400
"""Lines of the packages."""
MODULES = 425
"""Files of the packages."""
TESTS = 39_500
"""Lines of the tests."""


def lines_of(paths):
    return sum(len(path.read_text(encoding="utf-8").splitlines()) for path in paths)


def test_the_packages_do_not_grow():
    assert lines_of(FILES) <= LINES
    assert len(FILES) <= MODULES


def test_the_tests_do_not_grow():
    assert lines_of((ROOT / "tests").rglob("*.py")) <= TESTS


def test_files_have_at_most_400_lines_and_functions_80():
    for path in FILES:
        text = path.read_text(encoding="utf-8")
        assert len(text.splitlines()) <= 400, path
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                assert node.end_lineno - node.lineno < 80, (path, node.name)
