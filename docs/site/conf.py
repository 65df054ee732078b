"""The site: pages of the repository as they lie, so that a link leads to the same page here and in a checkout.

`make docs` builds it, in the root of the repository; every warning is an error, broken links and anchors among them.
"""

from __future__ import annotations

from scarfmt import __version__

project = "scarfmt"
release = __version__
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon", "docs.site.filled"]
root_doc = "docs/README"
include_patterns = [
    "*.md", "docs/**.md", "examples/*.md", "web/README.md", "web/wasm/*.md", "web/test/data/*.md",
    "fuzz/regressions/*.md", "conformance/*.md", "conformance/decoders/js/*.md",
]  # fmt: skip
myst_heading_anchors = 4
default_role = "code"
autodoc_member_order = "bysource"
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented"
napoleon_numpy_docstring = False
pygments_style = "friendly"

# Nothing is asked of another host: fonts are the reader's, and there is no counter.
html_theme = "furo"
html_title = f"scarfmt {release}"
html_extra_path = ["index.html"]
html_show_sphinx = False
html_copy_source = False
