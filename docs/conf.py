"""The site: ``make docs`` builds it from the pages of this folder; ``docs/_extension`` makes its reference."""

from __future__ import annotations

import os
import re
import sys
from pathlib import Path

from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parent / "_extension"))

from sci_lightning import __version__

project = "sci_lightning"
author = "the sci_lightning authors"
copyright = "the sci_lightning authors, MIT licence"
release = version = __version__

extensions = [
    "myst_nb",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "sphinx_copybutton",
    "sphinx_design",
    "reference",
]
exclude_patterns = ["_build", "_extension", "results/**/*.json"]

# Pages are plain Markdown, as they are read in the repository, too.
myst_enable_extensions = ["colon_fence", "dollarmath", "attrs_inline"]
myst_heading_anchors = 4
suppress_warnings = ["myst.header", "misc.highlighting_failure"]

# Notebooks hold no results: every build executes them, unless it is told to show them as they are.
nb_execution_mode = os.environ.get("NOTEBOOKS", "force")
nb_execution_timeout = 300
nb_execution_raise_on_error = True
nb_merge_streams = True

autodoc_typehints = "description"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "show-inheritance": False}
napoleon_google_docstring = True
napoleon_numpy_docstring = False

html_theme = "pydata_sphinx_theme"
html_title = "sci_lightning"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_theme_options = {
    "show_prev_next": True,
    "navigation_with_keys": False,
    "show_toc_level": 2,
    "header_links_before_dropdown": 6,
    "secondary_sidebar_items": ["page-toc"],
    "footer_start": ["copyright"],
    "footer_end": [],
}
html_sidebars = {"index": []}

PROJECT_PAGES = {"CONTRIBUTING.md": "contributing.md", "SECURITY.md": "security.md", "CHANGELOG.md": "changelog.md"}
PROJECT_PAGES["README.md"] = "../index.md"


def within_the_site(app: Sphinx, page: str, source: list[str]) -> None:
    """Let links to the pages beside ``docs/`` lead to their places in the site."""
    for name, place in PROJECT_PAGES.items():
        source[0] = re.sub(rf"\]\((?:\.\./)+{name}", f"](/reference/{place}", source[0])


def setup(app: Sphinx) -> None:
    """Register what this site does besides."""
    app.connect("source-read", within_the_site)
