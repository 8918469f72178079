"""Change the code in small ways and count how many changes the tests notice: `python -m tools.mutants loss`.

Cosmic Ray makes the changes ("mutants"): another operator, comparison or number, a condition turned around, a loop that
is left out. They are drawn with a seed, from as many places of the code as possible. Each is loaded in place of the
module by a process that then runs the tests of its part. A mutant that cannot be imported is not counted: most of them
are changed annotations. Tests that take ten times as long as without a change have noticed it, too.

Cosmic Ray is installed into `.venv-mutants` once. Exit status: 0; 1 if the tests fail without a change, or notice fewer
than 85 % of the changes of a part; 77 where the package cannot be had.
"""

import argparse
import importlib
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from importlib.abc import MetaPathFinder
from importlib.machinery import ModuleSpec, SourceFileLoader
from importlib.util import spec_from_file_location
from pathlib import Path
from types import CodeType
from typing import NamedTuple

from tools.checked import MISSING, make_environment

ROOT = Path(__file__).resolve().parents[1]
ENVIRONMENT = ROOT / ".venv-mutants"  # which git ignores
LEAST = 0.85  # of the changes, that tests notice
PARTS = {  # of which module or folder, and which tests hold it
    "gae": ("trainer/joybridge/ppo/gae.py", ["gae"]),
    "loss": ("trainer/joybridge/ppo/loss.py", ["ppo", "conditions", "own_parts", "memory"]),
    "distributions": ("trainer/joybridge/ppo/distributions.py", ["distributions", "conditions"]),
    "layouts": (
        "trainer/joybridge/layouts",
        ["layouts", "layout_reading", "actions", "input_measures", "common_device", "conditions", "continuous", "maps"],
    ),
    "codec": ("proto/joybridge/contract/codec.py", ["codec", "tensors"]),
}
# What every test imports is imported once, before the processes of the mutants are forked.
SHARED = ("torch", "numba", "scipy.stats", "hypothesis", "pytest", "pydantic", "grpc", "google.protobuf", "rich")
DRAW = """
import json, random, sys
from collections import Counter
from pathlib import Path
from cosmic_ray.ast import Visitor, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names

class Places(Visitor):
    def __init__(self, operator):
        self.operator, self.found = operator, []
    def visit(self, node):
        self.found += self.operator.mutation_positions(node)
        return node

seed, count, *paths = sys.argv[1:]
found = []
for path in paths:
    text = Path(path).read_text()
    for name in operator_names():
        if not name.startswith("core/Variable"):  # they need names of variables
            operator = get_operator(name)()
            places = Places(operator)
            places.walk(get_ast(text))
            found += [(path, place[0], name, number) for number, place in enumerate(places.found)]
random.Random(int(seed)).shuffle(found)
seen, ranked = Counter(), []
for path, place, name, number in found:
    ranked.append((seen[path, place], path, place, name, number))
    seen[path, place] += 1
ranked.sort(key=lambda one: one[0])  # the second mutant of a place comes after the first one of every place
print(json.dumps([
    (path, line, name.removeprefix("core/"), mutate_code(Path(path).read_text(), get_operator(name)(), number))
    for _, path, (line, _), name, number in ranked[: int(count)]
]))
"""


class Mutant(NamedTuple):
    """A changed module: its file, the line and kind of the change, and its text."""

    path: str
    line: int
    change: str
    text: str


def main(arguments: Sequence[str] | None = None) -> int:
    """Make mutants of some parts, and return the exit status."""
    parser = argparse.ArgumentParser(description="Count how many small changes of the code the tests notice.")
    parser.add_argument("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)}; default: all")
    parser.add_argument("--mutants", type=int, default=40, metavar="N", help="per part; default %(default)s")
    parser.add_argument("--seed", type=int, default=0, help="of the draw; default %(default)s")
    options = parser.parse_args(arguments)
    if unknown := set(options.parts) - set(PARTS):
        parser.error(f"{', '.join(sorted(unknown))}: expected {', '.join(PARTS)}")
    if problem := install():
        print(f"not checked: Cosmic Ray cannot be installed: {problem}", file=sys.stderr)
        return MISSING
    os.chdir(ROOT)
    os.environ["OMP_NUM_THREADS"] = "1"
    for module in SHARED:
        importlib.import_module(module)
    return max(examine(part, options.mutants, options.seed) for part in options.parts or PARTS)


