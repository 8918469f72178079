"""`joybridge watch`: a page sees the curves and the newest policy of a run, and the run does not notice."""

from itertools import pairwise
from typing import Any

import pytest

from joybridge.cli import main
from joybridge.client.errors import SimulatorLost
from joybridge.config.config import Config
from joybridge.config.policy_config import PolicyConfig
from joybridge.run.train import train
from joybridge.viewer import run_view, watched_game, web
from joybridge.viewer.arena import Settings
from joybridge.viewer.clock import Pace
from joybridge.viewer.run_view import watch
from joybridge.viewer.watched_game import watch_game
from joybridge.viewer.web import open_website
from tests.support.viewer_pages import Page

POLICY = PolicyConfig(hidden_sizes=[8], rollout_steps=16, time_horizon=16, minibatch_size=32)
CONFIG = Config(
    game="hybrid", layout="bucket-5", arenas=4, total_timesteps=128, stop_at=64, log_interval=64, policy=POLICY
)


def files(run):
    return {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in run.rglob("*") if path.is_file()}


def go_on(run, simulator, *, resume=True, **more):
    train(CONFIG.model_copy(update=more), run, [simulator], resume=resume)


def first_of(page, *kinds):
    """Return the first message of each of these types, which come in any order."""
    messages: dict[str, Any] = {}
    while len(messages) < len(kinds):
        message = page.take(*kinds)
        messages.setdefault(message["type"], message)
    return [messages[kind] for kind in kinds]


def test_a_page_sees_the_newest_policy_at_play_and_the_folder_stays_as_it_is(simulator, tmp_path, monkeypatch):
    monkeypatch.setattr(run_view, "LOOK_SECONDS", 0.05)
    run = tmp_path / "run"
    with open_website(0, lambda page: watch(page, run, lambda: simulator, 1), "watch.html") as url:
        page = Page(url)
        assert "is not the folder of a run" in page.take("lost")["text"]
        go_on(run, simulator, resume=False)
        before = files(run)
        curves, game, turn = first_of(page, "curves", "game", "turn")
        ((time, reward),) = curves["policies"]["player"]["reward"]
        assert time == 64 and reward < 100
        assert game["name"] == "hybrid" and turn["timesteps"] == 64
        (outputs,) = turn["outputs"]
        (lane,) = outputs["lanes"]
        assert outputs["policy"] == "player" and isinstance(lane["value"], float) and lane["axes"] == []
        x, force, gear, press = (branch["choices"] for branch in lane["branches"])
        assert {choice["label"] for choice in x} == {"-1", "-0.5", "0", "0.5", "1"} and len(force) == 5
        assert {choice["label"] for choice in gear + press} >= {"press", "none"}
        for choices in (x, force, gear, press):
            assert sum(choice["chance"] for choice in choices) == pytest.approx(1, abs=1e-5)
        assert page.take("turn")["turn"] > turn["turn"] and turn["pictures"][0][:2] == b"\xff\xd8"
        assert files(run) == before
        go_on(run, simulator, stop_at=None)
        assert len(page.take("curves")["policies"]["player"]["reward"]) == 2
        while page.take("turn")["timesteps"] != 128:
            pass
        page.close()


def test_a_damaged_file_of_metrics_is_named_on_the_page(simulator, tmp_path):
    (tmp_path / "metrics-x.csv").write_text("timesteps,reward\n100,abc\n")
    with open_website(0, lambda page: watch(page, tmp_path, lambda: simulator, 1), "watch.html") as url:
        page = Page(url)
        assert "is no file of metrics" in page.take("lost")["text"]
        page.close()


@pytest.mark.usefixtures("signals")
def test_what_is_no_run_is_named(tmp_path, capsys):
    assert main(["watch", str(tmp_path / "nothing"), "--no-browser"]) == 1
    assert f"{tmp_path / 'nothing'} is not the folder of a run" in capsys.readouterr().err


