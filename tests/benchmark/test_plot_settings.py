"""Pictures of the package do not depend on the settings of matplotlib that its user has."""

import os
import subprocess
import sys

DRAWN = """
import hashlib, os, pathlib, sys
from lissajous_env.console import cli
try:
    cli.main(["--version"])
except SystemExit:
    pass
import lissajous_env
from baselines.reproduce.drawing import Sheet, drawn_as
from lissajous_env.episodes import recording
from lissajous_env.render.sheet import save_sheet

for suffix in ("png", "svg", "pdf"):
    with drawn_as(suffix), Sheet("name", "Title with a $ sign", 5.0, 3.0) as sheet:
        axes = sheet.figure.subplots()
        axes.plot([0, 1, 2], [0, 1, -1], label="a line")
        axes.legend()
        print(hashlib.sha256(sheet.picture("A caption.").content).hexdigest())
policy = lissajous_env.policy("still", "experiment")
kept = recording.record(policy, lissajous_env.scenario("experiment", **{"task.duration": 0.5}), seed=1)
for suffix in ("svg", "pdf"):
    save_sheet(kept, f"sheet.{suffix}")
    print(hashlib.sha256(pathlib.Path(f"sheet.{suffix}").read_bytes()).hexdigest())
"""

HOSTILE = """
text.usetex: True
savefig.bbox: tight
savefig.dpi: 37
savefig.format: svg
savefig.transparent: True
figure.dpi: 33
font.family: A font that nobody has
axes.facecolor: black
lines.linewidth: 9
axes.prop_cycle: cycler('color', ['r'])
image.cmap: hot
svg.fonttype: none
pdf.fonttype: 42
path.simplify: False
figure.constrained_layout.use: False
"""


def drawn(folder, **environment):
    command, settings = [sys.executable, "-c", DRAWN], os.environ | environment
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder, env=settings, timeout=120)
    assert done.returncode == 0, done.stderr
    assert not done.stderr
    return done.stdout.split()[-5:]


def test_pictures_are_the_same_with_any_settings(tmp_path):
    # Oracle: the pictures of a user without settings, bit for bit.
    (tmp_path / "plain").mkdir()
    (tmp_path / "hostile").mkdir()
    (tmp_path / "hostile" / "matplotlibrc").write_text(HOSTILE)
    expected = drawn(tmp_path / "plain")
    assert len(set(expected)) == 5
    notebook = {"MPLBACKEND": "module://matplotlib_inline.backend_inline"}
    assert drawn(tmp_path / "hostile", **notebook) == expected
