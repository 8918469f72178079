"""The reference of the public Python API: every name in `__all__`, with its declaration and docstring.

Modules are read, not imported. Their docstrings are Markdown.
"""

import ast
from collections.abc import Iterator
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
MESSAGES = "joybridge.v1.bridge_pb2"  # generated from the contract
Definition = ast.ClassDef | ast.FunctionDef


def api(*modules: str) -> str:
    """Return the reference of these modules as Markdown, with a heading of level 2 for each."""
    return "\n".join(line for module in modules for line in _module(module))


def docstring(module: str) -> str:
    """Return the docstring of a module."""
    return ast.get_docstring(_tree(module)) or ""


def exported(module: str) -> list[str]:
    """Return the names in `__all__` of a module."""
    value = _assignments(module)["__all__"].value
    return list(ast.literal_eval(value)) if value else []


def _module(module: str) -> Iterator[str]:
    yield from (f"\n## {module}\n", docstring(module), "")
    for name in exported(module):
        yield f"\n### {name}\n"
        source, node = _find(module, name)
        if node is None:
            yield f"The message [{name}](contract.md#{name.lower()}) of the contract."
        elif isinstance(node, Definition):
            yield from _definition(source, node)
        else:
            yield from _code(source, node.lineno, node.end_lineno or node.lineno)


def _definition(module: str, node: Definition) -> Iterator[str]:
    """Yield the declaration and the docstring of a class or function, then the public methods of a class."""
    doc = ast.get_docstring(node)
    last = node.body[0].lineno - 1 if doc else node.lineno
    yield from _code(module, node.lineno, last)
    yield from (doc or "", "")
    if isinstance(node, ast.ClassDef):
        fields = [part for part in node.body if isinstance(part, ast.AnnAssign) and not _hidden(part.target)]
        if fields:
            yield from _code(module, fields[0].lineno, fields[-1].end_lineno or fields[-1].lineno)
        for method in node.body:
            if isinstance(method, ast.FunctionDef) and (method.name[0] != "_" or method.name == "__init__"):
                yield from _definition(module, method)


def _hidden(target: ast.expr) -> bool:
    return isinstance(target, ast.Name) and target.id[0] == "_"


def _code(module: str, first: int, last: int) -> Iterator[str]:
    lines = _path(module).read_text(encoding="utf-8").splitlines()[first - 1 : last]
    indent = len(lines[0]) - len(lines[0].lstrip())
    yield from ("```python", *(line[indent:].split("  # type:")[0] for line in lines), "```", "")


def _find(module: str, name: str) -> tuple[str, Definition | ast.Assign | ast.AnnAssign | None]:
    """Return the module that defines a name which another one exports, and the definition; None: a message."""
    if module == MESSAGES:
        return module, None
    tree = _tree(module)
    for node in tree.body:
        if isinstance(node, Definition) and node.name == name:
            return module, node
        if isinstance(node, ast.ImportFrom) and any(name in (part.asname, part.name) for part in node.names):
            return _find(str(node.module), name)
    return module, _assignments(module)[name]


@cache
def _assignments(module: str) -> dict[str, ast.Assign | ast.AnnAssign]:
    """Return the assignments of a module by name."""
    return {
        target.id: node
        for node in _tree(module).body
        if isinstance(node, ast.Assign | ast.AnnAssign)
        for target in (node.targets if isinstance(node, ast.Assign) else [node.target])
        if isinstance(target, ast.Name)
    }


@cache
def _tree(module: str) -> ast.Module:
    return ast.parse(_path(module).read_text(encoding="utf-8"))


def _path(module: str) -> Path:
    """Return the file of a module, in one of the three source roots."""
    name = module.replace(".", "/")
    files = [
        ROOT / side / tail
        for side in ("proto", "simulator", "trainer")
        for tail in (f"{name}.py", f"{name}/__init__.py")
    ]
    return next(path for path in files if path.exists())
