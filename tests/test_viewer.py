"""`joybridge play`: the messages of a page, the local web server, and the page itself in a browser."""

import http.client
import json
import re
import socket
import subprocess
import sys
import threading
import time
from contextlib import closing, contextmanager
from functools import partial
from itertools import islice
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from joybridge.cli import main
from joybridge.client.client import Session
from joybridge.config.config import Config
from joybridge.config.policy_config import PolicyConfig
from joybridge.contract.codec import ActArrays
from joybridge.play.playing import PlaySpec, open_play
from joybridge.run.matches import read_matches
from joybridge.run.train import train
from joybridge.viewer import web
from joybridge.viewer.arena import Settings
from joybridge.viewer.page_session import PageGame, welcome
from joybridge.viewer.run_opponent import load_others, open_rival, rate_people, run_settings
from joybridge.viewer.simulator import Simulator
from joybridge.viewer.web import open_website
from tests.support.games import PICTURE
from tests.support.wire import SECONDS
from tools.chaos.process import wait_until

SETTINGS = Settings(seed=3, options={}, parameters={})


class Page:
    """What a page does, without a browser."""

    def __init__(self, url, **headers):
        place = urlsplit(url)
        self._socket = connect(
            f"ws://{place.netloc}{place.path}socket",
            origin=headers.pop("origin", f"http://{place.netloc}"),
            additional_headers=headers,
            compression=None,
        ).__enter__()
        self.id = 0

    def send(self, kind, **values):
        self._socket.send(json.dumps({"type": kind, **values}))

    def send_anything(self, data):
        self._socket.send(data)

    def take(self, *kinds):
        """Return the next message of one of these types; a turn has its picture."""
        return self.take_within(SECONDS, *kinds)

    def take_within(self, seconds, *kinds):
        """Return the next message of one of these types, each of which comes within so many seconds."""
        while True:
            message = json.loads(self._socket.recv(seconds))
            for drawn in (message, message.get("rival")) if message["type"] == "turn" else ():
                if drawn:
                    drawn["pictures"] = [self._socket.recv(SECONDS) for _ in range(drawn["pictures"])]
            if message["type"] in kinds:
                return message

    def begin(self):
        """Return the game and the first turn."""
        self.game = self.take("game")
        self.turn = self.take("turn")
        return self.game, self.turn

    def act(self, axes, choices, *, decide=True, seat=None):
        """Decide and return the turn that follows."""
        self.id += 1
        turn = self.turn["turn"]
        self.send("act", turn=turn, id=self.id, seat=seat, axes=axes, choices=choices, decide=decide)
        self.turn = self.take("turn")
        assert (self.turn["turn"], self.turn["played"]) == (turn + 1, self.id)
        return self.turn

    def close(self):
        self._socket.close()


@contextmanager
def website(source, game, settings=SETTINGS, **more):
    with open_website(0, welcome(source, PageGame(game, SECONDS, **more), settings)) as url:
        yield url


@pytest.fixture(scope="module")
def hybrid(simulator):
    """Yield the URL of a page that plays the game `hybrid`."""
    with website(Simulator(simulator, ()), "hybrid") as url:
        yield url


@pytest.fixture
def page(hybrid):
    page = Page(hybrid)
    yield page
    page.close()


def response(url, path="", method="GET", **headers):
    """Return the status, the headers and the body of a request."""
    place = urlsplit(url)
    with closing(http.client.HTTPConnection(place.hostname, place.port, timeout=SECONDS)) as connection:
        connection.request(method, place.path + path, headers=headers)
        with connection.getresponse() as answer:
            return answer.status, answer.headers, answer.read()


# ---------------------------------------------------------------------------------------------------- who gets what


def test_the_page_and_its_files_are_served_to_those_who_know_the_url(hybrid):
    status, headers, body = response(hybrid)
    assert status == 200 and headers["Content-Type"].startswith("text/html") and b"<!doctype html>" in body
    assert "default-src 'none'" in headers["Content-Security-Policy"] and headers["Cache-Control"] == "no-store"
    names = re.findall(r'(?:src|href)="([^"]+)"', body.decode())
    assert {"play.js", "style.css"} <= set(names)
    scripts = [response(hybrid, name) for name in names]
    assert all(status == 200 and headers["X-Content-Type-Options"] == "nosniff" for status, headers, _ in scripts)
    imported = {name for _, _, text in scripts for name in re.findall(r'from "./([\w.]+)"', text.decode())}
    assert len(imported) >= 4
    assert [response(hybrid, name)[0] for name in imported] == [200] * len(imported)


