"""`joybridge doctor`: it says what is wrong with a running server, in the order of repair."""

import json
import socket
import time
from types import SimpleNamespace

import pytest

from joybridge.conformance import doctor, examination
from joybridge.conformance.doctor import main
from joybridge.conformance.expectations import TimedOut
from tests.support.broken_servers import BROKEN, PROTECTED, BrokenServer, Gauntlet, Service, serving

pytestmark = pytest.mark.usefixtures("quiet_servers")


@pytest.fixture
def config(tmp_path):
    """Return the path of a configuration that fits the server."""
    path = tmp_path / "gauntlet.yaml"
    path.write_text("game: gauntlet\narenas: 4\noptions: {size: large}\nparameters: {drift: 0.5}\n")
    return str(path)


def run(capsys, *arguments):
    """Return the exit status, and the outcome and text of each finding by what it is about."""
    status = main(["doctor", *arguments, "--json"])
    report = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert report["problems"] == [finding["ok"] for finding in report["findings"]].count(False)
    return status, {finding["about"]: (finding["ok"], finding["text"]) for finding in report["findings"]}


def test_a_correct_server_is_described(correct, capsys):
    status, found = run(capsys, correct)
    assert status == 0
    assert list(found) == ["port", "calls", "versions", "health", "spec", "steps", "latency", "sizes"]
    assert all(ok for ok, _ in found.values())
    assert found["calls"][1] == "ListGames returns gauntlet"
    described = "player observes image, an image of 2x2 gray and 6 numbers (sensors: 4, axes: 2, branches: 2)"
    assert described in found["spec"][1]
    assert found["steps"][1] == "gauntlet: 10 steps of 2 arenas are valid"
    assert "(p50)" in found["latency"][1] and "(p99)" in found["latency"][1]
    assert found["latency"][1].endswith("decisions/s without learning")


def test_the_last_line_names_the_next_command(correct, capsys):
    assert main(["doctor", correct]) == 0
    assert capsys.readouterr().out.splitlines()[-1].endswith(f"`joybridge check {correct}` tests every rule")


def test_a_configuration_is_played_as_it_says(correct, config, capsys):
    status, found = run(capsys, correct, config)
    assert status == 0
    assert found["config"] == (True, f"gauntlet: {config} fits: hybrid, 4 arenas")
    assert found["steps"][1] == "gauntlet: 10 steps of 4 arenas are valid"
    assert "player observes image, an image of 5x2 gray" in found["spec"][1]  # the option makes the image larger


def test_a_configuration_that_names_a_program_is_one_of_its_game(correct, tmp_path, capsys):
    path = tmp_path / "gauntlet.yaml"
    path.write_text("game: {pygame: my_game.py, name: gauntlet, reward: 'Score'}\narenas: 4\n")
    status, found = run(capsys, correct, str(path))
    assert status == 0 and found["config"][1].startswith("gauntlet: ")


@pytest.mark.parametrize(
    ("override", "about", "text"),
    [
        ("arenas=17", "config", "arenas is 17; expected 16 at most"),
        ("layout=bucket", "config", "layout: unknown layout 'bucket'"),
        ("policy.sensors=[smell]", "config", "player: sensors: the game has no 'smell'"),
        ("options.size=huge", "spec", "option 'size' got 'huge'"),
        ("parameters.drift=7", "config", "parameters.drift: got 7, expected 0..2"),
        ("game=chess", "spec", "NOT_FOUND"),
    ],
)
def test_a_configuration_that_does_not_fit_is_a_problem(override, about, text, correct, config, capsys):
    status, found = run(capsys, correct, config, override)
    assert status == 1
    assert [name for name, (ok, _) in found.items() if not ok] == [about] == [*found][-1:]
    assert text in found[about][1]


def test_a_configuration_that_cannot_be_read_is_an_error(correct, config, capsys):
    assert main(["doctor", correct, config, "arena=3"]) == 2
    wanted = "error: unknown key 'arena'; did you mean 'arenas'? `joybridge keys` lists all keys\n"
    assert capsys.readouterr().err == wanted


def test_without_the_trainer_the_server_is_examined_and_the_configuration_is_not(correct, config, capsys, monkeypatch):
    def missing(name):
        raise ModuleNotFoundError(name="pydantic")

    monkeypatch.setattr(doctor, "import_module", missing)
    status, found = run(capsys, correct, config)
    assert status == 0 and found["steps"][0]
    assert found["config"] == (None, "needs the module pydantic; install it with `pip install 'joybridge[train]'`")


class SaysNothingOfImages(Gauntlet):
    @classmethod
    def describe(cls, options):
        spec = super().describe(options)
        for sensor in spec.behaviors[0].sensors:
            sensor.ClearField("image")
        return spec


