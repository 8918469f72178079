"""The program that changes the code finds the code, and the tests that are to notice."""

import ast

import pytest

from tools.mutants import PARTS, ROOT, Loader, module_name


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.promise("T1")
def test_every_part_has_code_and_tests_that_import_it(part):
    place, names = PARTS[part]
    paths = [ROOT / place] if place.endswith(".py") else sorted((ROOT / place).glob("*.py"))
    modules = {module_name(str(path.relative_to(ROOT))) for path in paths}
    tests = [ast.parse((ROOT / "tests" / f"test_{name}.py").read_text(encoding="utf-8")) for name in names]
    imported = {node.module for tree in tests for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)}
    assert modules & imported


def test_a_changed_text_is_loaded_in_place_of_a_file():
    namespace: dict[str, int] = {}
    exec(Loader("changed", "unchanged.py", "left = 6 - 3").get_code("changed"), namespace)
    assert namespace["left"] == 3
