"""How Sphinx builds the site; `make docs` runs it. Its source is the whole repository, so all links are as on disk."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from tools.docs.pages import filled
from tools.docs.search import indexed

project = html_title = "Joybridge"
extensions = ["myst_parser"]
root_doc = "docs/index"
include_patterns = [
    "*.md",
    "docs/*.md",
    "docs/reference/*.md",
    "proto/examples/*/README.md",
    "results/*.md",
    "results/*/README.md",
]
exclude_patterns = [
    "README.md",
    "docs/pypi.md",
    ".*",
    "site",
    "runs",
    "build",
    "dist",
    "proto/examples/*/node_modules",
    "proto/examples/*/build",
]
myst_heading_anchors = 4
smartquotes_action = "qe"  # not D: --flag stays as it is typed
html_theme = "furo"
html_theme_options = {"navigation_with_keys": True}
html_extra_path = ["start"]  # the page that leads from the site's root to this folder
html_static_path = ["style"]
html_css_files = ["joybridge.css"]
html_js_files = ["search.js"]
html_favicon = "../trainer/joybridge/viewer/page/icon.svg"
html_show_sphinx = False
html_show_copyright = False
html_copy_source = False


def setup(app):  # noqa: D103 - Sphinx calls it
    app.connect("source-read", _fill)


def _fill(app, page, source):
    path = f"{page}.md"
    source[0] = indexed(path, filled(path, source[0]))