def install() -> str:
    """Install Cosmic Ray, unless it is there, and return what is in the way."""
    there = (ENVIRONMENT / "bin/cosmic-ray").exists()
    return "" if there else make_environment(ENVIRONMENT, sys.executable, ["cosmic-ray>=8.4"])


def examine(part: str, count: int, seed: int) -> int:
    """Count which mutants of a part its tests notice. Return an exit status."""
    place, names = PARTS[part]
    files = [f"tests/test_{name}.py" for name in names]
    paths = [place] if place.endswith(".py") else [str(path) for path in sorted(Path(place).glob("*.py"))]
    begin = time.monotonic()
    status = run(Mutant(paths[0], 0, "", Path(paths[0]).read_text(encoding="utf-8")), files, 3600.0)
    if status:
        print(f"{part}: the tests fail without a change (status {status})", file=sys.stderr)
        return 1
    seconds = 10.0 * (time.monotonic() - begin)
    noticed, missed = 0, []
    for mutant in draw(paths, count, seed):
        status = run(mutant, files, seconds)
        if status == STILLBORN:
            continue
        noticed += status != 0
        if not status:
            missed.append(f"  not noticed: {mutant.path}:{mutant.line}: {mutant.change}")
            print(missed[-1], flush=True)
        if noticed + len(missed) == count:
            break
    share = noticed / (noticed + len(missed))
    print(f"{part}: {noticed} of {noticed + len(missed)} mutants noticed ({share:.0%}), seed {seed}", flush=True)
    return int(share < LEAST)


def draw(paths: Sequence[str], count: int, seed: int) -> list[Mutant]:
    """Return mutants of some modules, three times as many as `count`, because some cannot be imported."""
    command = [str(ENVIRONMENT / "bin/python"), "-c", DRAW, str(seed), str(3 * count), *paths]
    found = json.loads(subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout)
    return [Mutant(*one) for one in found]


STILLBORN = 200  # exit status of a process whose mutant cannot be imported


def run(mutant: Mutant, files: Sequence[str], seconds: float) -> int:
    """Run tests with a mutant in a process of its own, and return its exit status; 1 if it takes too long."""
    child = os.fork()
    if not child:
        try:
            os.setpgid(0, 0)
            silent = os.open(os.devnull, os.O_RDWR)
            for descriptor in (0, 1, 2):
                os.dup2(silent, descriptor)
            os._exit(test(mutant, files))
        finally:
            os._exit(1)
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        ended, status = os.waitpid(child, os.WNOHANG)
        if ended:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.02)
    os.killpg(child, signal.SIGKILL)
    os.waitpid(child, 0)
    return 1


def test(mutant: Mutant, files: Sequence[str]) -> int:
    """Run tests with a mutant in this process, and return an exit status."""
    import pytest

    sys.meta_path.insert(0, Finder(mutant))
    try:
        importlib.import_module(module_name(mutant.path))
    except BaseException:
        return STILLBORN
    options = ("-x", "-p", "no:cacheprovider", "-W", "ignore::pytest.PytestAssertRewriteWarning", "-m", "not nightly")
    return int(pytest.main([*files, *options]))


class Finder(MetaPathFinder):
    """Finds a mutant in place of its module."""

    def __init__(self, mutant: Mutant) -> None:
        """Find this mutant."""
        self.mutant, self.name = mutant, module_name(mutant.path)

    def find_spec(self, name: str, path: object, target: object = None) -> ModuleSpec | None:
        """Return how to load the mutant, None for other modules."""
        if name != self.name:
            return None
        place = str(ROOT / self.mutant.path)
        return spec_from_file_location(name, place, loader=Loader(name, place, self.mutant.text))


class Loader(SourceFileLoader):
    """Loads a text in place of a file."""

    def __init__(self, name: str, path: str, text: str) -> None:
        """Load this text as the module in the file at `path`."""
        super().__init__(name, path)
        self.text = text

    def get_code(self, fullname: str) -> CodeType:
        """Return the compiled text."""
        return compile(self.text, self.path, "exec")


def module_name(path: str) -> str:
    """Return the name of the module in a file, whose first folder is a source root."""
    name = ".".join(Path(path).with_suffix("").parts[1:])
    return name.removesuffix(".__init__")


if __name__ == "__main__":
    sys.exit(main())
