"""No call to a server is without a deadline: what calls gRPC says how long it waits."""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
MAKERS = {"unary_unary", "unary_stream", "stream_unary"}  # of channels: they return what calls a method
# Streams last as long as a session; their answers have deadlines of their own (tests/test_client.py, test_check.py).


def product():
    for side in ("proto", "simulator", "trainer"):
        yield from (path for path in sorted((ROOT / side / "joybridge").rglob("*.py")) if "_pb2" not in path.name)


def called(node):
    return node.func.attr if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) else ""


def calls_without_deadline(source: str) -> list[int]:
    """Return the lines at which a method of a server is called without `timeout`."""
    tree = ast.parse(source)
    callers, stubs = set(), set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name | ast.Attribute):
            name = ast.unparse(node.targets[0])
            if called(node.value) in MAKERS:
                callers.add(name)
            if called(node.value).endswith("Stub") or ast.unparse(node.value).partition("(")[0].endswith("Stub"):
                stubs.add(name)
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and not any(keyword.arg == "timeout" for keyword in node.keywords):
            of_stub = isinstance(node.func, ast.Attribute) and ast.unparse(node.func.value) in stubs
            at_once = isinstance(node.func, ast.Call) and called(node.func) in MAKERS
            if ast.unparse(node.func) in callers or of_stub or at_once:
                found.append(node.lineno)
    return found


@pytest.mark.parametrize(
    ("source", "lines"),
    [
        ("call = channel.unary_unary('/a')\ncall(request)", [2]),
        ("call = channel.unary_unary('/a')\ncall(request, timeout=3)", []),
        ("channel.unary_unary('/a')(request)", [1]),
        ("stub = rpc.ServiceStub(channel)\nstub.ListGames(request)", [2]),
        ("stub = rpc.ServiceStub(channel)\nstub.ListGames(request, timeout=3)", []),
    ],
)
def test_a_call_without_a_deadline_is_found(source, lines):
    assert calls_without_deadline(source) == lines


@pytest.mark.promise("L1")
def test_every_call_has_a_deadline():
    found = [
        f"{path.relative_to(ROOT)}:{line}" for path in product() for line in calls_without_deadline(path.read_text())
    ]
    assert found == []
