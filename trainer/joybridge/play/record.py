"""Recording: watch a run's policy play, as a video."""

import math
from collections.abc import Callable, Sequence
from fractions import Fraction
from itertools import islice
from pathlib import Path
from typing import cast

import av
import numpy as np

from joybridge.config.errors import ConfigError
from joybridge.play.input_overlay import Inputs
from joybridge.play.playing import open_play
from joybridge.play.video_formats import video_format

FASTEST = 30.0  # frames per second; faster games are recorded every few decisions, at their own pace
SLOWEST = 5.0  # for turn-based games


def record(
    run: Path, address: str, output: Path, *, seconds: float, seed: int, deterministic: bool,
    say: Callable[[str], None], overrides: Sequence[str] = (), checkpoint: str = "", inputs: bool = False,
    others: Sequence[str] = (),
) -> int:  # fmt: skip
    """Record `seconds` of video of a run's policy in one arena; return the number of frames.

    The picture is the simulator's, score included; images that the policy sees are beside it. overrides: "key=value"
    each, options and parameters of the game that differ from the training. checkpoint: "best", its timesteps, or "" for
    the newest. inputs: below the picture, draw what is pressed. others: who hold all seats but the first.
    Raises SimulatorError, CheckpointError or ConfigError.
    """
    form = video_format(output)
    with open_play(
        run, address, seed=seed, deterministic=deterministic, overrides=overrides, checkpoint=checkpoint, others=others
    ) as play:
        say(play.heading())
        spec = play.spec
        if not spec.HasField("picture"):
            raise ConfigError(f"{spec.name} cannot be drawn: its spec has no picture")
        pace = 1.0 / (spec.tick_seconds * spec.decision_interval) if spec.tick_seconds else SLOWEST
        every = math.ceil(pace / FASTEST)
        frames = round(seconds * pace / every)
        output.parent.mkdir(parents=True, exist_ok=True)
        with av.open(str(output), "w") as video:
            rate = Fraction(pace / every).limit_denominator(1000)
            stream = cast(av.VideoStream, video.add_stream(form.codec, rate=rate))
            view, overlay = play.view(), Inputs(spec) if inputs else None
            height = view.height + (overlay.height if overlay else 0)
            stream.width, stream.height = (side // 2 * 2 for side in (view.width, height))
            stream.pix_fmt = form.pixels  # yuv420p has even sizes: an odd picture loses its last row or column
            palettes = _Palettes(stream.width, stream.height, rate) if form.pixels == "pal8" else None
            for number, decision in enumerate(islice(play.decisions(draw_every=every), frames * every), 1):
                for picture in decision.pictures:
                    seen = view.beside(picture, decision.after)
                    shown = overlay.below(seen, decision.acts) if overlay else seen
                    even = np.ascontiguousarray(shown[: stream.height, : stream.width])
                    frame = av.VideoFrame.from_ndarray(even, "rgb24")
                    video.mux(stream.encode(palettes.apply(frame) if palettes else frame))
                if number % (100 * every) == 0:
                    say(f"{number // every} of {frames} frames")
            video.mux(stream.encode())
    return frames


class _Palettes:
    """Gives each frame of a GIF the 256 colors that suit it. With a fixed palette, dark pictures are noise."""

    def __init__(self, width: int, height: int, rate: Fraction) -> None:
        """rate: frames per second."""
        self._graph, self._tick, self._frames = av.filter.Graph(), 1 / rate, 0
        self._source = self._graph.add_buffer(
            width=width, height=height, format=av.VideoFormat("rgb24"), time_base=self._tick
        )
        both, chosen = self._graph.add("split"), self._graph.add("palettegen", "stats_mode=single")
        painted = self._graph.add("paletteuse", "new=1:dither=none")
        self._sink = self._graph.add("buffersink")
        self._source.link_to(both)
        both.link_to(chosen)
        both.link_to(painted, 1)
        chosen.link_to(painted, 0, 1)
        painted.link_to(self._sink)
        self._graph.configure()

    def apply(self, frame: av.VideoFrame) -> av.VideoFrame:
        """Return a frame in a palette of its own."""
        frame.pts, frame.time_base = self._frames, self._tick
        self._frames += 1
        self._source.push(frame)
        return cast(av.VideoFrame, self._sink.pull())
