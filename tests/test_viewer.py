"""`joybridge play`: the page is served to its user alone, and plays what a client plays."""

import http.client
import json
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus

from joybridge.cli import main
from joybridge.client.client import Session
from joybridge.contract.codec import ActArrays
from joybridge.viewer import simulator as viewer_simulator
from joybridge.viewer import web
from joybridge.viewer.simulator import Simulator
from tests.support.faulty_game import PICTURE
from tests.support.viewer_pages import Page, website
from tests.support.wire import SECONDS
from tools.chaos.process import wait_until


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
        page.send("discard")  # there is no episode yet
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
    refused = page.take("refused")
    assert "'huge'" in refused["text"] and not refused["playing"]
    page.send("start", seed="1", options={}, parameters={})
    page.begin()
    page.send("start", seed="9" * 20, options={}, parameters={})
    assert page.take("refused")["playing"]  # the game before goes on
    page.act([[0.0, 1.0]], [[0, 0]])
    page.send("start", seed="1", options={}, parameters={"drift": 99})
    assert "drift" in page.take("refused")["text"]
    page.send("start", seed="1", options={}, parameters={})
    assert page.begin()[0]["seed"] == "1"


def test_acts_that_come_when_nothing_is_played_any_more_are_not_answered(page):
    page.begin()
    page.send("start", seed="1", options={"size": "huge"}, parameters={})
    assert not page.take("refused")["playing"]
    page.send("act", turn=0, id=1, seat=None, axes=[[0.0, 1.0]], choices=[[0, 0]], decide=True)
    page.send("start", seed="1", options={}, parameters={})
    assert page.take("game", "refused")["type"] == "game"


def test_a_page_that_goes_away_leaves_no_thread(page, hybrid):
    page.begin()  # gRPC has a thread of its own while anything is connected; this page stays, so it is there throughout
    before = threading.active_count()
    for _ in range(20):
        Page(hybrid).close()
    other = Page(hybrid)
    other.begin()
    other.close()
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


def test_playing_needs_what_the_extra_viewer_installs_alone():
    script = """
import sys
import joybridge.viewer.page_session, joybridge.viewer.play, joybridge.viewer.simulator, joybridge.viewer.web
assert not {"torch", "pydantic", "ruamel", "numba", "pygame"} & set(sys.modules)
"""
    subprocess.run([sys.executable, "-c", script], check=True, timeout=SECONDS)


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


def test_a_simulator_that_is_busy_for_a_while_is_not_started_again(monkeypatch):
    started: list[Any] = []
    start = subprocess.Popen

    def noted(*words, **more):
        started.append(start(*words, **more))
        return started[-1]

    monkeypatch.setattr(subprocess, "Popen", noted)
    monkeypatch.setattr(viewer_simulator, "ANSWER_SECONDS", 0.1)
    with Simulator(None, ()) as source:
        address = source.reach()
        started[0].send_signal(signal.SIGSTOP)
        again = threading.Timer(0.5, started[0].send_signal, [signal.SIGCONT])
        again.start()
        assert source.reach() == address and len(started) == 1
        again.join()


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
        (["archer", "--seed", "-1"], "argument --seed: got '-1', expected an integer in 0..18446744073709551615"),
        (["archer", "--port", "70000"], "argument --port: got '70000', expected an integer in 0..65535"),
        (["archer", "--timeout", "0"], "argument --timeout: got '0', expected a positive number of seconds"),
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
