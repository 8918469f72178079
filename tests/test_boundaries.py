"""Who may import whom: two programs meet at a socket, and drawing stays off the path of a step."""

import ast
import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = {"joybridge": ROOT / "proto" / "joybridge", "simulator": ROOT / "simulator", "trainer": ROOT / "trainer"}
FORBIDDEN = {
    "joybridge": {"simulator", "trainer", "tools", "tests", "torch", "gymnasium", "pettingzoo", "pygame", "numba"},
    "simulator": {"trainer", "tools", "tests", "torch", "gymnasium", "pettingzoo", "tensorboard", "pydantic"},
    "trainer": {"simulator", "tools", "tests", "pygame"},
}


class Import(NamedTuple):
    module: str  # full name
    lazy: bool  # inside a function: not done when the importing module is


def imports(source: str, package: str) -> Iterator[Import]:
    """Yield the imports of a module of `package`. `from a import b` imports a, and a.b if that is a module."""

    def visit(node: ast.AST, lazy: bool) -> Iterator[Import]:
        if isinstance(node, ast.Import):
            yield from (Import(alias.name, lazy) for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) + 1 - node.level] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            yield Import(base, lazy)
            yield from (Import(f"{base}.{alias.name}", lazy) for alias in node.names)
        for child in ast.iter_child_nodes(node):
            yield from visit(child, lazy or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda))

    yield from visit(ast.parse(source), False)


def modules(package: str) -> dict[str, list[Import]]:
    """Return the imports of every module of a package by its full name."""
    found = {}
    for path in sorted(PACKAGES[package].rglob("*.py")):
        parts = [package, *path.relative_to(PACKAGES[package]).with_suffix("").parts]
        parent = ".".join(parts[:-1])
        found[parent if parts[-1] == "__init__" else ".".join(parts)] = list(imports(path.read_text(), parent))
    return found


def trespasses(package: str, found: dict[str, list[Import]]) -> list[str]:
    return [
        f"{name} imports {module}"
        for name, targets in found.items()
        for module, _ in targets
        if module.split(".")[0] in FORBIDDEN[package]
    ]


@pytest.mark.parametrize("package", PACKAGES)
def test_no_package_imports_what_is_not_its_business(package):
    found = modules(package)
    assert len(found) >= 4 and any(found.values())
    assert trespasses(package, found) == []


@pytest.mark.parametrize(
    "source",
    [
        "import torch",
        "import torch.nn as nn",
        "from torch import nn",
        "def f():\n    from trainer.client import Session",
        "try:\n    import torch\nexcept ImportError:\n    pass",
        "if True:\n    import numpy, trainer",
        "class A:\n    async def f(self):\n        import gymnasium",
    ],
)
def test_a_trespass_is_found_wherever_it_stands(source):
    assert len(set(trespasses("simulator", {"simulator.x": list(imports(source, "simulator"))}))) >= 1


def test_relative_imports_are_read_as_what_they_mean():
    assert Import("simulator.games.birds.rules", False) in imports("from .rules import f", "simulator.games.birds")
    assert Import("simulator.games.render", False) in imports("from .. import render", "simulator.games.birds")
    assert Import("simulator.render.fit", True) in imports(
        "def f():\n  from ...render import fit", "simulator.games.birds"
    )


def test_the_contract_needs_nothing_but_numpy_protobuf_and_grpc():
    roots = {module.split(".")[0] for targets in modules("joybridge").values() for module, _ in targets}
    assert roots - set(sys.stdlib_module_names) == {"numpy", "google", "grpc", "joybridge"}


def test_drawing_modules_are_imported_only_by_each_other_and_inside_functions():
    found = modules("simulator")
    drawing = {name for name, targets in found.items() if any(root(target) == "pygame" for target in targets)}
    drawing |= {name for name in found if name.endswith(".drawing")}
    assert {"simulator.render", "simulator.games.shooting_birds.drawing"} <= drawing
    users = {
        (name, target.lazy)
        for name, targets in found.items()
        for target in targets
        if target.module in drawing and name not in drawing
    }
    assert users  # the games do draw
    assert [name for name, lazy in users if not lazy] == []


def root(target: Import) -> str:
    return target.module.split(".")[0]


# ----------------------------------------------------------------------------------------------------- at run time


def loaded(program: str) -> set[str]:
    """Run a program in a process of its own and return the top-level modules that it has loaded in the end."""
    program += "\nimport sys, json\nprint(json.dumps(sorted({name.split('.')[0] for name in sys.modules})))"
    result = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    return set(json.loads(result.stdout.splitlines()[-1]))


PLAY = """
import numpy as np
import simulator.service
from joybridge.codec import ActArrays, pack_act
from joybridge.v1 import bridge_pb2 as pb
from simulator.catalogue import load_games
from simulator.session import Session

def lowest(kind):
    axes = np.array([[axis.low for axis in kind.device.axes]] * kind.agents_per_arena, np.float32)
    return pack_act(ActArrays(axes, np.zeros((kind.agents_per_arena, len(kind.device.branches)), np.int32)))

games = load_games()
for game in games:
    session = Session(games)
    spec = session.answer(pb.PlayRequest(start=pb.Start(game=game, arenas=1))).started.spec
    draw = [0] if DRAW and spec.HasField("picture") else []
    act = pb.Act(behaviours=[lowest(kind) for kind in spec.behaviours], draw=draw)
    assert len(session.answer(pb.PlayRequest(act=act)).step.pictures) == len(draw)
"""


def test_serving_and_stepping_loads_no_learning_and_no_drawing():
    assert loaded(PLAY.replace("DRAW", "False")).isdisjoint({"torch", "gymnasium", "trainer", "pygame", "matplotlib"})


def test_drawing_is_loaded_when_a_picture_is_asked_for():
    assert "pygame" in loaded(PLAY.replace("DRAW", "True"))


def test_training_loads_no_game():
    modules = loaded("import trainer.train, trainer.__main__")
    assert {"trainer", "torch", "joybridge"} <= modules
    assert modules.isdisjoint({"simulator", "pygame"})
