"""Finds the program and runs it as Python would."""

import importlib.util
import re
import runpy
import sys
from collections.abc import Callable, Sequence
from importlib import import_module
from importlib.metadata import EntryPoint, PackageNotFoundError, distribution
from pathlib import Path
from typing import NamedTuple

SCRIPTS = ("console_scripts", "gui_scripts")
MAIN = re.compile(r"^if __name__ == ['\"]__main__['\"]", re.MULTILINE)  # what a module begins with that is run
MOST = 12  # modules that an error names


class ProgramError(Exception):
    """There is no such program. The text names what there is."""


class Program(NamedTuple):
    """A program: where its own modules are, and a function that runs it to its end."""

    name: str
    root: Path  # the file, or the folder of its package
    beside: Path | None  # where a file finds others when it is started in its folder
    run: Callable[[], object]


def find_program(place: str, arguments: Sequence[str]) -> Program:
    """Return the program FILE, MODULE, or PACKAGE[:SCRIPT] of an installed package. Raises ProgramError."""
    sys.argv = [place, *arguments]
    path = Path(place)
    if path.suffix == ".py" or path.is_file():
        if not path.is_file():
            raise ProgramError(f"there is no file {place}")
        path = path.resolve()
        sys.path.insert(0, str(path.parent))
        sys.argv[0] = str(path)
        return Program(path.stem, path, path.parent, lambda: runpy.run_path(str(path), run_name="__main__"))
    package, _, script = place.partition(":")
    if not script and _runs(package):
        return _module(package)
    return _script(place, package, script)


def _module(module: str) -> Program:
    """Return what `python -m module` runs."""
    spec = importlib.util.find_spec(module)
    origin = Path(spec.origin) if spec and spec.origin else Path(module)
    root = origin.parent if spec and spec.submodule_search_locations else origin
    return Program(module, root, None, lambda: runpy.run_module(module, run_name="__main__", alter_sys=True))


def _runs(module: str) -> bool:
    """Return whether `python -m module` would run something."""
    try:
        spec = importlib.util.find_spec(module)
        if spec is None or spec.origin is None:
            return False
        return not spec.submodule_search_locations or importlib.util.find_spec(f"{module}.__main__") is not None
    except (ImportError, ValueError):
        return False


def _script(place: str, package: str, script: str) -> Program:
    try:
        found = [point for point in distribution(package).entry_points if point.group in SCRIPTS]
    except (PackageNotFoundError, ValueError):
        raise ProgramError(
            f"there is no file, no module that runs, and no installed package {package!r}; expected FILE, MODULE or "
            "PACKAGE:SCRIPT"
        ) from None
    if not found:
        return _only_module(package)
    chosen = [point for point in found if not script or point.name == script]
    if len(chosen) != 1:
        names = ", ".join(point.name for point in found)
        raise ProgramError(f"the package {package!r} has the scripts {names}; name one of them as {package}:SCRIPT")
    (point,) = chosen
    sys.argv[0] = point.name
    spec = importlib.util.find_spec(point.module.partition(".")[0])
    root = Path(spec.origin).parent if spec and spec.origin else Path(place)
    return Program(point.name, root, None, lambda: _run_entry(point))


def _only_module(package: str) -> Program:
    """Return the one module of an installed package without scripts that says what it does when it is run."""
    sources = [file for file in distribution(package).files or () if file.suffix == ".py"]
    files = [file for file in sources if file.name != "__init__.py" and not file.parts[0].startswith("test")]
    running = [file for file in files if MAIN.search(Path(str(file.locate())).read_text(errors="replace"))]
    names = sorted(".".join(file.with_suffix("").parts).removesuffix(".__main__") for file in running or files)
    if len(names) == 1 and running:
        return _module(names[0])
    raise ProgramError(
        f"the package {package!r} has no script; {'these modules run' if running else 'its modules are'}: "
        f"{', '.join(names[:MOST]) or 'none'}{', …' if len(names) > MOST else ''}; name one of them"
    )


def _run_entry(point: EntryPoint) -> None:
    """Do what the script does that pip writes for an entry point."""
    sys.modules["__main__"] = import_module(point.module)
    lines = [f"from {point.module} import {point.attr.partition('.')[0]}", "import sys", f"sys.exit({point.attr}())"]
    exec(compile("\n".join(lines), point.name, "exec"), {"__name__": "__main__"})  # noqa: S102
