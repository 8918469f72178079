"""Recording: watch a run's policy play, as a video."""

import math
from collections.abc import Callable
from itertools import islice
from pathlib import Path

from joybridge.config.errors import ConfigError
from joybridge.play.input_overlay import Inputs
from joybridge.play.playing import PlaySpec, open_play
from joybridge.play.pointer_marks import mark_pointers
from joybridge.play.video import VideoFile
from joybridge.play.video_formats import video_format
from joybridge.progress import Progress
from joybridge.v1 import bridge_pb2 as pb

FASTEST = 30.0  # frames per second; faster games are recorded every few decisions, at their own pace
SLOWEST = 5.0  # for turn-based games


def record(plays: PlaySpec, output: Path, *, seconds: float, say: Callable[[str], None], inputs: bool = False) -> int:
    """Record `seconds` of video of a run's policy in one arena; return the number of frames.

    The picture is the simulator's, score included, with a cross where a pointer is put; images that the policy sees are
    beside it, and what it remembers is below. inputs: below the picture, draw what is pressed. Raises SimulatorError,
    CheckpointError or ConfigError.
    """
    video_format(output)  # a wrong one is refused before anything is played
    with open_play(plays) as play:
        say(play.heading())
        pace = pace_of(play.spec)
        every = math.ceil(pace / FASTEST)
        frames = round(seconds * pace / every)
        view, overlay = play.view(), Inputs(play.spec) if inputs else None
        progress = Progress(say)
        height = view.height + (overlay.height if overlay else 0)
        with VideoFile(output, view.width, height, pace / every) as video:
            for number, decision in enumerate(islice(play.decisions(draw_every=every), frames * every), 1):
                for picture in decision.pictures:
                    marked = mark_pointers(picture, play.spec, decision.acts)
                    seen = view.beside(marked, decision.after, play.remembered())
                    video.write(overlay.below(seen, decision.acts) if overlay else seen)
                progress.report(f"{number // every} of {frames} frames")
    return frames


def pace_of(spec: pb.GameSpec) -> float:
    """Return how many decisions a second of a video shows. Raises ConfigError if the game cannot be drawn."""
    if not spec.HasField("picture"):
        raise ConfigError(f"{spec.name} cannot be drawn: its spec has no picture")
    return 1.0 / (spec.tick_seconds * spec.decision_interval) if spec.tick_seconds else SLOWEST