def test_what_looks_like_an_image_and_is_not_said_to_be_one_is_named(capsys):
    with serving(BrokenServer(set(), game=SaysNothingOfImages)) as address:
        _, found = run(capsys, address)
    assert found["spec"][1].endswith("; say that image is an image, so that policies see it with convolutions")


class NoList(Service):
    def ListGames(self, request, context):
        raise NotImplementedError


class Sleeps(Gauntlet):
    def step(self, acts):
        time.sleep(0.6)
        return super().step(acts)


@pytest.mark.parametrize(
    ("broken", "status", "about", "text"),
    [
        (BrokenServer(set(), service=NoList), 2, "calls", "ListGames failed with UNKNOWN"),
        (
            PROTECTED,
            2,
            "calls",
            "expected a response: give the server's token with --token-file",
        ),
        (BROKEN["StatesNoVersion"], 1, "versions", "has revision none; update the simulator"),
        (BROKEN["HealthOfTheServerOnly"], 1, "health", "NOT_FOUND"),
        (BROKEN["DefaultOutOfRange"], 1, "spec", "parameter 'drift' has its default outside low..high"),
        (BROKEN["RewardIsNotANumber"], 1, "steps", "expected finite numbers"),
        (BROKEN["FirstShapeWrong"], 1, "steps", "expected DTYPE_FLOAT32 [2, 2]"),
        (BrokenServer(set(), game=Sleeps), 1, "steps", "the server hangs, is busy or compiles the game"),
    ],
)
def test_the_first_problem_is_named_and_what_needs_it_is_not_examined(broken, status, about, text, capsys, monkeypatch):
    monkeypatch.setattr(examination, "SECONDS", 0.5 if broken.game is Sleeps else 30.0)
    with serving(broken) as address:
        assert main(["doctor", address]) == status
    *findings, _, last = capsys.readouterr().out.splitlines()
    (problem,) = (line for line in findings if line.startswith("problem"))
    assert problem.split()[1] == about and text in problem
    assert last.startswith("1 problem in ") and last.endswith(f"repair first: {about}, then run this again")


def test_a_port_that_nobody_or_another_program_listens_to_is_told_apart(capsys, monkeypatch):
    with socket.create_server(("127.0.0.1", 0)) as other:
        place = f"127.0.0.1:{other.getsockname()[1]}"
        monkeypatch.setattr(examination, "SECONDS", 0.5)
        status, found = run(capsys, place)
        assert (status, [*found]) == (2, ["port", "calls"]) and found["port"][0] and not found["calls"][0]
    status, found = run(capsys, place)
    assert (status, [*found]) == (2, ["port"])
    missed = f"nothing listens at {place} (Connection refused); expected a server; start one, with"
    assert found["port"][1].startswith(missed)
    status, found = run(capsys, "nobody.invalid:5005")
    assert status == 2 and found["port"][1].startswith("the name in nobody.invalid:5005 has no address (")
    status, found = run(capsys, "unix:/no/such/socket")
    assert status == 2 and "(No such file or directory)" in found["port"][1]


def test_without_an_address_it_looks_where_a_server_listens_by_default(correct, config, capsys, monkeypatch):
    monkeypatch.setattr(doctor, "DEFAULT_ADDRESS", correct)
    assert run(capsys)[1]["calls"] == (True, "ListGames returns gauntlet")
    status, found = run(capsys, config, "arenas=3")
    assert status == 0 and found["config"] == (True, f"gauntlet: {config} fits: hybrid, 3 arenas")


def test_a_game_in_the_place_of_the_address_is_told_where_it_is_examined(capsys):
    with pytest.raises(SystemExit):
        main(["doctor", "my_game:MyGame"])
    assert "serve a game of your own first: `joybridge serve --game my_game:MyGame`\n" in capsys.readouterr().err


class Many(Service):
    def ListGames(self, request, context):
        listed = super().ListGames(request, context)
        for name in ("one", "other"):
            listed.games.add(name=name)
        return listed


def test_games_for_which_no_time_was_left_are_one_line(monkeypatch):
    looked: list[object] = []

    def look(*given):
        looked.append(given)
        return ()

    clock = SimpleNamespace(monotonic=lambda: 1e9 * len(looked), perf_counter=time.perf_counter)
    monkeypatch.setattr(examination, "time", clock)
    monkeypatch.setattr(examination, "_game", look)
    with serving(BrokenServer(set(), service=Many)) as address:
        findings = [*examination.examine(address)]
    assert findings[-1].text == "one, other: no time was left; name a game with --game"


def test_a_game_that_had_little_time_is_no_problem():
    def late():
        raise TimedOut(0.4)

    hurried, first = (examination._look("steps", late, hurried=hurried) for hurried in (True, False))
    assert (hurried.ok, first.ok) == (None, False)
    assert hurried.text == "no response within 0.4 s, and little time was left; name a game with --game"
