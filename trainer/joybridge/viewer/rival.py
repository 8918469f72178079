"""Policies of a run that play beside the person, in an arena of their own, or in the person's. Needs torch."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from joybridge.config.errors import ConfigError
from joybridge.config.game_settings import fixed
from joybridge.contract.tensors import Array
from joybridge.play.playing import Play, Policies, open_play
from joybridge.run.folder import play_config
from joybridge.v1 import bridge_pb2 as pb
from joybridge.viewer.arena import Settings
from joybridge.viewer.scores import Scores

FAST = 0.05  # s between decisions: where there are fewer, every other picture is enough


class Rival:
    """The policies of a run, which decide whenever the person does. picture: of the last decision, or None."""

    def __init__(self, play: Play) -> None:
        """Play in an open session."""
        self.title = play.heading()
        self.scores = Scores(play.spec)
        self.picture: Array | None = None
        fast = play.spec.tick_seconds * play.spec.decision_interval < FAST
        self._decisions = play.decisions((2 if fast else 1) if play.spec.HasField("picture") else 0)

    def play(self) -> None:
        """Play one decision. Raises SimulatorError."""
        played = next(self._decisions)
        self.picture = played.pictures[0] if played.pictures else None
        self.scores.take(played.after)


@contextmanager
def open_rival(run: Path, address: str, settings: Settings) -> Iterator[Rival]:
    """Open an arena for the policies of a run. Raises SimulatorError, CheckpointError and ConfigError."""
    with open_play(run, address, seed=settings.seed, overrides=_overrides(settings)) as play:
        yield Rival(play)


def load_others(run: Path, spec: pb.GameSpec, settings: Settings) -> Policies:
    """Return the policies of a run, for the seats that the person does not hold.

    spec: of the game under these settings. Raises CheckpointError and ConfigError.
    """
    return Policies(run, play_config(run, _overrides(settings)), spec, 1, settings.seed)


def run_settings(argument: str, run: Path, game: str, settings: Settings) -> Settings:
    """Return settings with the options and parameters of a run where they set none. Raises ConfigError.

    argument: that names the run, for the error.
    """
    config = play_config(run, _overrides(settings))
    if config.game != game:
        raise ConfigError(f"{argument}: {run} plays {config.game}, expected {game}; name a run of this game")
    return Settings(settings.seed, dict(config.options), fixed(config.parameters))


def _overrides(settings: Settings) -> list[str]:
    options = [f"options.{name}={choice}" for name, choice in settings.options.items()]
    return options + [f"parameters.{name}={value!r}" for name, value in settings.parameters.items()]
