"""How the documentation is built: `make docs`. Nothing is fetched, when built or when read."""

from __future__ import annotations

import sys
from pathlib import Path

from numpydoc.xref import DEFAULT_LINKS
from pygments.lexers.special import TextLexer
from sphinx.application import Sphinx

import foucault

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))  # the style of the gallery

project = "Foucault"
author = "The Foucault authors"
project_copyright = "Apache-2.0"
release = version = foucault.__version__

extensions = [
    "myst_parser",
    "numpydoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.intersphinx",
    "sphinx_gallery.gen_gallery",
    "sphinx_copybutton",
    "sphinx_design",
]
templates_path = [str(HERE / "templates")]  # else below build/docs
smartquotes = False  # messages stand as they are printed
nitpicky = True
default_role = "code"  # `x` of a docstring is a name

myst_enable_extensions = ["colon_fence"]
myst_heading_anchors = 4

autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings say them, with shapes and units
autosummary_imported_members = True
numpydoc_show_class_members = False  # the template lists them

# What is linked of others is listed in docs/inventories: their own inventories need the network.
intersphinx_mapping = {
    name: (f"https://{site}/", str(HERE / "inventories" / f"{name}.inv"))
    for name, site in (
        ("numpy", "numpy.org/doc/stable"),
        ("scipy", "docs.scipy.org/doc/scipy"),
        ("pandas", "pandas.pydata.org/docs"),
    )
}
intersphinx_timeout = 1
DEFAULT_LINKS.clear()  # of Python's own types nothing is linked
numpydoc_xref_param_type = True
numpydoc_xref_ignore = "all"  # but for these words
numpydoc_xref_aliases = {
    "ndarray": "numpy.ndarray",
    "DataFrame": "pandas.DataFrame",
    "Rotation": "scipy.spatial.transform.Rotation",
}

sphinx_gallery_conf = {
    "examples_dirs": str(HERE.parent / "examples" / "gallery"),
    "gallery_dirs": "gallery",
    "filename_pattern": r"\.py$",
    "within_subsection_order": "FileNameSortKey",
    "reset_modules": ("matplotlib", "gallery_style.style"),
    "abort_on_example_error": True,
    "download_all_examples": False,
    "min_reported_time": 1e6,
    "show_memory": False,
    "show_signature": False,
    "thumbnail_size": (420, 264),
}

html_theme = "pydata_sphinx_theme"
html_title = "Foucault"
html_static_path = ["assets"]
html_css_files = ["site.css"]
html_show_sourcelink = False
html_copy_source = False
html_context = {"default_mode": "auto"}
html_theme_options = {
    "header_links_before_dropdown": 7,
    "navbar_persistent": ["search-button"],
    "navigation_with_keys": False,
    "pygments_light_style": "a11y-high-contrast-light",
    "pygments_dark_style": "a11y-high-contrast-dark",
    "secondary_sidebar_items": ["page-toc"],
    "show_toc_level": 2,
    "footer_start": ["copyright"],
    "footer_end": [],
}
html_sidebars = {"index": []}


def setup(app: Sphinx) -> None:
    app.add_lexer("csv", TextLexer)
