"""Which simulators a command uses: the given ones, those of the run's last training, or those that it starts."""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from joybridge.contract.credentials import CredentialsError, ProtectedAddress, load_credentials
from joybridge.trainer.config import Config
from joybridge.trainer.errors import ConfigError
from joybridge.trainer.files import read_file, storing, write_atomically
from joybridge.trainer.wire.client import describe, wait_for
from joybridge.trainer.wire.cluster import cluster_simulators
from joybridge.trainer.wire.errors import NoSuchGame, SimulatorError
from joybridge.trainer.wire.launch import simulator_process

FILE = "simulators.json"  # in the folder of a run
LONGEST = 2**16  # bytes of it
LAST_SECONDS = 2.0  # to wait for the simulators of the last training

Connect = Callable[[], Sequence[str]]


@dataclass(frozen=True)
class Simulators:
    """Simulators that somebody else runs, or the games of those that the command starts."""

    addresses: tuple[str, ...] = ()  # none: the command starts a simulator
    games: tuple[str, ...] = ()  # MODULE:CLASS each, besides the built-in and the installed ones
    tls_ca: str = ""  # the file of the certificates to trust at the addresses; "": no TLS
    token_file: str = ""  # the file of their token; "": none
    cluster: str = ""  # HOST:PORT of a Ray cluster on whose nodes the command starts them; "": here
    count: int = 1  # of those that it starts there

    def protected(self) -> list[str]:
        """Return the addresses with their credentials, read anew from the files. Raises CredentialsError."""
        files = [Path(file) if file else None for file in (self.tls_ca, self.token_file)]
        credentials = load_credentials(*files)
        return [ProtectedAddress(address, credentials) for address in self.addresses]

    def arguments(self) -> list[str]:
        """Return the options of the command line that name them."""
        pairs = [("--simulator", address) for address in self.addresses] + [("--game", game) for game in self.games]
        pairs += [("--ray", self.cluster), ("--simulators", f"{self.count}")] if self.cluster else []
        pairs += [(flag, file) for flag, file in (("--tls-ca", self.tls_ca), ("--token-file", self.token_file)) if file]
        return [word for pair in pairs for word in pair]


def remember(run: Path, simulators: Simulators) -> None:
    """Keep in the folder of a run what it is trained with, but no cluster. Raises StorageError."""
    simulators = replace(simulators, cluster="", count=1)
    with storing(run):
        if simulators == Simulators():
            (run / FILE).unlink(missing_ok=True)
            return
        run.mkdir(parents=True, exist_ok=True)
    write_atomically(run / FILE, json.dumps(asdict(simulators)).encode())


def last_simulators(run: Path) -> Simulators:
    """Return what a run was last trained with; none if it does not say. Raises ConfigError."""
    path = run / FILE
    try:
        found = TypeAdapter(Simulators).validate_json(read_file(path, LONGEST))
        return replace(found, cluster="", count=1)  # whoever joins a cluster trusts it, which no file of others decides
    except FileNotFoundError:
        return Simulators()
    except (OSError, ValidationError) as error:
        raise ConfigError(f"{path} cannot be read ({error}); delete it, and name the simulator or the game") from error


def choose_simulators(wanted: Simulators, last: Simulators, config: Config, say: Callable[[str], None]) -> Simulators:
    """Return the wanted simulators or games; if none are, those of the last training.

    Simulators of the last training that do not answer, or do not have the game, are left out. A cluster needs the games
    of the last training, too.
    """
    if wanted.cluster and not wanted.games:
        return replace(wanted, games=last.games)
    if wanted != Simulators():
        return wanted
    try:
        for address in last.protected():
            wait_for(address, LAST_SECONDS, lambda text: None)
            describe(address, config.game, {})
    except (SimulatorError, CredentialsError) as error:
        say(f"the simulator of the training cannot be used: {error}; starting one")
        return Simulators(games=last.games)
    if last.addresses:
        say(f"simulator: {', '.join(last.addresses)}, as in the training; --simulator names another")
    return last


@contextmanager
def open_simulators(simulators: Simulators, wait: float, say: Callable[[str], None]) -> Iterator[Connect]:
    """Yield a function that returns addresses at which simulators answer, for the first time and after a loss.

    Each call starts simulators in place of those before, which end with the block; or it waits for the simulators of
    others, `wait` seconds for each. It raises SimulatorError and CredentialsError.
    """
    with ExitStack() as running:

        def connect() -> Sequence[str]:
            running.close()
            if simulators.cluster:
                started = cluster_simulators(simulators.cluster, simulators.count, simulators.games, wait)
                return running.enter_context(started)
            addresses = simulators.protected()
            for address in addresses:
                wait_for(address, wait, say)
            return addresses or [running.enter_context(simulator_process(simulators.games))]

        try:
            yield connect
        except NoSuchGame as error:
            if simulators.addresses:
                raise
            raise NoSuchGame(f"{error}; if another server has the game, name it with --simulator") from error
