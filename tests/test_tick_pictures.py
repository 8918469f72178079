"""Pictures of the ticks within a decision: what people see between two decisions of an agent."""

import av
import pytest

from joybridge.client.client import Session
from joybridge.config.config import Config
from joybridge.config.policy_config import PolicyConfig
from joybridge.contract.spec import choose_options
from joybridge.games import BUILT_IN
from joybridge.layouts import make_acts
from joybridge.play.playing import PlaySpec
from joybridge.play.record import record
from joybridge.run.train import train
from joybridge.simulator import session as sessions
from joybridge.simulator.catalog import load_game
from joybridge.v1 import bridge_pb2 as pb
from tests.support.wire import SAVE, Player, act, start
from tests.test_reasons import GAMES, START, gauntlet_act

SMALL = PolicyConfig(frame_stack=1, hidden_sizes=[8], rollout_steps=16, time_horizon=16, minibatch_size=32)
TICKED = ["beastly_rivals", "beastly_rivals_full"]


def ticked(request, arena=0):
    """Return a request that also draws the ticks of an arena."""
    request.act.draw_ticks = arena
    return request


def refusal(*requests):
    """Return why the last request is refused; those before it must be answered."""
    session = sessions.Session(GAMES)
    for request in requests[:-1]:
        session.answer(request)
    with pytest.raises(sessions.Refusal) as caught:
        session.answer(requests[-1])
    return caught.value


@pytest.mark.parametrize("game", TICKED)
def test_whoever_draws_ticks_plays_the_same_game(game, simulator):
    with Player(simulator, game) as plain, Player(simulator, game) as seen:
        for _ in range(5):
            acts = plain.acts()
            expected = plain.stream.ask(act(*acts, draw=[1])).step
            step = seen.stream.ask(ticked(act(*acts, draw=[1]), 1)).step
            assert (list(step.behaviors), list(step.pictures)) == (list(expected.behaviors), list(expected.pictures))
            pictures = [tensor.data for tensor in (*step.tick_pictures, *step.pictures)]
            assert len(pictures) == seen.spec.decision_interval == len(set(pictures))
            plain.step = expected
        assert plain.stream.ask(SAVE) == seen.stream.ask(SAVE)


def test_a_client_sees_every_tick_where_the_game_draws_them(simulator):
    for game, pictures in (("beastly_rivals", 6), ("archer", 1)):
        with Session(simulator, game, arenas=1, seed=0) as session:
            _, seen = session.step_and_draw_ticks(make_acts(session.spec, 1))
            size = (session.spec.picture.height, session.spec.picture.width, 3)
            assert [picture.shape for picture in seen] == [size] * pictures


@pytest.mark.parametrize("game", ["beastly_rivals", "shooting_birds"])  # ticks of 20 ms: six and one per decision
def test_a_video_shows_the_ticks_of_decisions_that_are_slow(game, simulator, signals, tmp_path):
    config = Config(game=game, arenas=4, total_timesteps=64, log_interval=64, policy=SMALL)
    train(config, tmp_path / "run", [simulator], resume=False)
    said: list[str] = []
    frames = record(PlaySpec(tmp_path / "run", simulator, seed=0), tmp_path / "a.mp4", seconds=1.0, say=said.append)
    unended = "no episode has ended within 1 s; --episodes 1 records a whole one"
    assert (unended in said) == (game == "shooting_birds")  # whose episodes last longer
    with av.open(str(tmp_path / "a.mp4")) as video:
        pictures = [picture.to_ndarray(format="rgb24").tobytes() for picture in video.decode(video=0)]
        assert video.streams.video[0].average_rate == 25 == frames == len(pictures)
    assert len(set(pictures)) > 20


def test_a_video_lasts_as_long_as_its_episodes(simulator, signals, tmp_path):
    config = Config(game="beastly_rivals", arenas=4, total_timesteps=64, log_interval=64, policy=SMALL)
    train(config, tmp_path / "run", [simulator], resume=False)
    plays, output = PlaySpec(tmp_path / "run", simulator, seed=1), tmp_path / "a.mp4"
    one, two = (record(plays, output, episodes=episodes, say=print) for episodes in (1, 2))
    assert 3 < one < two
    for frames, ended in ((one - 3, False), (one, True)):  # three frames show a decision
        said: list[str] = []
        assert record(plays, output, seconds=frames / 25, say=said.append) == frames
        assert ended != any("no episode has ended" in line for line in said)


def test_ticks_that_cannot_be_drawn_are_refused():
    for draw, arena, why in (([], 2, "act.draw_ticks asks for 1 pictures up to arena 2"), ([0] * 64, 1, "65 pictures")):
        found = refusal(START, ticked(gauntlet_act(draw=draw), arena))
        assert found.reason == pb.REASON_WRONG_DRAW and why in str(found)
    found = refusal(start("plain"), ticked(gauntlet_act()))
    assert (found.reason, found.field) == (pb.REASON_NO_PICTURES, "act.draw_ticks")


def test_the_built_in_games_draw_ticks_wherever_a_decision_has_several():
    several = {
        name
        for name, place in BUILT_IN.items()
        if load_game(place).describe(choose_options(load_game(place).options, {}, name)).decision_interval > 1
    }
    assert several == set(TICKED)