@pytest.mark.parametrize(
    ("path", "headers"),
    [
        ("../", {}),
        ("../wrong-token/", {}),
        ("nothing.js", {}),
        ("../../../etc/passwd", {}),
        ("%2e%2e/web.py", {}),
        ("?", {"Host": "evil.example"}),  # a name that was pointed to this machine
        ("", {"Host": "evil.example"}),
        ("", {"Origin": "http://evil.example"}),
        ("play.js", {"Origin": "null"}),
    ],
)
def test_others_get_nothing(hybrid, path, headers):
    status, given_headers, body = response(hybrid, path, **headers)
    assert (status, body) == (404, b"") and "Access-Control-Allow-Origin" not in given_headers


@pytest.mark.parametrize("path", [b"/\xc3\xa9", b"/\xff\xfe", b"/%ff"])
def test_a_path_beyond_ascii_which_no_browser_sends_gets_nothing_and_disturbs_nobody(hybrid, path):
    place = urlsplit(hybrid)
    with socket.create_connection((place.hostname, place.port), SECONDS) as connection:
        connection.sendall(b"GET " + path + b" HTTP/1.1\r\nHost: " + place.netloc.encode() + b"\r\n\r\n")
        answer = connection.recv(100)
    assert not answer or answer.startswith(b"HTTP/1.1 404 ")
    assert response(hybrid)[0] == 200


@pytest.mark.promise("X2")
def test_the_browser_gets_the_token_in_a_file_of_this_user_alone(monkeypatch):
    opened: list[str] = []
    at_exit: list[partial[None]] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    monkeypatch.setattr("atexit.register", lambda function, **options: at_exit.append(partial(function, **options)))
    web.open_browser("http://127.0.0.1:1/secret-token/")
    (place,) = opened
    file = Path(urlsplit(place).path)
    assert "secret-token" not in place and "url=http://127.0.0.1:1/secret-token/" in file.read_text()
    assert file.stat().st_mode & 0o077 == 0
    at_exit[0]()
    assert not file.exists()


@pytest.mark.parametrize("method", ["POST", "PUT", "OPTIONS", "HEAD"])
def test_only_get_is_a_method(hybrid, method):
    status, _, body = response(hybrid, method=method)
    assert (status, body) == (404, b"")


@pytest.mark.parametrize("origin", [None, "null", "http://evil.example", "http://127.0.0.1:1", "https://127.0.0.1"])
def test_a_page_of_another_origin_gets_no_socket(hybrid, origin):
    with pytest.raises(InvalidStatus, match="404"):
        Page(hybrid, origin=origin)


def test_a_socket_needs_the_token_and_the_host(hybrid):
    with pytest.raises(InvalidStatus, match="404"):
        Page(re.sub(r"/[^/]+/$", "/guess/", hybrid))
    with pytest.raises((InvalidStatus, ConnectionClosed, EOFError)):
        Page(hybrid, Host="evil.example")


# --------------------------------------------------------------------------------------------------------- playing


def test_a_page_learns_the_game_and_plays_it(page):
    game, turn = page.begin()
    assert (game["name"], game["seed"], game["interval"], game["picture"]) == ("hybrid", "3", 0.1, list(PICTURE))
    (player,) = game["behaviors"]
    assert [one["name"] for one in player["axes"] + player["branches"]] == ["x", "force", "gear", "press"]
    assert (turn["turn"], turn["played"], turn["pictures"]) == (0, None, [])
    assert turn["behaviors"][0]["forbidden"] == [[[2], []]]  # one gear at a time
    turn = page.act([[0.25, 1.0]], [[1, 1]])
    assert turn["behaviors"][0]["axes"] == [[0.25, 1.0]] and turn["behaviors"][0]["choices"] == [[1, 1]]
    assert turn["behaviors"][0]["forbidden"] == [[[], []]]
    assert turn["pictures"][0][:2] == b"\xff\xd8"  # a JPEG


def test_what_a_page_plays_is_what_a_client_plays(page, simulator):
    page.begin()
    with Session(simulator, "hybrid", arenas=1, seed=3) as session:
        score, ends = 0.0, 0
        for number in range(30):
            axes, choices = [0.3 * (-1) ** number, 0.5 + 0.1 * (number % 9)], [0, number % 2]
            turn = page.act([axes], [choices])
            (step,) = session.step([ActArrays(np.array([axes], np.float32), np.array([choices], np.int32))])
            score += float(step.rewards[0] @ [1.0, 0.5])
            assert turn["behaviors"][0]["channels"] == step.rewards.tolist()
            for row, lane in enumerate(step.ended):
                (end,) = turn["ended"]
                assert end["score"] == pytest.approx(score) and end["terminated"] == bool(step.terminated[lane])
                assert step.metrics is not None and list(end["metrics"].values()) == step.metrics[row].tolist()
                assert end["length"] == end["metrics"]["length"]
                score, ends = 0.0, ends + 1
            assert turn["behaviors"][0]["scores"] == [pytest.approx(score)]
    assert ends >= 3


