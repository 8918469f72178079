"""Who may import whom: two programs meet at a socket, and drawing stays off the path of a step."""

import ast
import json
import subprocess
import sys
from collections.abc import Iterator
from graphlib import TopologicalSorter
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).parents[1]
SIDES = {
    "proto": ("v1", "contract", "mlagents", "conformance"),
    "simulator": ("simulator", "games", "adapters"),
    # The rooms of the trainer, from the ground floor up: each may import those before it.
    "trainer": (
        "config", "client", "layouts", "ppo", "policy", "gym", "demonstrations", "run", "play", "compare",
        "commands", "viewer", "ray_cluster", "minari", "mlagents_player",
    ),
}  # fmt: skip
PACKAGES = {f"joybridge.{name}": ROOT / side / "joybridge" / name for side, names in SIDES.items() for name in names}
CONTRACT = {"joybridge.v1", "joybridge.contract"}
SIMULATOR = CONTRACT | {"joybridge.simulator", "joybridge.games", "joybridge.adapters"}
ROOMS = [f"joybridge.{name}" for name in SIDES["trainer"]]
# Optional parts, found by entry points.
WINGS = {
    "joybridge.viewer",
    "joybridge.ray_cluster",
    "joybridge.minari",
    "joybridge.mlagents_player",
}  # by entry points
MAY_IMPORT = {  # of ours; each package may import itself as well
    "joybridge.v1": set(),
    "joybridge.contract": CONTRACT,
    "joybridge.mlagents": CONTRACT,
    "joybridge.conformance": CONTRACT,
    "joybridge.simulator": SIMULATOR,
    "joybridge.games": SIMULATOR,
    "joybridge.adapters": SIMULATOR | {"joybridge.mlagents"},
    **{room: CONTRACT | set(ROOMS[:floor]) - WINGS for floor, room in enumerate(ROOMS)},
    "joybridge.mlagents_player": CONTRACT | {"joybridge.mlagents"} | set(ROOMS) - WINGS,
}
LEARNING = {"torch", "gymnasium", "pettingzoo", "tensorboard", "pydantic"}
OPTIONAL = {"ray", "minari", "h5py", "websockets"}  # each belongs to one wing
WITHOUT_TORCH = ("config", "client", "layouts", "gym", "minari", "mlagents_player")
MAY_NOT_IMPORT = {  # of others'; nobody imports the tools and the tests
    "joybridge.v1": LEARNING | {"pygame", "numba"},
    "joybridge.contract": LEARNING | {"pygame", "numba"},
    "joybridge.mlagents": LEARNING | {"pygame", "numba"},
    "joybridge.conformance": LEARNING | {"pygame", "numba"},
    "joybridge.simulator": LEARNING,
    "joybridge.games": LEARNING,
    "joybridge.adapters": LEARNING - {"gymnasium", "pettingzoo"} | {"numba"},
    **{room: {"pygame"} | OPTIONAL for room in ROOMS},
    **{f"joybridge.{room}": {"pygame", "torch"} | OPTIONAL for room in WITHOUT_TORCH},
    "joybridge.gym": {"pygame", "torch", "pydantic"} | OPTIONAL,
    "joybridge.viewer": LEARNING | {"pygame"} | OPTIONAL - {"websockets"},
    "joybridge.ray_cluster": {"pygame"} | OPTIONAL - {"ray"},
    "joybridge.minari": {"pygame", "torch"} | OPTIONAL - {"minari", "h5py"},
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
        parts = [*package.split("."), *path.relative_to(PACKAGES[package]).with_suffix("").parts]
        parent = ".".join(parts[:-1])
        found[parent if parts[-1] == "__init__" else ".".join(parts)] = list(imports(path.read_text(), parent))
    return found


def test_the_rooms_of_the_trainer_have_no_more_arrows_than_their_drawing():
    arrows = {
        (room, f"joybridge.{module.split('.')[1]}")
        for room in ROOMS
        for targets in modules(room).values()
        for module, _ in targets
        if module.startswith("joybridge.")
    }
    between = {(room, other) for room, other in arrows if other in ROOMS and other != room}
    assert len(between) <= 64


def trespasses(package: str, found: dict[str, list[Import]]) -> list[str]:
    def forbidden(module: str) -> bool:
        root, *rest = module.split(".")
        if root == "joybridge":
            ours = f"joybridge.{rest[0]}" if rest else ""
            return ours in PACKAGES and ours != package and ours not in MAY_IMPORT[package]
        return root in MAY_NOT_IMPORT[package] or root in {"tools", "tests"}

    return [f"{name} imports {module}" for name, targets in found.items() for module, _ in targets if forbidden(module)]


@pytest.mark.parametrize("package", PACKAGES)
def test_no_package_imports_what_is_not_its_business(package):
    found = modules(package)
    assert found
    assert trespasses(package, found) == []


@pytest.mark.parametrize(
    "source",
    [
        "import torch",
        "import torch.nn as nn",
        "from torch import nn",
        "def f():\n    from joybridge.client.client import Session",
        "try:\n    import torch\nexcept ImportError:\n    pass",
        "if True:\n    import numpy, joybridge.run",
        "class A:\n    async def f(self):\n        import gymnasium",
    ],
)
def test_a_trespass_is_found_wherever_it_stands(source):
    assert (
        len(
            set(
                trespasses(
                    "joybridge.simulator", {"joybridge.simulator.x": list(imports(source, "joybridge.simulator"))}
                )
            )
        )
        >= 1
    )


def test_relative_imports_are_read_as_what_they_mean():
    assert Import("joybridge.games.birds.rules", False) in imports("from .rules import f", "joybridge.games.birds")
    assert Import("joybridge.games.render", False) in imports("from .. import render", "joybridge.games.birds")
    assert Import("joybridge.simulator.render.fit", True) in imports(
        "def f():\n  from ...simulator.render import fit", "joybridge.games.birds"
    )


def test_the_contract_and_the_kit_need_nothing_but_numpy_protobuf_and_grpc():
    found = [targets for package in (*CONTRACT, "joybridge.conformance") for targets in modules(package).values()]
    roots = {module.split(".")[0] for targets in found for module, _ in targets}
    assert roots - set(sys.stdlib_module_names) == {
        "numpy",
        "google",
        "grpc",
        "grpc_health",
        "grpc_reflection",
        "grpc_status",
        "joybridge",
    }


def test_pygame_is_imported_only_in_the_processes_of_programs_written_with_it():
    users = {name for name, targets in modules("joybridge.adapters").items() if "pygame" in map(root, targets)}
    assert users and all(name.startswith("joybridge.adapters.pygame_programs.inside.") for name in users)


@pytest.mark.parametrize("package", PACKAGES)
def test_no_modules_of_a_package_import_each_other_in_a_circle(package):
    found = modules(package)
    # `from package import module` depends on the module; what `package/__init__.py` imports itself is no circle.
    graph = {
        name: {t.module for t in targets if t.module in found and t.module not in (name, package)}
        for name, targets in found.items()
    }
    assert list(TopologicalSorter(graph).static_order())


def test_drawing_modules_are_imported_only_by_each_other_and_inside_functions():
    found = modules("joybridge.simulator") | modules("joybridge.games")
    drawing = {name for name, targets in found.items() if any(root(target) == "pygame" for target in targets)}
    drawing |= {name for name in found if name.endswith(".drawing")}
    assert {"joybridge.simulator.render", "joybridge.games.shooting_birds.drawing"} <= drawing
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
    """Run a program in a process of its own and return the modules that it has loaded in the end."""
    program += "\nimport sys, json\nprint(json.dumps(sorted(sys.modules)))"
    result = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=True)
    return set(json.loads(result.stdout.splitlines()[-1]))


