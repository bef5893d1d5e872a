"""Packages: an sdist that can be tested, a wheel with weights and types, a valid citation."""

import shutil
import subprocess
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BUILD = "import setuptools.build_meta as b, sys; to = sys.argv[1]; b.build_sdist(to); b.build_wheel(to)"
MADE = ("docs/drawn/", "docs/scenarios/")
"""Files that a build of the documentation makes in its sources."""
NOT_SOURCE = (".git", ".venv", "build", "dist", "results", "runs", "*.egg-info", "__pycache__", ".*_cache")


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Names in the sdist, without its top folder, and in the wheel."""
    folder = tmp_path_factory.mktemp("packaging")
    shutil.copytree(ROOT, folder / "source", ignore=shutil.ignore_patterns(*NOT_SOURCE))
    (folder / "dist").mkdir()
    command = [sys.executable, "-c", BUILD, str(folder / "dist")]
    done = subprocess.run(command, cwd=folder / "source", capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (sdist,), (wheel,) = (folder / "dist").glob("*.tar.gz"), (folder / "dist").glob("*.whl")
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    with zipfile.ZipFile(wheel) as archive:
        return names, set(archive.namelist())


def files_in(*folders):
    """Files of the checkout in some folders, as names from its root; what Python or a tool makes is none of them."""
    paths = [path for folder in folders for path in (ROOT / folder).rglob("*") if path.is_file()]
    names = {path.relative_to(ROOT).as_posix() for path in paths if "__pycache__" not in path.parts}
    return {name for name in names if not name.startswith(MADE)}


def test_the_sdist_holds_what_its_tests_and_readers_need(built):
    sdist, _ = built
    top = {"CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "SECURITY.md", "LICENSE", "README.md", "pyproject.toml"}
    assert (top | files_in("tests", "docs", "benchmarks", "lissajous_env", "baselines", "training")) - sdist == set()


def test_the_wheel_holds_the_packages_and_nothing_else(built):
    _, wheel = built
    packages = files_in("lissajous_env", "baselines", "training")
    assert packages - wheel == set()
    assert {"lissajous_env/py.typed", "baselines/py.typed", "training/py.typed"} <= wheel
    assert {name for name in wheel if ".dist-info/" not in name} - packages == set()


def test_the_citation_names_the_version_that_is_built():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    lines = (ROOT / "CITATION.cff").read_text().splitlines()
    assert f"version: {version}" in lines
    assert "cff-version: 1.2.0" in lines
