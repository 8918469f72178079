"""Functions have few parameters: what belongs together is a frozen dataclass that is written once and passed whole."""

import ast
from pathlib import Path

ROOT = Path(__file__).parents[1]
MOST = 7
KEYWORDS = {  # what users call with keywords, and one page of mathematics
    "spec",
    "behavior",
    "gae",
    "Session",
    "BridgeEnv",
    "BridgeVectorEnv",
    "BridgeParallelEnv",
}


def functions(node, owner=""):
    """Yield functions with the name of their class, for `__init__`, or their own."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef):
            yield (owner if child.name == "__init__" else child.name), child
        yield from functions(child, child.name if isinstance(child, ast.ClassDef) else owner)


def wide(source):
    """Return the names of functions with too many parameters; a kernel takes each array by itself."""
    found = set()
    for name, function in functions(ast.parse(source)):
        arguments = function.args.posonlyargs + function.args.args + function.args.kwonlyargs
        compiled = any("compiled" in ast.unparse(each) for each in function.decorator_list)
        if sum(each.arg not in ("self", "cls") for each in arguments) > MOST and not compiled:
            found.add(name)
    return found


def test_no_function_has_more_than_seven_parameters_unless_users_call_it_with_keywords():
    files = [path for side in ("proto", "simulator", "trainer", "tools") for path in (ROOT / side).rglob("*.py")]
    own = [path for path in files if not path.name.endswith("_grpc.py") and "node_modules" not in path.parts]
    assert set().union(*(wide(path.read_text()) for path in own)) == KEYWORDS


def test_a_function_with_eight_is_found():
    assert wide("class A:\n def __init__(self, a, b, c, d, e, f, g, *, h): ...\n def b(self, a, b): ...") == {"A"}
