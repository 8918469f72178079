"""Demonstrations of single games as those of the common device, so that one policy clones a specialist of each game."""

from collections.abc import Iterator, Sequence
from pathlib import Path

from joybridge.client.recording import RecordingError
from joybridge.demonstrations.files import foreign_kind
from joybridge.demonstrations.recorded import Demonstration, RecordedEpisodes, load_recorded
from joybridge.policy.lineup import Lineup


def load_for_games(paths: Sequence[Path], lineup: Lineup) -> list[Demonstration]:
    """Return what files of single games show to a policy of several. Raises RecordingError for other games."""
    return [_translated(path, lineup) for path in paths]


def remarks_on_games(shown: Sequence[Demonstration], lineup: Lineup) -> Iterator[str]:
    """Yield a line for each game: how many episodes are demonstrated."""
    for kind, game in enumerate(lineup.games):
        episodes = sum(one.episodes(0)[0] for one in shown if one.kind == kind)
        yield f"{game}: {episodes:,} episodes are demonstrated"


def _translated(path: Path, lineup: Lineup) -> Demonstration:
    """Return a file under the common spec of the games, as the first of them whose spec it fits."""
    if foreign := foreign_kind(path):
        raise RecordingError(f"{path} is {foreign}, which does not say what the game is; several games need to know it")
    name = load_recorded(path, None).spec.name
    wrong = RecordingError(
        f"{path} is a demonstration of {name}, expected one of {', '.join(lineup.games)}; name another folder"
    )
    for kind, (game, spec) in enumerate(lineup.specs.items()):
        if spec.name != name:
            continue
        try:
            recorded = load_recorded(path, spec)
        except RecordingError as error:  # the same game may be there twice, with other options
            wrong = error
            continue
        translation = lineup.translation(game)
        stretches = [
            RecordedEpisodes(
                [[translation.step(step)] for (step,) in part.steps],
                [[translation.demonstrated(act)] for (act,) in part.acts],
                part.held,
            )
            for part in recorded.stretches
        ]
        return recorded._replace(spec=lineup.spec, stretches=stretches, kind=kind)
    raise wrong
