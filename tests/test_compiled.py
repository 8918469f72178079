"""Rules are compiled with a cache on disk, or without one where no folder can be written."""

import logging
from importlib import import_module

import pytest
from numba.core.caching import CompileResultCacheImpl

MODULES = ["joybridge.simulator.compiled", "joybridge.trainer.ppo.fast.kernels"]


@pytest.mark.parametrize("module", MODULES)
def test_without_a_folder_for_the_cache_functions_are_compiled_all_the_same(module, monkeypatch, caplog):
    compiled = import_module(module).compiled
    monkeypatch.setattr(CompileResultCacheImpl, "_locator_classes", [])  # as where nothing can be written
    with caplog.at_level(logging.WARNING):
        double = compiled(lambda x: 2 * x)
    assert double(21) == 42
    assert double.signatures
    assert ("set NUMBA_CACHE_DIR to one" in caplog.text) == (module == MODULES[0])
