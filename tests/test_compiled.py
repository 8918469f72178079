"""Rules are compiled with a cache on disk, or without one where no folder can be written."""

import logging
import subprocess
import sys
from importlib import import_module

import numba
import pytest
from numba.core.caching import CompileResultCacheImpl

from joybridge.ppo.fast.announce import announcing

MODULES = ["joybridge.simulator.compiled", "joybridge.ppo.fast.kernels"]


@pytest.mark.parametrize("module", MODULES)
def test_without_a_folder_for_the_cache_functions_are_compiled_all_the_same(module, monkeypatch, caplog):
    compiled = import_module(module).compiled
    monkeypatch.setattr(CompileResultCacheImpl, "_locator_classes", [])  # as where nothing can be written
    with caplog.at_level(logging.WARNING):
        double = compiled(lambda x: 2 * x)
    assert double(21) == 42
    assert getattr(double, "dispatcher", double).signatures
    assert ("set NUMBA_CACHE_DIR to one" in caplog.text) == (module == MODULES[0])


SHAPES = """
from typing import NamedTuple
class {name}(NamedTuple):
    sides: int
MADE, FACTOR = {name}(3), {factor}
"""
USE = """
from joybridge.{module} import compiled
from shapes import FACTOR, MADE
@compiled
def double(shape):
    return shape.sides * FACTOR
print(double(MADE))
"""


@pytest.mark.parametrize("module", MODULES)
def test_a_type_that_is_renamed_and_a_constant_that_changes_in_another_file_are_compiled_anew(module, tmp_path):
    (tmp_path / "use.py").write_text(USE.format(module=module.removeprefix("joybridge.")))
    for name, factor in ("Form", 2), ("Shape", 4):
        (tmp_path / "shapes.py").write_text(SHAPES.format(name=name, factor=factor))
        command = [sys.executable, "-B", "-c", "import use"]  # -B: a source of the same second and size is read anew
        result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert (result.stdout, result.stderr) == (f"{3 * factor}\n", "")
        assert list(tmp_path.glob("__pycache__/*.nbc"))


def test_numba_is_imported_when_a_compiled_function_is_called_and_not_before():
    program = """
import sys
from joybridge.simulator.catalog import load_games
from joybridge.simulator.trigonometry import sine
load_games()
print("numba" in sys.modules, sine(0.0), "numba" in sys.modules)
"""
    result = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert result.stdout.split() == ["False", "0.0", "True"]


def test_a_function_that_is_compiled_is_announced_once():
    said: list[str] = []
    with announcing(said.append):
        for _ in range(2):
            assert numba.njit(lambda number: number + 1)(1) == 2
    assert len(said) == 1 and said[0].startswith("compiling")
