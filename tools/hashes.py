"""Write the hashes of all packages in constraints.txt into hashes.txt: `python -m tools.hashes`.

`uv` resolves the extras `dev` and `docs` for all systems and Pythons, and takes the hashes of every file of a version
from the index of packages. PyTorch, and what only PyTorch needs, is left out: there is a build of it for each kind of
accelerator, each with its own index. `uv` is installed into `.venv-hashes` once.

Exit status: that of `uv`; 77 where it cannot be had.
"""

import argparse
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
ENVIRONMENT = ROOT / ".venv-hashes"  # which git ignores
HASHES = ROOT / "hashes.txt"
MISSING = 77  # exit status: nothing was written
HEAD = """\
# Every file that may be installed of the packages in constraints.txt; `python -m tools.hashes` writes this.
# Install PyTorch first, then: pip install --require-hashes --requirement hashes.txt
"""


def main() -> int:
    """Write hashes.txt and return the exit status."""
    argparse.ArgumentParser(prog="python -m tools.hashes", description=__doc__.splitlines()[0]).parse_args()
    commands = [[sys.executable, "-m", "venv"], [str(ENVIRONMENT / "bin/python"), "-m", "pip", "install", "--quiet"]]
    for command, what in zip(commands, (str(ENVIRONMENT), "uv>=0.8"), strict=True):
        if not (ENVIRONMENT / "bin/uv").exists() and subprocess.run([*command, what], check=False).returncode:
            print("nothing was written: uv cannot be installed", file=sys.stderr)
            return MISSING
    extras = ["--extra", "dev", "--extra", "docs", "--constraint", "constraints.txt"]
    form = ["--universal", "--python-version", "3.11", "--generate-hashes", "--no-annotate", "--no-header", "--quiet"]
    form.append("--no-strip-extras")  # pip asks for the hashes of coverage[toml], not of coverage
    done = subprocess.run(
        [str(ENVIRONMENT / "bin/uv"), "pip", "compile", "pyproject.toml", *extras, *form, "--override", "-"],
        cwd=ROOT,
        input="torch; python_version < '3'\n",  # nowhere
        stdout=subprocess.PIPE,
        text=True,
        check=False,
    )
    if not done.returncode:
        HASHES.write_text(HEAD + done.stdout, encoding="utf-8")
    return done.returncode


if __name__ == "__main__":
    sys.exit(main())
