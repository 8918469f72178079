"""Recording: watch a run's policy play, as an mp4."""

import math
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from joybridge.trainer.config import ConfigError
from joybridge.trainer.playing import Players, run_config
from joybridge.trainer.wire.client import Session, describe

FASTEST = 30.0  # frames per second; faster games are recorded every few decisions, at their own pace
SLOWEST = 5.0  # for turn-based games


def record(
    run: Path, address: str, output: Path, *, seconds: float, seed: int, deterministic: bool, say: Callable[[str], None]
) -> int:
    """Record `seconds` of video of a run's policy in one arena; return the number of frames.

    The picture is the simulator's, score included. Raises SimulatorError, CheckpointError or ConfigError.
    """
    config = run_config(run)
    spec = describe(address, config.game, config.options)
    if not spec.HasField("picture"):
        raise ConfigError(f"{spec.name} cannot be drawn: its spec has no picture")
    pace = 1.0 / (spec.tick_seconds * spec.decision_interval) if spec.tick_seconds else SLOWEST
    every = math.ceil(pace / FASTEST)
    frames = round(seconds * pace / every)
    output.parent.mkdir(parents=True, exist_ok=True)
    with (
        Session(
            address, config.game, arenas=1, seed=seed, options=config.options, parameters=config.parameters
        ) as session,
        av.open(str(output), "w") as video,
    ):
        stream = video.add_stream("libx264", rate=Fraction(pace / every).limit_denominator(1000))
        stream.width, stream.height = (side // 2 * 2 for side in (spec.picture.width, spec.picture.height))
        stream.pix_fmt = "yuv420p"  # of even sizes: an odd picture loses its last row or column
        players = Players(run, spec, 1, seed, deterministic=deterministic)
        players.begin(session.steps)
        for frame in range(frames):
            for _ in range(every - 1):
                players.take(session.step(players.act(session.steps)))
            steps, pictures = session.step_and_draw(players.act(session.steps), [0])
            players.take(steps)
            picture = np.ascontiguousarray(pictures[0][: stream.height, : stream.width])
            video.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "rgb24")))
            if (frame + 1) % 100 == 0:
                say(f"{frame + 1} of {frames} frames")
        video.mux(stream.encode())
    return frames