def test_a_forbidden_choice_is_replaced_and_an_axis_is_kept_in_its_range(page):
    page.begin()
    (played,) = page.act([[-9.0, 9.0]], [[2, 0]])["behaviors"]
    assert played["choices"][0][0] in (0, 1) and played["axes"] == [[-1.0, 2.0]]


def test_the_game_runs_at_its_own_speed_and_waits_for_the_page(page):
    page.begin()
    page.send("clock", running=True)
    page.act([[0.0, 1.0]], [[0, 0]], decide=False)
    begin = time.monotonic()
    for _ in range(5):
        page.act([[0.0, 1.0]], [[0, 0]], decide=False)
    assert time.monotonic() - begin > 0.4  # five decisions of a tenth of a second
    page.send("clock", running=False)
    page.send("act", turn=page.turn["turn"], id=100, seat=None, axes=[[0.0, 1.0]], choices=[[0, 0]], decide=False)
    page.send_anything("?")  # answered before any decision: the clock stands still
    assert page.take("turn", "refused")["type"] == "refused"


def test_an_act_for_an_earlier_turn_is_not_played(page):
    page.begin()
    page.act([[0.0, 1.0]], [[0, 0]])
    page.send("act", turn=0, id=50, seat=None, axes=[[1.0, 1.0]], choices=[[0, 1]], decide=True)
    assert page.act([[0.5, 1.0]], [[0, 0]])["behaviors"][0]["axes"] == [[0.5, 1.0]]


def test_a_page_learns_that_it_is_recorded_and_discards_an_episode(simulator, tmp_path):
    with website(Simulator(simulator, ()), "hybrid", demos=tmp_path) as url:
        page = Page(url)
        page.begin()
        assert page.take("recorded") == {"type": "recorded", "folder": str(tmp_path), "discarded": False}
        page.act([[0.0, 1.0]], [[0, 0]])
        page.send("discard")
        assert page.take("recorded")["discarded"]
        while not page.act([[0.0, 1.0]], [[0, 0]])["ended"]:
            pass
        page.act([[0.0, 1.0]], [[0, 0]])
        assert not page.take("recorded")["discarded"]
        page.close()


def test_a_page_plays_again_under_other_settings(page):
    page.begin()
    page.send("start", seed=str(2**64 - 1), options={"masks": "off"}, parameters={"drift": 0.0})
    game, turn = page.begin()
    assert game["seed"] == str(2**64 - 1)
    assert [option["value"] for option in game["options"]] == ["small", "off"]
    assert (turn["turn"], turn["behaviors"][0]["forbidden"]) == (0, [[]])


def test_settings_that_cannot_be_played_are_refused_and_others_are_played_after_that(page):
    page.begin()
    page.send("start", seed="1", options={"size": "huge"}, parameters={})
    assert "'huge'" in page.take("refused")["text"]
    page.send("start", seed="1", options={}, parameters={"drift": 99})
    assert "drift" in page.take("refused")["text"]
    page.send("start", seed="1", options={}, parameters={})
    assert page.begin()[0]["seed"] == "1"


def test_a_page_that_goes_away_leaves_no_thread(hybrid):
    before = threading.active_count()
    for _ in range(20):
        Page(hybrid).close()
    page = Page(hybrid)
    page.begin()
    page.close()
    assert wait_until(lambda: threading.active_count() <= before)


def test_two_pages_play_games_of_their_own(page, hybrid):
    other = Page(hybrid)
    page.begin()
    other.begin()
    first = [page.act([[1.0, 2.0]], [[0, 0]])["behaviors"] for _ in range(3)]
    other.close()  # in mid-episode
    again = Page(hybrid)
    again.begin()
    assert [again.act([[1.0, 2.0]], [[0, 0]])["behaviors"] for _ in range(3)] == first
    page.act([[1.0, 2.0]], [[0, 0]])
    again.close()


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


def test_playing_needs_what_the_extra_viewer_installs_alone():
    script = """
import sys
import joybridge.viewer.page_session, joybridge.viewer.play, joybridge.viewer.simulator, joybridge.viewer.web
assert not {"torch", "pydantic", "ruamel", "numba", "pygame"} & set(sys.modules)
"""
    subprocess.run([sys.executable, "-c", script], check=True, timeout=SECONDS)


@pytest.mark.usefixtures("signals")
def test_who_wants_to_be_rated_names_others(capsys):
    with pytest.raises(SystemExit):
        main(["play", "noughts", "--rate", "Ada"])
    assert "--rate needs others to play against" in capsys.readouterr().err


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


def test_a_game_without_a_picture_is_played(simulator):
    with website(Simulator(simulator, ()), "duel") as url:
        page = Page(url)
        game, turn = page.begin()
        assert (game["picture"], game["interval"]) == (None, 0)
        assert [one["deciding"] for one in turn["behaviors"]] == [[True, False], [False]]
        turn = page.act([[0.1], []], [[], [0]])
        assert [one["deciding"] for one in turn["behaviors"]] == [[False, True], [False]]
        page.close()


