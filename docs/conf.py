"""The site: ``make docs`` builds it from the pages of this folder; ``docs/_extension`` makes its reference."""

from __future__ import annotations

import os
import re
import sys
from importlib.util import find_spec
from pathlib import Path

from docutils import nodes
from docutils.utils.math import latex2mathml
from sphinx.application import Sphinx
from sphinx.writers.html5 import HTML5Translator

from sci_lightning import __version__
from sci_lightning.weights import shipped

ROOT = Path(__file__).parent.parent
sys.path.insert(0, str(ROOT / "docs" / "_extension"))  # where Sphinx finds the extension `reference`

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
nb_execution_in_temp = True
nb_merge_streams = True
nb_execution_excludepatterns = [] if find_spec("torchvision") else ["tutorials/deepinv*"]  # deepinv imports it

autodoc_typehints = "description"
autodoc_member_order = "bysource"
autodoc_default_options = {"members": True, "show-inheritance": False}
napoleon_google_docstring = True
napoleon_numpy_docstring = False

html_math_renderer = "mathml"
html_theme = "pydata_sphinx_theme"
html_title = "sci_lightning"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_search_scorer = str(ROOT / "docs" / "_static" / "search_scores.js")
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
html_context = {"default_mode": "auto"}  # by the reader's system, light or dark
html_sidebars = {"index": []}

OUTSIDE = {
    "reference/contributing": "CONTRIBUTING.md",
    "reference/security": "SECURITY.md",
    "reference/changelog": "CHANGELOG.md",
    **{f"reference/weights-{name}": f"sci_lightning/weights/{name}.md" for name in shipped()},
}
"""Pages of the site that stand elsewhere in the repository; in this folder there is an empty file in their place."""


def read(app: Sphinx, page: str, source: list[str]) -> None:
    """Read a page that stands elsewhere, and let links between pages lead to their places in the site."""
    file = ROOT / OUTSIDE[page] if page in OUTSIDE else ROOT / "docs" / f"{page}.md"
    if page in OUTSIDE:
        source[0] = file.read_text()
    places = {ROOT / path: f"/{place}.md" for place, path in OUTSIDE.items()} | {ROOT / "README.md": "/index.md"}

    def moved(link: re.Match[str]) -> str:
        target, place = (file.parent / link[1]).resolve(), link[1]
        if target in places:
            place = places[target]
        elif page in OUTSIDE and target.exists():
            place = os.path.relpath(target, ROOT / "docs" / "reference")
        return f"]({place}{link[2] or ''})"

    source[0] = re.sub(r"\]\(([^)#:\s]+)(#[^)\s]*)?\)", moved, source[0])


def formula(writer: HTML5Translator, node: nodes.math | nodes.math_block) -> None:
    """Write a formula as MathML, which browsers draw by themselves: the site needs no other one to be read."""
    block = isinstance(node, nodes.math_block)
    source = re.sub(r"\\[bB]igg?[lr]?(?![a-z])", "", node.astext().strip())  # MathML's brackets grow by themselves
    tree = latex2mathml.tex2mathml(source, as_block=block)
    writer.body.append(f"<p>{tree}</p>" if block else tree)
    raise nodes.SkipNode


def setup(app: Sphinx) -> None:
    """Register what this site does besides."""
    app.connect("source-read", read)
    app.add_html_math_renderer("mathml", inline_renderers=(formula, None), block_renderers=(formula, None))