PLAY = """
import numpy as np
import joybridge.simulator.service
from joybridge.contract.codec import ActArrays, pack_act
from joybridge.v1 import bridge_pb2 as pb
from joybridge.simulator.catalog import load_games
from joybridge.simulator.session import Session

def lowest(kind):
    axes = np.array([[axis.low for axis in kind.device.axes]] * kind.agents_per_arena, np.float32)
    return pack_act(ActArrays(axes, np.zeros((kind.agents_per_arena, len(kind.device.branches)), np.int32)))

games = load_games()
for game in games:
    session = Session(games)
    spec = session.answer(pb.PlayRequest(start=pb.Start(game=game, arenas=1))).started.spec
    draw = [0] if DRAW and spec.HasField("picture") else []
    act = pb.Act(behaviors=[lowest(kind) for kind in spec.behaviors], draw=draw)
    assert len(session.answer(pb.PlayRequest(act=act)).step.pictures) == len(draw)
"""


def test_serving_and_stepping_loads_no_learning_and_no_drawing():
    assert loaded(PLAY.replace("DRAW", "False")).isdisjoint(
        {"torch", "gymnasium", "joybridge.run", "joybridge.client", "pygame", "matplotlib"}
    )


def test_drawing_is_loaded_when_a_picture_is_asked_for():
    assert "pygame" in loaded(PLAY.replace("DRAW", "True"))


def test_training_loads_no_game():
    modules = loaded("import joybridge.run.train, joybridge.commands.train")
    assert {"joybridge.run", "torch", "joybridge.contract"} <= modules
    assert modules.isdisjoint({"joybridge.simulator", "joybridge.games", "pygame"})


def test_refusing_a_comparison_or_a_training_loads_no_torch():
    assert loaded("import joybridge.compare.compare, joybridge.commands.train").isdisjoint(
        {"torch", "stable_baselines3"}
    )


def test_an_editable_install_adds_no_top_level_name_but_joybridge(tmp_path):
    names = ["simulator", "trainer", "tools", "tests", "configs", "contract", "games", "gym"]
    program = f"""
from importlib.util import find_spec
specs = [find_spec(name) for name in {names}]
print([place for spec in specs if spec for place in spec.submodule_search_locations or [spec.origin]])
"""
    result = subprocess.run(
        [sys.executable, "-P", "-c", program], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert str(ROOT) + "/" not in result.stdout.replace(sys.prefix, "")  # dependencies may have such names
