"""Which simulators a command uses: the given ones, those of the run's last training, or one that it starts."""

import json
from collections.abc import Callable, Iterator, Sequence
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


@contextmanager
def open_simulators(
    wanted: Simulators, last: Simulators, config: Config, wait: float, say: Callable[[str], None]
) -> Iterator[tuple[Simulators, Sequence[str]]]:
    """Yield which simulators are used, and addresses at which they answer.

    They are the wanted ones. If none are, they are those of the last training; where these do not answer or do not have
    the game, a simulator is started. It ends with the block. wait: seconds to wait for the wanted ones. Raises
    SimulatorError.
    """
    if wanted.addresses:
        for address in wanted.addresses:
            wait_for(address, wait, say)
        yield wanted, wanted.addresses
    elif not wanted.games and last.addresses and _usable(last.addresses, config, say):
        say(f"simulator: {', '.join(last.addresses)}, as in the training; --simulator names another")
        yield last, last.addresses
    else:
        own = Simulators(games=wanted.games or last.games)
        with simulator_process(own.games) as address:
            try:
                yield own, [address]
            except NoSuchGame as error:
                raise NoSuchGame(f"{error}; if another server has the game, name it with --simulator") from error


def _usable(addresses: Sequence[str], config: Config, say: Callable[[str], None]) -> bool:
    """Return whether all simulators answer and have the game."""
    try:
        for address in addresses:
            wait_for(address, LAST_SECONDS, lambda text: None)
            describe(address, config.game, config.options)
    except SimulatorError as error:
        say(f"the simulator of the training cannot be used: {error}; starting one")
        return False
    return True
