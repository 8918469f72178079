"""Who holds the seats of a match that people play in the browser: policies, other people, chance."""

from functools import partial
from itertools import islice

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed

from joybridge.cli import main
from joybridge.client.client import Session, describe
from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.config.policy_config import PolicyConfig
from joybridge.play.playing import PlaySpec, open_play
from joybridge.run.matches import read_matches
from joybridge.run.train import train
from joybridge.viewer import page_session
from joybridge.viewer.arena import Settings
from joybridge.viewer.run_opponent import load_others, open_rival, rate_people, run_settings
from joybridge.viewer.simulator import Simulator
from tests.support.viewer_pages import SETTINGS, Page, website


def test_whoever_holds_one_seat_leaves_the_others_to_chance(simulator):
    with website(Simulator(simulator, ()), "ferry") as url:
        page = Page(url)
        game, _ = page.begin()
        assert game["seats"] == [{"behavior": b, "agent": a} for b, a in ((0, 0), (1, 0), (1, 1))]
        turns = [page.act([[0.5], []], [[], [1]], seat=1)["behaviors"] for _ in range(12)]
        everything = page.act([[0.5], []], [[], [1]])["behaviors"]
        page.close()
    assert {turn[1]["choices"][0][0] for turn in turns} == {1}
    assert {turn[1]["choices"][1][0] for turn in turns} == {0, 1}
    assert len({turn[0]["axes"][0][0] for turn in turns}) == 12
    assert everything[0]["axes"] == [[0.5]] and everything[1]["choices"] == [[1], [1]]


def begun(simulator, folder, game, options):
    """Return a run that has hardly begun."""
    policy = PolicyConfig(hidden_sizes=[8], rollout_steps=16, time_horizon=16, minibatch_size=32)
    config = Config(game=game, arenas=4, total_timesteps=64, log_interval=64, policy=policy, options=options)
    train(config, folder, [simulator], resume=False)
    return folder


@pytest.fixture(scope="module")
def run(simulator, tmp_path_factory):
    """Return a run of the game `hybrid` that has hardly begun."""
    return begun(simulator, tmp_path_factory.mktemp("viewer") / "run", "hybrid", {"masks": "off"})


def test_policies_hold_the_seats_that_the_person_does_not(simulator, tmp_path):
    run = begun(simulator, tmp_path / "run", "ferry", {})
    pressed = ([[0.5], []], [[], [1]])
    with (
        website(Simulator(simulator, ()), "ferry", others=partial(load_others, [str(run)], "ferry")) as url,
        Session(simulator, "ferry", arenas=1, seed=3) as session,
    ):
        page, policies = Page(url), load_others([str(run)], "ferry", session.spec, SETTINGS)
        assert page.begin()[0]["seat"] == 0
        policies.begin(session.steps)
        for number in range(30):
            seat = number // 10  # the person takes another one
            turn = page.act(*pressed, seat=seat)["behaviors"]
            acts = policies.act(session.steps)
            if seat == 0:
                acts[0].axes[0] = 0.5
            else:
                acts[1].choices[seat - 1] = 1
            policies.store(session.step(acts))
            assert [one["axes"] for one in turn] == [act.axes.tolist() for act in acts]
            assert [one["choices"] for one in turn] == [act.choices.tolist() for act in acts]
            assert [one["channels"] for one in turn] == [step.rewards.tolist() for step in session.steps]
        page.close()


