"""Recording: watch a run's policy play, as a video."""

import math
from collections.abc import Callable, Iterator
from itertools import islice
from pathlib import Path

from joybridge.config.errors import no_picture
from joybridge.contract.tensors import Array
from joybridge.play.input_overlay import Inputs
from joybridge.play.playing import Play, Played, PlaySpec, open_play
from joybridge.play.pointer_marks import mark_pointers
from joybridge.play.video import VideoFile
from joybridge.play.video_formats import video_format
from joybridge.progress import Progress
from joybridge.v1 import bridge_pb2 as pb

FASTEST = 30.0  # frames per second; faster games are recorded every few decisions, at their own pace
SLOWEST = 5.0  # for turn-based games


def record(
    plays: PlaySpec,
    output: Path,
    seconds: float | None = None,
    episodes: int | None = None,
    *,
    say: Callable[[str], None],
    inputs: bool = False,
) -> int:
    """Record either `seconds` or `episodes` of a run's policy in one arena; return the number of frames.

    The picture is the simulator's, score included, after every tick where decisions are slower than FASTEST, with a
    cross where a pointer is put; images that the policy sees are beside it, and what it remembers is below.

    inputs: below the picture, draw what is pressed. Raises SimulatorError, CheckpointError or ConfigError.
    """
    video_format(output)  # a wrong one is refused before anything is played
    with open_play(plays) as play:
        say(play.heading())
        pace, ticks = pace_of(play.spec), 1
        if play.spec.tick_seconds and pace < FASTEST:
            ticks = play.spec.decision_interval
        every = math.ceil(pace * ticks / FASTEST)
        frames = None if seconds is None else max(1, round(seconds * pace * ticks / every))
        view, overlay = play.view(), Inputs(play.spec) if inputs else None
        progress = Progress(say)
        height = view.height + (overlay.height if overlay else 0)
        number = ended = 0
        with VideoFile(output, view.width, height, pace * ticks / every) as video:
            pictures = islice(_pictures(play, ticks, every, episodes), frames)
            memories, shown = [play.remembered()] * 2, None  # before and after the decision that is shown
            for number, (decision, picture, last, ended) in enumerate(pictures, 1):
                if decision is not shown:
                    memories, shown = [memories[1], play.remembered()], decision
                marked = mark_pointers(picture, play.spec, decision.acts)
                seen = view.beside(marked, decision.after if last else decision.before, memories[last])
                video.write(overlay.below(seen, decision.acts) if overlay else seen)
                progress.report(f"{number} of {frames} frames" if frames else f"{ended} of {episodes} episodes")
        if seconds is not None and not ended:
            say(f"no episode has ended within {seconds:g} s; --episodes 1 records a whole one")
    return number


def _pictures(play: Play, ticks: int, every: int, episodes: int | None) -> Iterator[tuple[Played, Array, bool, int]]:
    """Yield pictures of the first arena, each with its decision, whether it is the last of it, and the episodes so far.

    ticks: of a decision that are shown. every: yield one picture of so many. episodes: stop after them; None: never. An
    episode that ends within a decision, or a game that draws decisions only, shows its last picture for the rest of the
    decision.
    """
    number = ended = 0
    for decision in play.decisions(every if ticks == 1 else 1, ticks=ticks > 1):
        ended += any(len(step.ended) for step in decision.after)
        if ticks == 1:
            yield from ((decision, picture, True, ended) for picture in decision.pictures)
        else:
            for tick in range(ticks):
                number += 1
                if number % every == 0:
                    last = min(tick, len(decision.pictures) - 1)
                    yield decision, decision.pictures[last], last == len(decision.pictures) - 1, ended
        if ended == episodes:
            return


def pace_of(spec: pb.GameSpec) -> float:
    """Return how many decisions a second of a video shows. Raises ConfigError if the game cannot be drawn."""
    if not spec.HasField("picture"):
        raise no_picture(spec.name)
    return 1.0 / (spec.tick_seconds * spec.decision_interval) if spec.tick_seconds else SLOWEST
