"""Demonstrations of single games as those of the common device, so that one policy clones a specialist of each game."""

from pathlib import Path

from joybridge.client.recording import RecordingError, load_recording
from joybridge.demonstrations.files import foreign_kind
from joybridge.demonstrations.recorded import Demonstration, RecordedEpisodes, load_recorded
from joybridge.policy.lineup import Lineup


def load_translated(path: Path, lineup: Lineup) -> Demonstration:
    """Return a file under the common spec: as the game with the options of the recording, or else one that it fits.

    Raises RecordingError for other games.
    """
    if foreign := foreign_kind(path):
        raise RecordingError(f"{path} is {foreign}, which does not say what the game is; several games need to know it")
    recording = load_recording(path)
    if recording.spec is None:
        raise RecordingError(f"{path} holds a fault, expected a demonstration; move it elsewhere")
    name, options = recording.spec.name, recording.start.options
    wrong = RecordingError(
        f"{path} is a demonstration of {name}, expected one of {', '.join(lineup.games)}; name another folder"
    )
    same = [game for game, spec in lineup.specs.items() if spec.name == name]
    # A game may be there twice, with other options.
    for game in sorted(same, key=lambda game: not lineup.has_options(game, options)):
        try:
            recorded = load_recorded(path, lineup.specs[game])
        except RecordingError as error:
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
        return recorded._replace(spec=lineup.spec, stretches=stretches, kind=[*lineup.games].index(game))
    raise wrong
