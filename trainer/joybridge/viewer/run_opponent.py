"""Who plays beside the person: policies of a run in an arena of their own, or others in its own. Needs torch."""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from joybridge.config.config import make_config
from joybridge.config.errors import ConfigError
from joybridge.config.game_settings import fixed
from joybridge.contract.codec import lane_count
from joybridge.contract.tensors import Array
from joybridge.play.playing import Play, PlaySpec, changed_settings, open_play
from joybridge.policy.players import Players
from joybridge.policy.table import Table
from joybridge.run.folder import play_config
from joybridge.run.others import load_other, rated_name, run_of
from joybridge.v1 import bridge_pb2 as pb
from joybridge.viewer.arena import Settings
from joybridge.viewer.rated import RatedMatches
from joybridge.viewer.scores import Scores

FAST = 0.05  # s between decisions: where there are fewer, every other picture is enough


class Rival:
    """The policies of a run, which decide whenever the person does. pictures: of the last decision, at most one."""

    def __init__(self, play: Play) -> None:
        """Play in an open session."""
        self.title = play.heading()
        self.scores = Scores(play.spec)
        self.pictures: list[Array] = []
        fast = play.spec.tick_seconds * play.spec.decision_interval < FAST
        self._decisions = play.decisions((2 if fast else 1) if play.spec.HasField("picture") else 0)

    def play(self) -> None:
        """Play one decision. Raises SimulatorError."""
        played = next(self._decisions)
        self.pictures = played.pictures
        self.scores.take(played.after)


@contextmanager
def open_rival(run: Path, address: str, settings: Settings) -> Iterator[Rival]:
    """Open an arena for the policies of a run. Raises SimulatorError, CheckpointError and ConfigError."""
    with open_play(PlaySpec(run, address, seed=settings.seed, overrides=_overrides(settings))) as play:
        yield Rival(play)


def load_others(names: Sequence[str], game: str, spec: pb.GameSpec, settings: Settings) -> Players:
    """Return who hold the seats that people do not, in turn.

    names: see `load_other`; the first run among them says what limits their hands. spec: of the game under these
    settings. Raises CheckpointError and ConfigError.
    """
    runs = [run for name in names if (run := run_of(name))]
    settled = {"game": game, "options": settings.options, "parameters": settings.parameters}
    config = play_config(runs[0], _overrides(settings)) if runs else make_config(settled)
    players, table = Players([], config, spec, 1, settings.seed), Table(spec, 1, settings.seed)
    for number, name in enumerate(names):
        table.join(number, load_other(name, game, spec))
    table.seats.begin(0, (np.arange(table.seats.count) - 1) % len(names))  # a person alone holds the first seat
    players.seat(table)
    return players


def rate_people(names: Sequence[str], people: Sequence[str], spec: pb.GameSpec, settings: Settings) -> RatedMatches:
    """Return the log of matches between people and others. names: of the others, see `load_others`.

    It is in the folder `rating` of the first run among them, or of the current folder. Raises ConfigError if the
    settings are not those of this run's training, because its log holds matches under these.
    """
    run = next((run for name in names if (run := run_of(name))), None)
    if run and (changed := changed_settings(play_config(run, ()), play_config(run, _overrides(settings)), spec)):
        raise ConfigError(
            f"--rate: matches are rated under the settings with which {run} was trained; put back "
            f"{', '.join(changed)}, or leave --rate out"
        )
    folder = (run or Path()) / "rating"
    called = [rated_name(name) for name in names] or [""]  # without others, people hold all seats
    seats = sum(lane_count(behavior, 1) for behavior in spec.behaviors)
    return RatedMatches(folder, spec, [called[(seat - 1) % len(called)] for seat in range(seats)], people)


def run_settings(argument: str, run: Path, game: str, settings: Settings) -> Settings:
    """Return settings with the options and parameters of a run where they set none. Raises ConfigError.

    argument: that names the run, for the error.
    """
    config = play_config(run, _overrides(settings))
    if config.game != game:
        raise ConfigError(f"{argument}: {run} plays {config.game}, expected {game}; name a run of this game")
    return Settings(settings.seed, dict(config.options), fixed(config.parameters))


def _overrides(settings: Settings) -> list[str]:
    options = [f"options.{name}={json.dumps(choice)}" for name, choice in settings.options.items()]
    return options + [f"parameters.{name}={value!r}" for name, value in settings.parameters.items()]
