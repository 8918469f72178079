"""Build the site into `site/`: `python -m tools.docs`. Warnings, such as a link that leads nowhere, are errors.

Its search is then asked the questions of `tools/docs/search.py`, where Node.js is installed.

All pages are read again each time, because Sphinx does not know which of them take parts from the code.
"""

import argparse
import shutil
import subprocess
import sys

from tools.docs import search
from tools.docs.pages import ROOT

if __name__ == "__main__":
    argparse.ArgumentParser(prog="python -m tools.docs", description=__doc__.splitlines()[0]).parse_args()
    quiet = [] if sys.stdout.isatty() else ["--quiet"]  # a person sees how far it is; a log gets warnings alone
    options = ["--fresh-env", "--fail-on-warning", "--keep-going", *quiet, "-c", "docs", "-d", ".sphinx_cache"]
    command = [sys.executable, "-m", "sphinx", *options, ".", "site"]
    print("building the site: one to ten minutes", flush=True)
    status = subprocess.run(command, cwd=ROOT, check=False).returncode
    if not status:
        status = search.main() if shutil.which("node") else 0
        print(f"open {ROOT / 'site/index.html'}")
    sys.exit(status)
