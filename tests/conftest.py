"""What tests share: a real server process, with the tests' own games."""

from collections.abc import Iterator

import pytest

from joybridge.trainer.wire.launch import simulator_process
from tests.support.games import PLACES


@pytest.fixture(scope="session")
def simulator() -> Iterator[str]:
    """Yield the address of a simulator in a process of its own."""
    with simulator_process(PLACES) as address:
        yield address