def test_matches_of_a_person_with_one_seat_go_to_the_log_that_rate_reads(simulator, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    others = partial(load_others, ["script:perfect"], "noughts")
    rated = partial(rate_people, ["script:perfect"], ["Ada"])
    with website(Simulator(simulator, ()), "noughts", others=others, rated=rated) as url:
        page, ends = Page(url), 0
        page.begin()
        for _ in range(30):
            ends += bool(page.act([[]], [[0]], seat=1)["ended"])
        for number in range(30):  # in each match it takes another seat
            page.act([[]], [[0]], seat=number % 2)
        page.close()
    matches = read_matches(tmp_path / "rating")
    assert ends > 2 and len(matches) in (ends, ends + 1)  # one may end with its first decision
    assert all(match.players == ("script:perfect", "Ada") and match.places[0] <= match.places[1] for match in matches)


def test_people_are_rated_under_the_settings_of_the_training_only(simulator, run):
    game = describe(simulator, "hybrid", {})
    rate_people([str(run)], ["Ada"], game, Settings(1, {"masks": "off"}, {}))
    with pytest.raises(ConfigError, match=r"put back options.masks, or leave --rate out"):
        rate_people([str(run)], ["Ada"], game, Settings(1, {"masks": "on"}, {}))


def together(url):
    """Return two pages that have begun a match together."""
    one = Page(url)
    assert one.take("waiting")["text"].startswith("1 of 2 players are here")
    other = Page(url)
    for seat, page in enumerate((one, other)):
        game, _ = page.begin()
        assert (game["seat"], game["fixed"]) == (seat, True)
    return one, other


def test_two_people_play_one_match_and_it_waits_for_both(simulator):
    pressed = ([[0.5], []], [[], [1]])
    with website(Simulator(simulator, ()), "ferry", people=2) as url:
        one, other = together(url)
        assert one.take("people")["text"] == "you are player 1; waits for you, player 2"
        other.send("clock", running=True)
        assert one.take("people")["text"] == "you are player 1; waits for you"
        one.send("act", turn=0, id=7, seat=2, axes=[[0.25], []], choices=[[], [0]], decide=True)  # its seat is 0
        with pytest.raises(TimeoutError):
            one.take_within(0.2, "turn")
        other.send("act", turn=0, id=9, seat=None, axes=pressed[0], choices=pressed[1], decide=True)
        turns = [page.take("turn") for page in (one, other)]
        assert [turn.pop("played") for turn in turns] == [7, 9] and turns[0] == turns[1]
        assert turns[0]["behaviors"][0]["axes"] == [[0.25]] and turns[0]["behaviors"][1]["choices"][0] == [1]
        one.send("start", seed="5", options={}, parameters={})
        assert [page.begin()[0]["seed"] for page in (one, other)] == ["5", "5"]
        one.close()
        other.close()


def test_a_page_that_waits_for_others_learns_it_once(simulator):
    with website(Simulator(simulator, ()), "ferry", people=2) as url:
        one = Page(url)
        one.take("waiting")
        for _ in range(3):
            one.send("clock", running=False)
        with pytest.raises(TimeoutError):
            one.take_within(0.3, "waiting")
        other = Page(url)
        assert [page.begin()[0]["fixed"] for page in (one, other)] == [True, True]
        one.close()
        other.close()


def test_a_page_that_finds_no_place_is_sent_away_and_takes_one_that_is_free(simulator):
    with website(Simulator(simulator, ()), "noughts", people=2) as url:
        one, other = together(url)
        with pytest.raises(ConnectionClosed, match="All 2 places are taken"):
            Page(url).take("game")
        one.close()
        assert other.take("waiting")["text"].startswith("1 of 2 players are here")
        third = Page(url)
        assert [page.begin()[0]["seat"] for page in (third, other)] == [0, 1]
        third.close()
        other.close()


def test_a_defect_closes_the_pages_and_the_room_takes_others(simulator, monkeypatch, caplog):
    play = page_session._play_session
    failed: list[bool] = []

    def fail_once(*arguments):
        if not failed:
            failed.append(True)
            raise RuntimeError("a defect")
        return play(*arguments)

    monkeypatch.setattr(page_session, "_play_session", fail_once)
    with website(Simulator(simulator, ()), "noughts", people=2) as url:
        for page in (Page(url), Page(url)):
            with pytest.raises(ConnectionClosed):
                page.take("game")
        for page in together(url):
            page.close()
    assert "RuntimeError: a defect" in caplog.text


def test_a_match_of_two_people_who_agree_is_rated(simulator, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rated = partial(rate_people, [], ["Ada", "Bob"])
    with website(Simulator(simulator, ()), "noughts", people=2, rated=rated) as url:
        pages = together(url)
        ended: list[dict[str, float]] = []
        while not ended:
            for page in pages:
                page.send("act", turn=page.turn["turn"], id=0, seat=None, axes=[[]], choices=[[0]], decide=True)
            for page in pages:
                page.turn = page.take("turn")
            ended = pages[0].turn["ended"]
        for page in pages:
            page.close()
    (match,) = read_matches(tmp_path / "rating")
    scores = sorted(ended, key=lambda end: end["seat"])
    ahead = np.sign(scores[0]["score"] - scores[1]["score"])
    assert match.players == ("Ada", "Bob") and np.sign(match.places[1] - match.places[0]) == ahead


@pytest.mark.usefixtures("signals")
@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["noughts", "--players", "3"], "--players: got 3, expected at most 2, the seats of noughts"),
        (["noughts", "--players", "2", "--others", "script:perfect"], "has 2 seats, and people hold them"),
        (["ferry", "--players", "2", "--rate", "A", "--rate", "B"], "has 3 seats, and chance would hold some"),
    ],
)
def test_people_and_others_need_seats(simulator, capsys, arguments, text):
    assert main(["play", *arguments, "--simulator", simulator, "--no-browser"]) == 1
    assert text in capsys.readouterr().err


@pytest.mark.usefixtures("signals")
@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--rate", "Ada"], "--rate needs others to play against"),
        (["--players", "2", "--rate", "Bob", "--rate", "Bob"], "got Bob and Bob, expected a name of its own"),
    ],
)
def test_who_is_rated_has_a_name_of_their_own_and_somebody_to_play_against(capsys, arguments, text):
    with pytest.raises(SystemExit):
        main(["play", "noughts", *arguments])
    assert text in capsys.readouterr().err


def test_a_policy_plays_beside_the_person_on_the_same_seed(simulator, run):
    settings = run_settings("--against", run, "hybrid", SETTINGS)
    assert settings == Settings(3, {"masks": "off"}, {})
    with (
        website(Simulator(simulator, ()), "hybrid", settings, against=partial(open_rival, run)) as url,
        open_play(PlaySpec(run, simulator, seed=3)) as alone,
    ):
        page, score, ends = Page(url), 0.0, 0
        page.begin()
        for played in islice(alone.decisions(draw_every=1), 20):
            rival = page.act([[0.0, 1.0]], [[0, 0]])["rival"]
            (step,) = played.after
            score += float(step.rewards[0] @ [1.0, 0.5])
            if len(step.ended):
                (end,) = rival["ended"]
                assert end["score"] == pytest.approx(score)
                score, ends = 0.0, ends + 1
            assert rival["scores"] == [[pytest.approx(score)]]
            assert rival["pictures"][0][:2] == b"\xff\xd8"
        page.close()
    assert ends >= 2 and rival["title"] == "policy after 64 timesteps"


@pytest.mark.usefixtures("signals")
def test_a_run_of_another_game_is_no_rival(simulator, run, capsys):
    assert main(["play", "archer", "--against", str(run), "--simulator", simulator, "--no-browser"]) == 1
    assert "plays hybrid, expected archer; name a run of this game" in capsys.readouterr().err


@pytest.mark.usefixtures("signals")
def test_a_game_of_one_seat_has_no_others(simulator, run, capsys):
    assert main(["play", "hybrid", "--others", str(run), "--simulator", simulator, "--no-browser"]) == 1
    assert "--others: hybrid has one seat, and you hold it; leave --others out" in capsys.readouterr().err
