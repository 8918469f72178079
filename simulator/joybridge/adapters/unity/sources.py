"""Where players come from: a build, of which as many are started as are needed, or ports for those started by hand.

Player p plays the arenas from p * areas on of every seed.
"""

import atexit
import hashlib
import logging
from collections.abc import Sequence
from threading import Condition

from joybridge.adapters.settings import AdapterError
from joybridge.adapters.unity.communicator import Communicator
from joybridge.adapters.unity.player import UnityPlayer
from joybridge.adapters.unity.process import PlayerProcess
from joybridge.adapters.unity.settings import UnitySettings
from joybridge.simulator.batched_game import GameError

log = logging.getLogger("simulator")
SEEDS = 2**31  # a player's seed is an int32
GIVE_BACK_SECONDS = 1.0  # for a session that has ended to give its players back


class Builds:
    """Starts players of a build."""

    def __init__(self, settings: UnitySettings) -> None:
        """Take the path of a build."""
        self.settings = settings

    def open(self, numbers: Sequence[int], seed: int) -> list[UnityPlayer]:
        """Start these players and wait for them. Raises GameError."""
        players: list[UnityPlayer] = []
        try:
            for _ in numbers:
                players.append(self._start())
            for number, player in zip(numbers, players, strict=True):
                player.greet(player_seed(seed, number), self.settings.areas)
        except BaseException:
            self.release(players)
            raise
        return players

    def _start(self) -> UnityPlayer:
        communicator = Communicator()
        try:
            return UnityPlayer(self.settings, communicator, PlayerProcess(self.settings, communicator.port))
        except BaseException:
            communicator.close()
            raise

    def reseed(self, players: Sequence[UnityPlayer], numbers: Sequence[int], seed: int) -> list[UnityPlayer]:
        """Return players that begin with another seed: new ones, because a player is seeded only once."""
        self.release(players)
        return self.open(numbers, seed)

    def release(self, players: Sequence[UnityPlayer]) -> None:
        """End players."""
        for player in players:
            player.end()


class Ports:
    """Waits for players that are started by hand, one per port."""

    def __init__(self, settings: UnitySettings) -> None:
        """Listen on the ports. Raises AdapterError for what is no port, and GameError for one that is in use."""
        self.settings = settings
        place = settings.place or "5004"
        if not (place.isdecimal() and 0 < int(place) <= 2**16 - settings.players):
            raise AdapterError(f"got the port {place!r}, expected 1..{2**16 - settings.players}")
        self._communicators = [Communicator(int(place) + number) for number in range(settings.players)]
        self._players: dict[int, UnityPlayer] = {}  # that are connected, by number
        self._taken: set[int] = set()
        self._changed = Condition()  # what is taken
        for communicator in self._communicators:
            atexit.register(communicator.end)

    def open(self, numbers: Sequence[int], seed: int) -> list[UnityPlayer]:
        """Take these players, and wait for those that are not there. Raises GameError."""
        ports = [one.port for one in self._communicators]
        with self._changed:
            # The session before this one may have ended a moment ago.
            self._changed.wait_for(lambda: not self._taken.intersection(numbers), GIVE_BACK_SECONDS)
            for number in numbers:
                if number >= len(ports) or number in self._taken:
                    why = "another session plays with it" if number < len(ports) else "nobody listens for it"
                    raise GameError(
                        f"player {number}, for the arenas from {number * self.settings.areas} on, is not free: {why}; "
                        "set pipeline_groups=1, or serve more players (players=N) or larger ones (areas=N)"
                    )
            self._taken.update(numbers)
        players: list[UnityPlayer] = []
        try:
            for number in numbers:
                players.append(self._player(number, player_seed(seed, number)))
        except BaseException:
            with self._changed:
                self._taken.difference_update(numbers)
                self._changed.notify_all()
            raise
        return players

    def reseed(self, players: Sequence[UnityPlayer], numbers: Sequence[int], seed: int) -> list[UnityPlayer]:
        """Return the players as they are if that is allowed. Raises GameError: a player is seeded only once."""
        if not self.settings.any_seed:
            raise GameError(SEEDED)
        return list(players)

    def release(self, players: Sequence[UnityPlayer]) -> None:
        """Keep players for another session, and dismiss those that cannot go on."""
        with self._changed:
            for number, player in list(self._players.items()):
                if player in players:
                    self._taken.discard(number)
                    if not player.communicator.waiting:
                        player.end()
                        del self._players[number]
            self._changed.notify_all()

    def _player(self, number: int, seed: int) -> UnityPlayer:
        player = self._players.get(number)
        if player is None or not player.communicator.waiting:
            communicator = self._communicators[number]
            if player is not None:  # it has failed; one that came after it may wait already
                communicator.dismiss()
            player = UnityPlayer(self.settings, communicator, None)
            log.info("waiting up to %g s for a player at port %d", self.settings.start, communicator.port)
            player.greet(seed, self.settings.areas)
            self._players[number] = player
        elif not self.settings.any_seed and (player.unused is None or player.seed != seed):
            raise GameError(
                SEEDED
                if player.unused is None
                else f"player {number} was greeted with seed {player.seed}, not {seed}; "
                f"serve it with seed={seed} or any_seed=true"
            )
        return player


SEEDED = (
    "a player that was started by hand is seeded once, when it connects; start it again, serve a build, or serve with "
    "any_seed=true, which plays on for any seed"
)


def player_seed(seed: int, number: int) -> int:
    """Return the seed of a player: the first one's is that of the session if it is an int32."""
    if number == 0 and seed < SEEDS:
        return seed
    digest = hashlib.blake2b(f"{seed} {number}".encode(), digest_size=8).digest()
    return int.from_bytes(digest, "little") % SEEDS
