"""A video of one policy in several games, side by side, each at its own pace."""

import math
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import av
import numpy as np

from joybridge.contract.tensors import Array
from joybridge.play.playing import Play, PlaySpec, open_play
from joybridge.play.pointer_marks import mark_pointers
from joybridge.play.record import FASTEST, pace_of
from joybridge.play.video import VideoFile
from joybridge.play.video_formats import video_format

CELL = (360, 240)  # width and height of a game's place, px


def record_games(plays: PlaySpec, output: Path, *, games: Sequence[str], seconds: float) -> int:
    """Record a run's policy in these games at once, in rows from the top left; return the number of frames.

    See `record` for errors.
    """
    video_format(output)
    columns = math.ceil(math.sqrt(len(games)))
    width, height = columns * CELL[0], -(-len(games) // columns) * CELL[1]
    frames = max(1, round(seconds * FASTEST))
    with ExitStack() as opened:
        shown = []
        for game in games:
            play = opened.enter_context(open_play(replace(plays, only_game=game)))
            shown.append(_pictures(play))
        video = opened.enter_context(VideoFile(output, width, height, FASTEST))
        for _ in range(frames):
            whole = np.zeros((height, width, 3), np.uint8)
            for number, pictures in enumerate(shown):
                top, left = number // columns * CELL[1], number % columns * CELL[0]
                _put(next(pictures), whole[top : top + CELL[1], left : left + CELL[0]])
            video.write(whole)
    return frames


def _pictures(play: Play) -> Iterator[Array]:
    """Yield the picture of a game for each frame of a video: that of its last decision until then."""
    pace, size = pace_of(play.spec), play.spec.picture
    due, picture = 0.0, np.zeros((size.height, size.width, 3), np.uint8)
    for decision in play.decisions(draw_every=1):
        picture = mark_pointers(decision.pictures[0], play.spec, decision.acts)
        due += FASTEST / pace  # frames until the next decision
        while due >= 1.0:
            due -= 1.0
            yield picture


def _put(picture: Array, place: Array) -> None:
    """Draw a picture as large as it fits into the middle of a place, both uint8 [height, width, 3]."""
    scale = min(place.shape[0] / picture.shape[0], place.shape[1] / picture.shape[1])
    height, width = (max(2, round(side * scale)) for side in picture.shape[:2])
    frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), "rgb24")
    small = frame.reformat(width=width, height=height, interpolation="AREA").to_ndarray()
    top, left = (place.shape[0] - height) // 2, (place.shape[1] - width) // 2
    place[top : top + height, left : left + width] = small
