"""Build the site into `site/`: `python -m tools.docs`. Warnings, such as a link that leads nowhere, are errors.

Options of Sphinx may follow; `-E` reads all pages again.
"""

import subprocess
import sys

from tools.docs.pages import ROOT

if __name__ == "__main__":
    sphinx = [sys.executable, "-m", "sphinx", "--fail-on-warning", "--keep-going", "--quiet", "-b", "html"]
    command = [*sphinx, "-c", "docs", "-d", ".sphinx_cache", *sys.argv[1:], ".", "site"]
    status = subprocess.run(command, cwd=ROOT, check=False).returncode
    if not status:
        print(f"open {ROOT / 'site/index.html'}")
    sys.exit(status)
