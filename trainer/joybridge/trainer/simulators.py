"""Which simulators a command uses: the given ones, those of the run's last training, or one that it starts."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from joybridge.trainer.config import Config
from joybridge.trainer.errors import ConfigError
from joybridge.trainer.files import write_atomically
from joybridge.trainer.wire.client import describe, wait_for
from joybridge.trainer.wire.errors import NoSuchGame, SimulatorError
from joybridge.trainer.wire.launch import simulator_process

FILE = "simulators.json"  # in the folder of a run
LAST_SECONDS = 2.0  # to wait for the simulators of the last training


@dataclass(frozen=True)
class Simulators:
    """Simulators that somebody else runs, or the games of one that the command starts."""

    addresses: tuple[str, ...] = ()  # none: the command starts a simulator
    games: tuple[str, ...] = ()  # MODULE:CLASS each, besides the built-in and the installed ones


def remember(run: Path, simulators: Simulators) -> None:
    """Keep in the folder of a run what it is trained with."""
    if simulators == Simulators():
        (run / FILE).unlink(missing_ok=True)
        return
    run.mkdir(parents=True, exist_ok=True)
    write_atomically(run / FILE, json.dumps(asdict(simulators)).encode())


def last_simulators(run: Path) -> Simulators:
    """Return what a run was last trained with; none if it does not say. Raises ConfigError."""
    path = run / FILE
    if not path.exists():
        return Simulators()
    try:
        return TypeAdapter(Simulators).validate_json(path.read_bytes())
    except (OSError, ValidationError) as error:
        raise ConfigError(f"{path} cannot be read ({error}); delete it, and name the simulator or the game") from error


def choose_simulators(wanted: Simulators, last: Simulators, config: Config, say: Callable[[str], None]) -> Simulators:
    """Return the wanted simulators or games; if none are, those of the last training.

    Simulators of the last training that do not answer, or do not have the game, are left out.
    """
    if wanted != Simulators():
        return wanted
    try:
        for address in last.addresses:
            wait_for(address, LAST_SECONDS, lambda text: None)
            describe(address, config.game, config.options)
    except SimulatorError as error:
        say(f"the simulator of the training cannot be used: {error}; starting one")
        return Simulators(games=last.games)
    if last.addresses:
        say(f"simulator: {', '.join(last.addresses)}, as in the training; --simulator names another")
    return last


@contextmanager
def open_simulators(simulators: Simulators, wait: float, say: Callable[[str], None]) -> Iterator[list[str]]:
    """Yield addresses at which simulators answer; one that is started here ends with the block.

    wait: seconds to wait for the simulators of others. Raises SimulatorError.
    """
    if simulators.addresses:
        for address in simulators.addresses:
            wait_for(address, wait, say)
        yield list(simulators.addresses)
        return
    with simulator_process(simulators.games) as address:
        try:
            yield [address]
        except NoSuchGame as error:
            raise NoSuchGame(f"{error}; if another server has the game, name it with --simulator") from error
