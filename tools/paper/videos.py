"""Short, small videos of the best run of each layout on each game, and a moving picture of the best of each game.

python -m tools.paper.videos RUN [RUN …]    writes GAME-LAYOUT.mp4, and GAME.webp for pages without videos

A video starts in the middle of an episode. Games with more than 25 decisions per second are shown in real time. In
slower games every decision is a frame, so Beastly Rivals is shown three times as fast as it is played.
"""

import argparse
import sys
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from statistics import mean
from typing import NamedTuple, cast

import av

from joybridge.client.client import SimulatorError
from joybridge.client.launch import simulator_process
from joybridge.config.errors import CheckpointError, ConfigError
from joybridge.config.metrics import read_rows
from joybridge.play.playing import PlaySpec, open_play
from joybridge.run.folder import run_config

RATE = 25  # frames per second
ROWS = 10  # last rows of metrics, whose mean reward is the score of a run
SMALLER = 0.75  # factor for the width and the height of pictures


class Format(NamedTuple):
    """A codec with its options and the options of the file."""

    codec: str
    codec_options: dict[str, str]
    file_options: dict[str, str]


MP4 = Format("libx264", {"crf": "27", "preset": "slower"}, {"movflags": "faststart"})
WEBP = Format("libwebp_anim", {"quality": "60"}, {"loop": "0"})  # 0: endless


def frames(run: Path, address: str, seed: int) -> Iterator[av.VideoFrame]:
    """Yield pictures of a run's policy, from the middle of an episode on.

    Raises SimulatorError, CheckpointError or ConfigError.
    """
    with open_play(PlaySpec(run, address, seed=seed)) as played:
        spec = played.spec
        if not spec.HasField("picture"):
            raise ConfigError(f"{spec.name} cannot be drawn: its spec has no picture")
        every = max(1, round(1 / (spec.tick_seconds * spec.decision_interval * RATE))) if spec.tick_seconds else 1
        for _ in islice(played.decisions(), spec.max_episode_decisions // 2):
            pass
        for decision in played.decisions(draw_every=every):
            for picture in decision.pictures:
                yield av.VideoFrame.from_ndarray(picture, "rgb24")


def encode(pictures: Sequence[av.VideoFrame], output: Path, kind: Format, rate: int) -> None:
    """Write pictures as a smaller video. rate: frames per second."""
    width, height = (round(SMALLER * side / 2) * 2 for side in (pictures[0].width, pictures[0].height))
    output.parent.mkdir(parents=True, exist_ok=True)
    with av.open(str(output), "w", container_options=kind.file_options) as video:
        stream = cast(av.VideoStream, video.add_stream(kind.codec, rate=rate, options=kind.codec_options))
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        for number, picture in enumerate(pictures):
            small = picture.reformat(width, height, "yuv420p", interpolation="AREA")
            small.pts = number
            video.mux(stream.encode(small))
        video.mux(stream.encode())


def score(run: Path) -> float:
    """Return the mean reward of all policies at the end of a run; minus infinity without metrics."""
    rows = [row for path in run.glob("metrics-*.csv") for row in read_rows(path)[-ROWS:]]
    return mean([row["reward"] for row in rows if "reward" in row] or [float("-inf")])


def best(runs: Iterable[Path], *keys: str) -> dict[tuple[str, ...], Path]:
    """Return the best run for each combination of values of some configuration keys. Raises ConfigError."""
    return {tuple(getattr(run_config(run), key) for key in keys): run for run in sorted(runs, key=score)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit status."""
    parser = argparse.ArgumentParser(description="Record short, small videos of the best runs.")
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="folder of a run")
    parser.add_argument("--seconds", type=float, default=12.0, help="length of each video; default: %(default)g")
    parser.add_argument(
        "--seed", type=int, default=1, help="seed of the games and of action sampling; default: %(default)s"
    )
    parser.add_argument(
        "--output", type=Path, default=Path("results/videos"), help="folder of videos; default: %(default)s"
    )
    options = parser.parse_args(arguments)
    try:
        with simulator_process() as address:
            winners = best(options.runs, "game", "layout")
            champions = best(options.runs, "game").values()
            for (game, layout), run in winners.items():
                pictures = list(islice(frames(run, address, options.seed), round(options.seconds * RATE)))
                encode(pictures, options.output / f"{game}-{layout}.mp4", MP4, RATE)
                if run in champions:
                    encode(pictures[::2], options.output / f"{game}.webp", WEBP, RATE // 2)
                print(f"{game} {layout}: {run}", flush=True)
    except (CheckpointError, ConfigError, SimulatorError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
