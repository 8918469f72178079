"""What a policy sees is drawn beside the picture of its game: in videos, and on the page that watches a run."""

from io import BytesIO
from types import SimpleNamespace
from typing import Any

import av
import numpy as np
import pytest
from PIL import Image

from joybridge.cli import main
from joybridge.client.client import describe
from joybridge.config.config import Config
from joybridge.config.policy_config import MemoryConfig, PolicyConfig
from joybridge.contract.codec import StepArrays
from joybridge.play.memory_strip import ABOVE, BELOW, DARK, GAP, ROW
from joybridge.play.playing import Play
from joybridge.play.policy_view import BACKGROUND, MARGIN, PolicyView
from joybridge.policy.encoder import ObservationEncoder
from joybridge.run.train import train
from joybridge.simulator import axis, behavior, image, sensor, spec
from joybridge.viewer.run_view import watch
from joybridge.viewer.web import open_website
from tests.support.viewer_pages import Page

NOTHING = np.zeros(2, np.float32)
GAME = type("Game", (), {"name": "game", "description": "any", "options": (), "version": ""})
EYES = behavior(
    "eyes",
    sensors=[sensor("place", [2]), image("gray", 2, 3), image("color", 4, 4, channels=3)],
    axes=[axis("x")],
    agents=2,
)


def seen(*arrays):
    return StepArrays([NOTHING, *arrays], NOTHING, NOTHING, NOTHING)


def test_each_image_of_each_agent_of_the_first_arena_is_enlarged_beside_the_picture():
    game = spec(GAME, [EYES], picture=(64, 40))
    encoder = ObservationEncoder("eyes", EYES, None, {}, "auto")
    view = PolicyView(game, [(0, encoder), (0, encoder)])  # two policies that see the same
    rng = np.random.default_rng(0)
    gray, color = (rng.integers(100, 256, (6, *shape)).astype(np.uint8) for shape in ((2, 3, 1), (4, 4, 3)))
    picture = rng.integers(0, 256, (40, 64, 3)).astype(np.uint8)
    whole = view.beside(picture, [seen(gray, color)])
    assert whole.shape == (view.height, view.width, 3) == (40, 64 + 2 * (4 + MARGIN), 3)
    np.testing.assert_array_equal(whole[:40, :64], picture)
    first, second = 64 + MARGIN, 64 + MARGIN + 4 + MARGIN  # three images in the first column, one in the second
    np.testing.assert_array_equal(whole[:2, first : first + 3], np.repeat(gray[0], 3, axis=2))
    np.testing.assert_array_equal(whole[12:14, first : first + 3], np.repeat(gray[1], 3, axis=2))
    np.testing.assert_array_equal(whole[24:28, first : first + 4], color[0])
    np.testing.assert_array_equal(whole[:4, second : second + 4], color[1])
    assert (whole[4:, second:] == BACKGROUND).all()


def test_pixels_are_squares_and_a_small_picture_is_extended():
    large = spec(GAME, [behavior("eye", sensors=[image("view", 10, 16)], axes=[axis("x")])], picture=(320, 200))
    view = PolicyView(large, [(0, ObservationEncoder("eye", large.behaviors[0], None, {}, "auto"))])
    assert (view.width, view.height) == (320 + 10 * 16 + MARGIN, 200)
    pixels = np.arange(160, dtype=np.uint8).reshape(1, 10, 16, 1)
    step = StepArrays([pixels], NOTHING, NOTHING, NOTHING)
    whole = view.beside(np.zeros((200, 320, 3), np.uint8), [step])
    np.testing.assert_array_equal(whole[:100:10, 328::10, 0], pixels[0, :, :, 0])
    np.testing.assert_array_equal(whole[9:100:10, 337::10, 2], pixels[0, :, :, 0])
    small = spec(GAME, [large.behaviors[0]], picture=(8, 6))
    view = PolicyView(small, [(0, ObservationEncoder("eye", small.behaviors[0], None, {}, "auto"))])
    assert view.beside(np.zeros((6, 8, 3), np.uint8), [step]).shape == (10, 8 + 16 + MARGIN, 3)


