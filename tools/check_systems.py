"""Whether every dependency has a wheel for Windows and macOS: `python -m tools.check_systems`.

For each system and Python, the wheels of all that the extras need, at the versions of constraints.txt, are resolved by
pip (`install --dry-run --only-binary :all: --platform …`), and nothing is installed. Which packages those are is read
from the metadata of this environment, with the markers of the other system. Nothing is run there: this shows that an
installation can succeed, not that the programs work.

Exit status: 0, or 1 if a wheel is missing.
"""

import argparse
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from importlib.metadata import PackageNotFoundError, distribution
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PACKAGE = "joybridge[simulator,gym,train,export,viewer,compare]"
PYTHONS = ("3.11", "3.12", "3.13")
SYSTEMS: dict[str, dict[str, str]] = {  # how pip calls them, and what the markers of requirements see there
    "win_amd64": {"sys_platform": "win32", "platform_system": "Windows", "os_name": "nt", "platform_machine": "AMD64"},
    "macosx_14_0_arm64": {
        "sys_platform": "darwin",
        "platform_system": "Darwin",
        "os_name": "posix",
        "platform_machine": "arm64",
    },
}
MISSING = re.compile(r"No matching distribution found for ([\w.-]+)")


def main() -> int:
    """Print what is missing on each system and Python; return the exit status."""
    parser = argparse.ArgumentParser(description="Resolve the wheels of all dependencies for Windows and macOS.")
    parser.add_argument("--pythons", nargs="+", default=PYTHONS, help="default: %(default)s")
    options = parser.parse_args()
    failed = False
    for system, markers in SYSTEMS.items():
        for python in options.pythons:
            needed = closure(PACKAGE, markers | {"python_version": python, "python_full_version": f"{python}.0"})
            missing = list(without_wheel(needed, system, python))
            failed |= bool(missing)
            found = f"no wheel for {', '.join(missing)}" if missing else "a wheel for each"
            print(f"{system}, Python {python}: {len(needed)} packages, {found}", flush=True)
    return int(failed)


def closure(package: str, markers: Mapping[str, str]) -> dict[str, str]:
    """Return what a package with extras needs where requirements see these markers: names and their pinned versions."""
    pins = dict(re.findall(r"^([\w.-]+)==(\S+)", (ROOT / "constraints.txt").read_text(), re.MULTILINE))
    versions = {canonicalize_name(name): version for name, version in pins.items()}
    needed: dict[str, str] = {}
    waiting, seen = [Requirement(package)], set()
    while waiting:
        requirement = waiting.pop()
        name = canonicalize_name(requirement.name)
        if name != "joybridge":
            needed[name] = versions.get(name, "")
        for extra in ("", *sorted(requirement.extras)):
            if (name, extra) not in seen:
                seen.add((name, extra))
                waiting += [one for one in _requirements(name) if _applies(one, {**markers, "extra": extra})]
    return needed


def _requirements(name: str) -> list[Requirement]:
    """Return what an installed package requires; nothing of one that is not installed here."""
    try:
        return [Requirement(text) for text in distribution(name).requires or ()]
    except PackageNotFoundError:
        return []


def _applies(requirement: Requirement, environment: dict[str, str]) -> bool:
    return requirement.marker is None or requirement.marker.evaluate(environment)


def without_wheel(needed: Mapping[str, str], system: str, python: str) -> Iterator[str]:
    """Yield the packages that have no wheel for a system and a Python. Raises CalledProcessError for other failures."""
    left = {name: f"{name}=={version}" if version else name for name, version in needed.items()}
    with tempfile.TemporaryDirectory() as folder:
        while True:
            flags = ["--dry-run", "--quiet", "--no-deps", "--ignore-installed", "--only-binary", ":all:"]
            target = ["--platform", system, "--python-version", python, "--target", folder]
            command = [sys.executable, "-m", "pip", "install", *flags, *target, *left.values()]
            result = subprocess.run(command, capture_output=True, text=True, check=False)
            if not result.returncode:
                return
            missing = MISSING.search(result.stderr)
            name = canonicalize_name(missing[1]) if missing else ""
            if name not in left:
                raise subprocess.CalledProcessError(result.returncode, command[:4], result.stdout, result.stderr)
            yield left.pop(name)


if __name__ == "__main__":
    sys.exit(main())
