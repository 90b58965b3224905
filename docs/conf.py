"""The site: `make docs` builds it into docs/_build, without a network."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from rbd.installation import VERSION  # noqa: E402

project = "rbd"
author = "the rbd developers"
copyright = author
version = release = VERSION

extensions = ["myst_parser", "sphinx.ext.mathjax"]
exclude_patterns = ["_build", "pictures", "site"]
myst_enable_extensions = ["dollarmath", "attrs_block", "colon_fence"]
myst_fence_as_directive = ["math"]
myst_heading_anchors = 4
default_role = "code"

html_theme = "furo"
html_title = "rbd"
html_show_sphinx = False