def test_a_policy_that_sees_no_image_adds_nothing():
    game = spec(GAME, [EYES], picture=(64, 40))
    view = PolicyView(game, [(0, ObservationEncoder("eyes", EYES, ["place"], {}, "auto"))])
    picture = np.zeros((40, 64, 3), np.uint8)
    assert view.beside(picture, []) is picture and (view.width, view.height) == (64, 40)


def test_what_each_agent_remembers_is_a_row_of_cells_below():
    game = spec(GAME, [EYES], picture=(64, 40))
    view = PolicyView(game, [(0, ObservationEncoder("eyes", EYES, ["place"], {}, "auto"))], [2])
    picture = np.full((40, 64, 3), 9, np.uint8)
    states = np.array([[0.0, 1.0, -1.0, 0.5], [3.0, 0.0, 0.0, -0.5]], np.float32)
    whole = view.beside(picture, [], [states])
    assert whole.shape == (view.height, view.width, 3) == (40 + 2 * (ROW + GAP), 64, 3)
    np.testing.assert_array_equal(whole[:40], picture)
    cells = whole[40 + GAP :: ROW + GAP, 8::16].astype(float)  # the middle of each, [agents, numbers]
    np.testing.assert_array_equal(cells[0, :3], [DARK, ABOVE, BELOW])
    np.testing.assert_allclose(cells[0, 3], (DARK + ABOVE) / 2, atol=1)
    np.testing.assert_array_equal(cells[1, :3], [ABOVE, DARK, DARK])
    np.testing.assert_allclose(cells[1, 3], (DARK + BELOW) / 2, atol=1)
    assert (whole[40 + GAP, 16::16] == DARK // 2).all()  # a line between two cells
    many = PolicyView(game, [], [1]).beside(picture, [], [np.linspace(-1, 1, 640, dtype=np.float32)[None]])
    assert many.shape == (40 + ROW + GAP, 64, 3) and (np.diff(many[-1, :, 0].astype(int))[33:] >= 0).all()


def test_an_agent_whose_seat_another_holds_has_no_row():
    remembers = SimpleNamespace(
        behavior=0, network=SimpleNamespace(actor=SimpleNamespace(memory=SimpleNamespace(state_size=2)))
    )
    player = SimpleNamespace(
        actor=remembers, observations=SimpleNamespace(memory=np.arange(12).reshape(4, 3))
    )  # the critic's state is the last
    session: Any = SimpleNamespace(spec=spec(GAME, [EYES]))
    policies: Any = SimpleNamespace(players=[player], timesteps=0)
    play = Play(Config(game="game"), {}, [], 2, session, policies, [np.array([False, True] * 2)])
    assert [states.tolist() for states in play.remembered()] == [[[3, 4]]]


@pytest.fixture(scope="module")
def run(simulator, tmp_path_factory):
    """Return a run of a policy that sees an image of 2 x 2 pixels beside a picture of 8 x 6, and remembers."""
    policy = PolicyConfig(
        image_encoder="simple",
        hidden_sizes=[8],
        rollout_steps=16,
        time_horizon=16,
        minibatch_size=32,
        memory=MemoryConfig(kind="lstm", size=4),
    )
    folder = tmp_path_factory.mktemp("seeing") / "run"
    config = Config(game="hybrid", arenas=4, total_timesteps=64, log_interval=64, policy=policy)
    train(config, folder, [simulator], resume=False)
    return folder


@pytest.mark.usefixtures("signals")
def test_a_video_shows_what_the_policy_sees(run, simulator, tmp_path):
    video = tmp_path / "play.mp4"
    assert main(["record", str(run), str(video), "--seconds", "1", "--simulator", simulator]) == 0
    with av.open(str(video)) as file:
        frames = [frame.to_ndarray(format="rgb24") for frame in file.decode(video=0)]
    assert describe(simulator, "hybrid", {}).picture.width == 8
    assert frames[0].shape == (6 + ROW + GAP, 8 + MARGIN + 2, 3)
    assert (frames[0][6 + GAP :] != frames[9][6 + GAP :]).any()


def test_the_page_shows_what_the_policy_sees(run, simulator):
    with open_website(0, lambda page: watch(page, run, lambda: simulator, 1), "watch.html") as url:
        page = Page(url)
        with Image.open(BytesIO(page.take("turn")["pictures"][0])) as picture:
            assert picture.size == (8 + MARGIN + 2, 6 + ROW + GAP)
        page.close()
