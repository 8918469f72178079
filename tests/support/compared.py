"""Comparisons of a small configuration, which train in this process."""

from pathlib import Path

import pytest

from joybridge.compare import grid, launch
from joybridge.compare import page as pages
from tests.support.command_line import Done, joybridge
from tests.support.jobs import train_here

SMALL = """
game: archer
arenas: 8
pipeline_groups: 1
total_timesteps: 1280
log_interval: 320
policy: {frame_stack: 1, hidden_sizes: [16], rollout_steps: 20, time_horizon: 20, minibatch_size: 80}
"""


OUT = Path("out")


def run_in(folder: Path, simulator: str, *more: str, draw: bool = False) -> Done:
    """Compare two layouts with two seeds in a folder.

    simulator: an address; "": the command starts one. draw: also draw the pictures, which takes a second.
    """
    with pytest.MonkeyPatch.context() as patch:
        if not draw:
            patch.setattr(pages, "draw_pictures", lambda *_: [])
        patch.chdir(folder)
        patch.setattr(launch, "start", train_here)
        patch.setattr(grid, "POLL_SECONDS", 0.0)  # they have ended when they are polled
        Path("small.yaml").write_text(SMALL)
        shared = ["--layouts", "hybrid", "bucket-3", "--seeds", "2", "--output", str(OUT)]
        at = ["--simulator", simulator] if simulator else []
        return joybridge("compare", "small.yaml", *shared, *at, *more)
