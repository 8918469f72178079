"""A program that knows nothing of us, from a person at its page to a policy that has learned from what they played."""

import io
import json
from typing import Any

import numpy as np
import pytest
from PIL import Image

from joybridge.client.recording import load_recording
from joybridge.config.metrics import read_rows
from joybridge.contract.places import PYGAME, program_place
from joybridge.viewer.arena import Settings
from joybridge.viewer.page_session import PageGame, welcome
from joybridge.viewer.simulator import Simulator
from joybridge.viewer.web import open_website
from tests.support.command_line import joybridge
from tests.support.servers import ROOT
from tests.support.viewer_pages import Page
from tests.support.wire import SECONDS

PROGRAM: dict[str, Any] = {"pygame": "pygame.examples.chimp", "reward": "sound:punch", "max_decisions": 40}
OPTIONS = {"screen": "48", "colors": "gray", "decision_interval": "8"}
EPISODES = 2
CLONE = {
    "game": PROGRAM,
    "options": OPTIONS,
    "layout": "bucket-7",
    "arenas": 2,
    "pipeline_groups": 1,
    "total_timesteps": 320,
    "log_interval": 80,
    "policy": {
        "hidden_sizes": [32],
        "rollout_steps": 40,
        "frame_stack": 1,
        "epochs": 4,
        "minibatch_size": 32,
        "learning_rate": 0.003,
    },
}


def aim(picture):
    """Return where the chimp is in a picture, as axes: it is the only thing that is nearly black."""
    if not picture:
        return [0.0, 0.0]
    pixels = np.asarray(Image.open(io.BytesIO(picture)).convert("L"))
    rows, columns = np.nonzero(pixels[pixels.shape[0] // 4 :] < 50)
    height, width = pixels.shape
    return [2 * float(np.median(columns)) / width - 1, 1 - 2 * (float(np.median(rows)) + height // 4) / height]


def play_at_the_page(folder):
    """Play some episodes at the page of chimp, as a person with a good eye does; return the score of each."""
    scores, picture = [], b""
    with (
        Simulator(None, [program_place(PROGRAM)]) as simulator,
        open_website(0, welcome(simulator, PageGame("chimp", SECONDS, demos=folder), Settings(1, OPTIONS, {}))) as url,
    ):
        page = Page(url)
        _, turn = page.begin()
        for decision in range(EPISODES * PROGRAM["max_decisions"]):
            picture = [picture, *turn["pictures"]][-1]
            turn = page.act([aim(picture)], [[decision % 2]])
            scores += [each["score"] for each in turn["ended"]]
        page.close()
    return scores


@pytest.mark.slow
def test_a_person_plays_an_unmodified_program_and_a_policy_clones_it(tmp_path):
    scores = play_at_the_page(tmp_path / "demos")
    assert len(scores) == EPISODES and min(scores) > 0.75 * PROGRAM["max_decisions"] / 2  # a press takes two
    (demo,) = (tmp_path / "demos").glob("chimp-*.demo")
    replayed = joybridge("replay", str(demo), "--pygame", program_place(PROGRAM).removeprefix(PYGAME))
    assert replayed.status == 0, replayed.errors
    config = tmp_path / "chimp.yaml"
    config.write_text(json.dumps(CLONE))  # which is YAML, too
    trained = joybridge("train", str(config), "--run", str(tmp_path / "run"), "--demos", str(tmp_path / "demos"))
    assert trained.status == 0, trained.errors
    losses = [row["cloning_loss"] for row in read_rows(next((tmp_path / "run").glob("metrics-*.csv")))]
    assert losses[-1] < 0.8 * losses[0]
    screen = np.full((480, 1280, 3), 90, np.uint8)
    spec = load_recording(demo).spec
    assert spec is not None
    height, width, _ = spec.behaviors[0].sensors[0].shape
    block = python_of_page("from joybridge.play.agent import load").replace("runs/my_game", str(tmp_path / "run"))
    names: dict[str, Any] = {"screen": screen, "WIDTH": 1280, "HEIGHT": 480}
    exec(block.replace("48, 64, channels=3", f"{height}, {width}, channels=1"), names)
    assert 0 <= names["x"] <= 1279 and 0 <= names["y"] <= 479 and names["press"] in (0, 1)


def test_the_player_of_the_page_plays(capsys):
    exec(python_of_page("# players.py").replace("range(8)", "range(2)").replace("=128", "=16"), {})
    assert [0 <= float(line) <= 8 for line in capsys.readouterr().out.split()] == [True, True]


def python_of_page(piece):
    """Return the block of Python of the page about programs that has a piece of text in it."""
    blocks = (ROOT / "docs/pygame-programs.md").read_text().split("```python\n")[1:]
    return next(block.partition("```")[0] for block in blocks if piece in block.partition("```")[0])
