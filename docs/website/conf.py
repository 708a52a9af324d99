"""Settings of the documentation site; `python -m docs.website OUT` gathers its pages and builds it."""

from __future__ import annotations

import sys
from importlib.metadata import version as version_of
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

project = "MirrorCam"
author = "The MirrorCam authors"
version = release = version_of("mirrorcam")
language = "en"

extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "docstrings", "mathml"]
root_doc = "index"
# Two hyphens begin an option: no dashes.
smartquotes_action = "qe"
exclude_patterns = ["images/**", "schemas/**"]
nitpicky = True
# Types of other packages, and our types that have no page.
nitpick_ignore_regex = [("py:.*", ".*")]

myst_enable_extensions = ["attrs_block", "attrs_inline", "colon_fence", "dollarmath", "deflist"]
myst_heading_anchors = 4
myst_linkify_fuzzy_links = False

autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_type_aliases = {name: name for name in ("FloatArray", "Grey", "Samples", "ArrayLike", "Calls", "Progress")}
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
maximum_signature_line_length = 80
add_module_names = False
napoleon_google_docstring = False
napoleon_use_rtype = False
napoleon_use_ivar = True
python_use_unqualified_type_names = True
toc_object_entries = False

html_theme = "furo"
html_title = "MirrorCam"
html_static_path = ["_static"]
html_css_files = ["site.css"]
html_js_files = ["toy.js"]
html_copy_source = False
html_show_sourcelink = False
html_show_sphinx = False
html_show_copyright = False
html_math_renderer = "mathml"
html_theme_options = {"sidebar_hide_name": False, "navigation_with_keys": False}
