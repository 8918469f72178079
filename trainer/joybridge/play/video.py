"""A video file that is written picture by picture."""

import os
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Self, cast

import av
import numpy as np

from joybridge.contract.tensors import Array
from joybridge.play.video_formats import video_format


class VideoFile:
    """An open video. Leaving the block completes it, also by Ctrl-C; an error leaves the file as it was before."""

    def __init__(self, output: Path, width: int, height: int, rate: float) -> None:
        """Create the file, whose name says its format. width, height: of the pictures. rate: pictures per second."""
        form, exact = video_format(output), Fraction(rate).limit_denominator(1000)
        output.parent.mkdir(parents=True, exist_ok=True)
        self._output, self._part = output, output.with_name(f".{output.stem}.{os.getpid()}{output.suffix}")
        self._file = av.open(str(self._part), "w")
        self._stream = cast(av.VideoStream, self._file.add_stream(form.codec, rate=exact))
        # yuv420p has even sizes: an odd picture loses its last row or column.
        self._stream.width, self._stream.height = (side // 2 * 2 for side in (width, height))
        self._stream.pix_fmt = form.pixels
        pal8 = form.pixels == "pal8"
        self._palettes = _Palettes(self._stream.width, self._stream.height, exact) if pal8 else None

    def write(self, picture: Array) -> None:
        """Add a picture, uint8 [height, width, 3]."""
        even = np.ascontiguousarray(picture[: self._stream.height, : self._stream.width])
        frame = av.VideoFrame.from_ndarray(even, "rgb24")
        self._file.mux(self._stream.encode(self._palettes.apply(frame) if self._palettes else frame))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        whole = error is None or isinstance(error, KeyboardInterrupt)
        try:
            if whole:
                self._file.mux(self._stream.encode())
            self._file.close()
            if whole:
                self._part.replace(self._output)
        finally:
            self._file.close()
            self._part.unlink(missing_ok=True)


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