def test_a_page_that_was_hidden_before_there_was_a_game_is_not_played_for(simulator, monkeypatch):
    monkeypatch.setattr(watched_game, "LOOK_SECONDS", 0.01)
    monkeypatch.setattr(watched_game, "interval", lambda spec: 0.001)
    told: list[Pace] = []

    class Told(Pace):
        def __init__(self, page):
            super().__init__(page)
            told.append(self)

    def reach():
        if told[0].running:
            raise SimulatorLost("nobody is there")
        return simulator

    monkeypatch.setattr(watched_game, "Pace", Told)
    settings = Settings(3, {}, {})
    with open_website(0, lambda page: watch_game(page, reach, "archer", settings, 30.0), "watch.html") as url:
        page = Page(url)
        page.take("lost")
        page.send("clock", running=False)
        page.take("game")
        with pytest.raises(TimeoutError):
            page.take_within(0.3, "turn")
        page.send("clock", running=True)
        assert page.take("turn")["turn"] == 1
        page.close()


def test_a_page_sees_random_allowed_play_of_a_game_without_a_run(simulator, monkeypatch):
    monkeypatch.setattr(watched_game, "LOOK_SECONDS", 0.01)
    monkeypatch.setattr(watched_game, "interval", lambda spec: 0.001)
    lost = [True]

    def reach():
        if lost:
            raise SimulatorLost(f"nobody is there: {lost.pop()}")
        return simulator

    settings = Settings(3, {}, {})
    with open_website(0, lambda page: watch_game(page, reach, "archer", settings, 30.0), "watch.html") as url:
        page = Page(url)
        assert page.take("lost")["text"] == "nobody is there: True"
        game, turn = page.begin()
        assert game["name"] == "archer" and game["seed"] == "3" and "outputs" not in turn
        turns, ended = [turn], list[Any]()
        while not ended:
            turns.append(page.take("turn"))
            ended = turns[-1]["ended"]
        assert [one["turn"] for one in turns] == list(range(1, len(turns) + 1))
        assert all(one["pictures"][0][:2] == b"\xff\xd8" for one in turns)
        for before, after in pairwise(turns):
            (forbidden,), (pressed,) = (before["behaviors"][0]["forbidden"][0], after["behaviors"][0]["choices"][0])
            assert pressed not in forbidden
        assert {one["behaviors"][0]["choices"][0][0] for one in turns} == {0, 1, 2}
        assert len({one["behaviors"][0]["axes"][0][0] for one in turns}) > 5
        assert set(ended[0]["metrics"]) == {"hits", "accuracy"}
        page.send("clock", running=False)
        page.close()


@pytest.mark.usefixtures("signals")
@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--game", "nothing"], "no game named 'nothing'"),
        (["--game", "shooting_birds", "options.level=77"], "option 'level' got '77'"),
        ([], "choose one with --game"),
    ],
)
def test_what_cannot_be_watched_at_an_address_is_named(simulator, capsys, more, message):
    assert main(["watch", simulator, "--no-browser", *more]) == 1
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["127.0.0.1:1", "--simulator", "127.0.0.1:1"], "--simulator belongs to a run"),
        (["runs/birds", "--game", "archer"], "belong to the address of a simulator; a run has its own"),
        (["runs/birds", "options.level=2"], "belong to the address of a simulator; a run has its own"),
        (["runs/birds", "--tls-ca", "ca.pem"], "--tls-ca and --token-file belong to a running simulator"),
    ],
)
def test_options_that_do_not_belong_together_are_named(capsys, more, message):
    with pytest.raises(SystemExit):
        main(["watch", *more])
    assert message in capsys.readouterr().err


@pytest.mark.usefixtures("signals")
def test_the_command_watches_a_game_at_an_address(simulator, monkeypatch, capsys):
    def visit():
        page = Page(capsys.readouterr().out.split()[3])
        assert page.begin()[0]["name"] == "hybrid"
        page.close()
        raise KeyboardInterrupt

    monkeypatch.setattr(web, "wait_for_interrupt", visit)
    assert main(["watch", simulator, "--game", "hybrid", "--port", "0", "--no-browser"]) == 0
