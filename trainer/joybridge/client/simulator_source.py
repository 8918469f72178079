"""Which simulators a command uses: the given ones, those of the run's last training, or those that it starts.

A run says in simulators.json with what it was trained. That is believed if this user wrote it on this machine, see
own_runs.py, or if the command is told to; otherwise the run may be a stranger's who would like to start a program.
"""

import argparse
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from pydantic import TypeAdapter

from joybridge.client.client import describe, wait_for
from joybridge.client.errors import NoSuchGame, SimulatorError
from joybridge.client.launch import simulator_process
from joybridge.client.own_runs import is_ours, sign_or_say, untrusted
from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.config.files import storing, write_atomically
from joybridge.config.json_files import reason_of
from joybridge.contract.address import address
from joybridge.contract.credentials import CredentialsError, ProtectedAddress, load_credentials
from joybridge.contract.files import read_file
from joybridge.plugins import load

FILE = "simulators.json"  # in the folder of a run
MAX_BYTES = 2**16  # of it
LAST_SECONDS = 2.0  # to wait for the simulators of the last training

Connect = Callable[[], Sequence[str]]


@dataclass(frozen=True)
class SimulatorSource:
    """Simulators that somebody else runs, or the games of those that the command starts."""

    addresses: tuple[str, ...] = ()  # none: the command starts a simulator
    games: tuple[str, ...] = ()  # MODULE:CLASS each, besides the built-in and the installed ones
    tls_ca: str = ""  # the file of the certificates to trust at the addresses; "": no TLS
    token_file: str = ""  # the file of their token; "": none
    cluster: str = ""  # HOST:PORT of a Ray cluster on whose nodes the command starts them; "": here
    count: int = 1  # of those that it starts there

    def protected(self) -> list[str]:
        """Return the addresses with their credentials, read again from the files. Raises CredentialsError."""
        files = [Path(file) if file else None for file in (self.tls_ca, self.token_file)]
        credentials = load_credentials(*files)
        return [ProtectedAddress(address, credentials) for address in self.addresses]

    def arguments(self) -> list[str]:
        """Return the options of the command line that name them."""
        pairs = [("--simulator", address) for address in self.addresses] + [("--game", game) for game in self.games]
        pairs += [("--ray", self.cluster), ("--simulators", f"{self.count}")] if self.cluster else []
        pairs += [(flag, file) for flag, file in (("--tls-ca", self.tls_ca), ("--token-file", self.token_file)) if file]
        return [word for pair in pairs for word in pair]


@dataclass(frozen=True)
class Remembered:
    """What a run says about its last training, with the signature of whoever wrote that."""

    run: Path
    simulators: SimulatorSource = SimulatorSource()
    signature: str = ""

    def believed(self, trust: bool) -> SimulatorSource:
        """Return the simulators if this user wrote them on this machine, or trusts whoever did.

        Raises UntrustedRunError, and StorageError for a key that others may know.
        """
        named = self.simulators
        if named == SimulatorSource() or trust or is_ours(_signed_content(named), self.signature):
            return named
        wishes = [f"start {game}" for game in named.games] + [f"connect to {place}" for place in named.addresses]
        wishes += [f"read {file}" for file in (named.tls_ca, named.token_file) if file]
        raise untrusted(self.run, wishes)


def remember(run: Path, simulators: SimulatorSource, say: Callable[[str], None]) -> None:
    """Keep in the folder of a run what it is trained with, signed, but no cluster. Raises StorageError."""
    simulators = replace(simulators, cluster="", count=1)
    with storing(run):
        if simulators == SimulatorSource():
            (run / FILE).unlink(missing_ok=True)
            return
        run.mkdir(parents=True, exist_ok=True)
    signature = sign_or_say(_signed_content(simulators), say)
    write_atomically(run / FILE, json.dumps(asdict(simulators) | {"signature": signature}).encode())


def last_simulators(run: Path) -> Remembered:
    """Return what a run was last trained with; nothing if it does not say. Raises ConfigError."""
    path = run / FILE
    try:
        noted = json.loads(read_file(path, MAX_BYTES))
        signature = noted.pop("signature", "") if isinstance(noted, dict) else ""
        found = TypeAdapter(SimulatorSource).validate_python(noted)
        for place in found.addresses:
            address(place)
    except FileNotFoundError:
        return Remembered(run)
    except (OSError, ValueError, RecursionError, argparse.ArgumentTypeError) as error:
        raise ConfigError(
            f"{path} cannot be read ({reason_of(error)}); delete it, and name the simulator or the game"
        ) from error
    found = replace(found, cluster="", count=1)  # whoever joins a cluster trusts it, which no file of others decides
    return Remembered(run, found, str(signature))


def _signed_content(simulators: SimulatorSource) -> bytes:
    """Return what is signed: the simulators, and the current folder if a game is looked for there.

    With the folder, a stranger cannot put a run that this user has published beside a module of his own.
    """
    folder = str(Path.cwd()) if any(map(_depends_on_folder, simulators.games)) else ""
    return json.dumps([asdict(simulators), folder], sort_keys=True).encode()


def _depends_on_folder(game: str) -> bool:
    """Return whether the current folder decides what a game's place means, as for modules and relative paths."""
    kind, _, place = game.partition(":")
    if kind == "gym":
        return ":" in place.partition(" ")[0]
    if kind == "unity":
        return not Path(place).is_absolute()
    return kind != "unity-port"


def choose_simulators(
    wanted: SimulatorSource, last: Remembered, config: Config, say: Callable[[str], None], *, trust: bool = False
) -> SimulatorSource:
    """Return the wanted simulators or games; if none are, those of the last training.

    Simulators of the last training that do not answer, or do not have the game, are left out. A cluster needs the games
    of the last training, too. trust: believe a run that this user has not trained here. Raises UntrustedRunError.
    """
    if wanted != SimulatorSource() and (wanted.games or not wanted.cluster):
        return wanted
    remembered = last.believed(trust)
    if wanted.cluster:
        return replace(wanted, games=remembered.games)
    try:
        for place in remembered.protected():
            wait_for(place, LAST_SECONDS, lambda text: None)
            for game in config.played.values():
                if not game.simulator:
                    describe(place, game.game, {})
    except (SimulatorError, CredentialsError) as error:
        say(f"the simulator of the training cannot be used: {error}; starting one")
        return SimulatorSource(games=remembered.games)
    if remembered.addresses:
        say(f"simulator: {', '.join(remembered.addresses)}, as in the training; --simulator names another")
    return remembered


@contextmanager
def open_simulators(simulators: SimulatorSource, wait: float, say: Callable[[str], None]) -> Iterator[Connect]:
    """Yield a function that returns addresses at which simulators answer, for the first time and after a loss.

    Each call starts simulators in place of those before, which end with the block; or it waits for the simulators of
    others, `wait` seconds for each. It raises SimulatorError and CredentialsError.
    """
    with ExitStack() as running:

        def connect() -> Sequence[str]:
            running.close()
            if simulators.cluster:
                start = load("joybridge.clusters", "ray-simulators")
                started = start(simulators.cluster, simulators.count, simulators.games, wait)
                return list(running.enter_context(started))
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