def test_a_simulator_that_is_lost_is_started_again():
    games = ("tests.support.games:Hybrid",)
    with Simulator(None, games) as source, website(source, "hybrid") as url:
        page = Page(url)
        page.begin()
        page.act([[0.0, 1.0]], [[0, 0]])
        source._started.close()
        page.send("act", turn=1, id=9, seat=None, axes=[[0.0, 1.0]], choices=[[0, 0]], decide=True)
        assert "the simulator at" in page.take("lost")["text"]
        page.begin()
        page.act([[0.0, 1.0]], [[0, 0]])
        page.close()


# ------------------------------------------------------------------------------------------------------- messages

ACT = {"type": "act", "turn": 0, "id": 1, "seat": None, "axes": [[0.0, 1.0]], "choices": [[0, 0]], "decide": True}
WRONG_ACTS: list[dict[str, object]] = [
    {"turn": -1}, {"turn": "0"}, {"turn": 1.5}, {"turn": True}, {"id": None}, {"id": 2**60}, {"seat": 1},
    {"seat": -1}, {"seat": "0"}, {"axes": None}, {"axes": []}, {"axes": [[0.0]]}, {"axes": [[0.0, "1"]]},
    {"axes": [[0.0, 10**400]]}, {"axes": [[0.0, True]]}, {"axes": [[float("nan"), 1.0]]},
    {"axes": [[float("inf"), 1.0]]}, {"choices": [[0, 2]]}, {"choices": [[-1, 0]]}, {"choices": [[0.0, 0]]},
    {"choices": [[0, 0, 0]]}, {"choices": {"0": 1}},
]  # fmt: skip
START = {"type": "start", "seed": "1", "options": {}, "parameters": {}}
WRONG_STARTS: list[dict[str, object]] = [
    {"seed": 1},
    {"seed": "-1"},
    {"seed": ""},
    {"seed": str(2**64)},
    {"seed": "9" * 10_000},
    {"seed": "²"},
    {"seed": "0" * 30 + "9" * 5000},
    {"options": {"\ud800": "small"}},
    {"options": {"size": "\udfff"}},
    {"parameters": {"\ud800": 1.0}},
    {"options": []},
    {"options": {"size": 1}},
    {"parameters": {"drift": "1"}},
    {"parameters": {"drift": None}},
]
WRONG = [
    "", "{", "null", "[]", "7", '"act"', "NaN", '{"type": 1}', '{"type": "start"}', '{"type": "clock", "running": 1}',
    "[" * 100_000, '{"a":' * 20_000, "1" * 5000, b"\xff\xfe", b"\0" * 100,
    *(json.dumps(ACT | change) for change in WRONG_ACTS), *(json.dumps(START | change) for change in WRONG_STARTS),
]  # fmt: skip


def test_a_thousand_malformed_messages_are_survived(page):
    page.begin()
    for number in range(1000):
        page.send_anything(WRONG[number % len(WRONG)])
        assert page.take("turn", "game", "refused", "lost")["type"] == "refused", WRONG[number % len(WRONG)]
    assert page.act([[0.0, 1.0]], [[0, 0]])["turn"] == 1


def test_a_message_that_is_too_long_ends_only_its_page(page, hybrid):
    page.begin()
    page.send_anything("1" * (2 << 20))
    with pytest.raises(ConnectionClosed):
        page.take("refused")
    other = Page(hybrid)
    other.begin()
    other.close()


# ------------------------------------------------------------------------------------------------- command line


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["archer", "--seed", "-1"], "argument --seed: got -1, expected 0..2^64-1"),
        (["archer", "--port", "70000"], "argument --port: got 70000, expected 0..65535"),
        (["archer", "--timeout", "0"], "argument --timeout: got 0, expected a positive number of seconds"),
        (["archer", "--token-file", "token"], "belong to a running simulator; name it with --simulator"),
    ],
)
def test_wrong_arguments_are_named(capsys, arguments, text):
    with pytest.raises(SystemExit):
        main(["play", *arguments])
    assert text in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["chess"], "no game named 'chess'"),
        (["hybrid", "options.size=huge"], "option 'size' got 'huge'"),
        (["hybrid", "parameters.drift=9"], "parameters.drift: got 9, expected 0..2"),
        (["hybrid", "layout=hybrid"], "layout cannot be set here"),
    ],
)
@pytest.mark.usefixtures("signals")
def test_what_cannot_be_played_is_one_sentence(simulator, capsys, arguments, text):
    assert main(["play", *arguments, "--simulator", simulator, "--no-browser"]) == 1
    (error,) = capsys.readouterr().err.splitlines()
    assert text in error
