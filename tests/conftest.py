"""What tests share: a real server process, with the tests' own games."""

import gc
import logging
import os
import signal
import sys
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, settings

from joybridge.client.launch import simulator_process
from joybridge.conformance.rules import sessions
from tests.support.broken_servers import BrokenServer, serving
from tests.support.games import PLACES

GYM_PLACES = [f"tests.support.gym_games:{name}" for name in ("Brief", "Turns", "Chase", "Gallery")]

# A shell that starts the tests in the background lets them, and the programs that they start, ignore interrupts.
signal.signal(signal.SIGINT, signal.default_int_handler)

gc.disable()  # until all tests are imported, which makes no garbage

# A busy machine is no failure.
settings.register_profile("joybridge", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("joybridge")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Run the files with slow tests first: a long file at the end would keep one process busy alone."""
    files = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in files)


def pytest_collection_finish() -> None:
    """Let garbage collection pass over what was imported: there are hundreds of thousands of objects."""
    gc.freeze()
    gc.enable()


@pytest.fixture(scope="session", autouse=True)
def state_folder(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Let the key of runs, and what was found out about programs, be those of the tests, not of who runs them."""
    os.environ["XDG_STATE_HOME"] = str(tmp_path_factory.mktemp("state"))
    os.environ["XDG_CACHE_HOME"] = str(tmp_path_factory.mktemp("cache"))


@pytest.fixture(scope="session")
def simulator() -> Iterator[str]:
    """Yield the address of a simulator in a process of its own."""
    with simulator_process(PLACES) as address:
        yield address


@pytest.fixture(scope="session")
def gym_simulator() -> Iterator[str]:
    """Yield the address of a simulator with the games of the tests of environments."""
    with simulator_process(GYM_PLACES) as address:
        yield address


@pytest.fixture
def make(gym_simulator: str) -> Iterator[Callable[..., Any]]:
    """Make environments at that simulator, whose samples are the same each time, and close them."""
    made: list[Any] = []

    def make(kind: type, *arguments: object, **settings: object) -> Any:
        made.append(kind(*arguments, simulator=gym_simulator, **settings))
        agents = getattr(made[-1], "possible_agents", ())
        for space in [made[-1].action_space(agent) for agent in agents] or [made[-1].action_space]:
            space.seed(1)
        return made[-1]

    yield make
    for environment in made:
        environment.close()


@pytest.fixture(scope="module")
def correct() -> Iterator[str]:
    """Yield the address of a server without faults."""
    with serving(BrokenServer(set())) as address:
        yield address


@pytest.fixture
def quiet_servers(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Keep the servers of this process from logging what they refuse, and abandon no more sessions than it takes."""
    monkeypatch.setattr(sessions, "ABANDONED", 2 * sessions.MANY_SESSIONS)
    logging.disable(logging.CRITICAL)
    yield
    logging.disable(logging.NOTSET)


@pytest.fixture(scope="module")
def other_package(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Install a package with the layouts `compass` and `laplace`."""
    from tests.support.own_layouts import ENTRY_POINTS, offer  # imported here because most tests need no torch

    folder = tmp_path_factory.mktemp("packages")
    offer(folder, "compass", ENTRY_POINTS)
    sys.path.append(str(folder))
    yield
    sys.path.remove(str(folder))


@pytest.fixture
def signals() -> Iterator[None]:
    """Put back the handlers of signals that the command line of the trainer replaces."""
    numbers = (signal.SIGINT, signal.SIGTERM)
    handlers = [signal.getsignal(number) for number in numbers]
    yield
    for number, handler in zip(numbers, handlers, strict=True):
        signal.signal(number, handler)
