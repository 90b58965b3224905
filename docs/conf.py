"""The site: `make docs` builds it into docs/_build, without a network."""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE / "site"), str(HERE / "pictures")]

from rbd_site.sources import linkcode_resolve  # noqa: E402, F401

from rbd.installation import VERSION  # noqa: E402

project = "rbd"
author = "the rbd developers"
copyright = author
version = release = VERSION

extensions = [
    "myst_parser",
    "sphinx.ext.autodoc",
    "sphinx.ext.napoleon",
    "sphinx.ext.linkcode",
    "sphinx.ext.mathjax",
    "sphinx_design",
    "sphinx_copybutton",
    "rbd_site",
]
exclude_patterns = ["_build", "pictures", "site"]
templates_path = ["site/templates"]
default_role = "code"
highlight_language = "none"  # of literal blocks, which hold formulas; examples and fences name their language
needs_sphinx = "9.0"

# Pages
myst_enable_extensions = ["dollarmath", "attrs_block", "colon_fence"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 4
copybutton_prompt_text = r">>> |\.\.\. |\$ "
copybutton_prompt_is_regexp = True
copybutton_selector = "div.highlight-python pre, div.highlight-sh pre, div.highlight-pycon pre, div.doctest pre"

# API
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
autodoc_member_order = "bysource"
autodoc_preserve_defaults = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
python_use_unqualified_type_names = True
python_maximum_signature_line_length = 100
toc_object_entries_show_parents = "hide"

html_theme = "furo"
html_title = "rbd"
html_static_path = ["site/static"]
html_css_files = ["site.css"]
html_js_files = ["live.js"]
html_search_scorer = str(HERE / "site" / "scorer.js")
html_show_sphinx = False
html_copy_source = False
html_theme_options = {"top_of_page_buttons": []}
pygments_style = "a11y-high-contrast-light"
pygments_dark_style = "github-dark"
mathjax_path = "mathjax/tex-chtml-full.js"
