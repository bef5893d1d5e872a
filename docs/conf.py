"""Settings of the documentation: `sphinx-build -W docs build/docs`.

Pages about scenarios, and the drawings, are made from the code when the build begins (`docs/generator`). Nothing is
fetched from elsewhere.
"""

import sys
import tomllib
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

from docs import generator  # noqa: E402

project = "lissajous-env"
author = "The lissajous-env authors"
copyright = "the lissajous-env authors, MIT licence"
release = tomllib.loads((HERE.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]

extensions = ["myst_nb", "sphinx.ext.autodoc", "sphinx.ext.autosummary", "sphinx.ext.napoleon"]
exclude_patterns = ["drawn", "generator", "**/__pycache__", "figures.json"]

html_theme = "furo"
html_title = f"lissajous-env {release}"
html_static_path = ["static"]
html_css_files = ["tables.css"]
html_extra_path = ["drawn/site"]
html_show_sphinx = False
html_copy_source = False

myst_enable_extensions = ["colon_fence", "dollarmath", "attrs_block"]
myst_heading_anchors = 4

# The notebooks run from top to bottom in each build; an error ends it.
nb_execution_mode = "force"
nb_execution_raise_on_error = True
nb_execution_in_temp = True
nb_execution_timeout = 120
# This one requires torch, and ten minutes; a test runs it in short.
nb_execution_excludepatterns = ["notebooks/learning.md"]
nb_merge_streams = True
nb_output_stderr = "remove"

# Optional libraries need not be installed to document the modules that use them.
autodoc_mock_imports = ["benchmarl", "ray", "stable_baselines3", "tensordict", "torch", "torchrl"]
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
napoleon_use_rtype = False
default_role = "code"


def setup(app):  # noqa: D103
    generator.setup(app)
