"""`joybridge new`: what it writes keeps every rule and learns; what it cannot do, it refuses by name."""

import ast
import json
import os
import shlex
import shutil
import subprocess
import sys
import tokenize
from contextlib import chdir, contextmanager
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from joybridge.cli import main
from joybridge.client.client import describe
from joybridge.config.config import load_config
from joybridge.config.metrics import read_rows
from joybridge.games import BUILT_IN
from joybridge.layouts import make_layouts
from joybridge.simulator import GameSpec, axis, behavior, button, image, sensor
from joybridge.simulator.catalog import load_game
from joybridge.simulator.new_game import starter
from joybridge.simulator.new_game.starter import starter_config
from joybridge.simulator.new_game.write import TEMPLATE, NewGameError, write_new
from tests.support.command_line import joybridge

ROOT = Path(__file__).parents[1]
TYPED = [
    "joybridge serve --game my_pond:MyPond",
    "joybridge check 127.0.0.1:5005 --game my_pond",
    "joybridge look my_pond:MyPond my_pond.png",
    "joybridge train my_pond.yaml --run runs/my_pond",
    "joybridge evaluate runs/my_pond",
    "joybridge record runs/my_pond my_pond.mp4",
]
# A reader's: the environment is active, and nothing says where games are.
READER = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
READER["PATH"] = f"{Path(sys.executable).parent}{os.pathsep}{READER['PATH']}"


def typed(output: str) -> list[str]:
    return [line.strip() for line in output.splitlines() if line.startswith("  ")]


def shell(command: str, folder: Path) -> str:
    """Return what a command prints in a folder."""
    process = subprocess.run(
        ["bash", "-c", command], cwd=folder, env=READER, capture_output=True, text=True, timeout=600, check=False
    )
    assert process.returncode == 0, f"{command}\n{process.stdout}\n{process.stderr}"
    return process.stdout


def run(command: str, folder: Path) -> str:
    """Return what a command of joybridge prints in a folder, run in this process."""
    with chdir(folder):
        done = joybridge(*shlex.split(command)[1:])
    assert done.status == 0, f"{command}\n{done.output}\n{done.errors}"
    return done.output


@contextmanager
def serving(command: str, folder: Path):
    """Yield the address of a server that is started in a folder."""
    command = f"exec {command} --address 127.0.0.1:0 --with-parent"
    with subprocess.Popen(
        ["bash", "-c", command], cwd=folder, env=READER, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().split()[-1]
        finally:
            process.terminate()


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Return a folder in which a game was begun, and the commands that were said to come next."""
    folder = tmp_path_factory.mktemp("author")
    return folder, typed(shell("joybridge new my_pond", folder))


@pytest.fixture(autouse=True)
def _forget():
    """Forget the module of a game after each test: commands that run in this process import it."""
    yield
    sys.modules.pop("my_pond", None)


@pytest.fixture
def folder(tmp_path):
    with chdir(tmp_path):
        yield tmp_path


def test_it_says_what_to_type_next(written):
    assert written[1] == TYPED


@pytest.mark.promise("E2")
def test_what_it_writes_passes_the_kit(written):
    folder, (serve, check, *_) = written
    with serving(serve, folder) as address:
        output = run(check.replace("127.0.0.1:5005", address) + " --json", folder)
    result = json.loads(output.splitlines()[-1])
    assert result["failed"] == 0 and result["passed"] > 150


@pytest.mark.slow
def test_what_it_writes_learns_and_can_be_watched(written):
    folder, (_, _, look, train, evaluate, record) = written
    assert shell(look, folder).startswith("my_pond.png: 12 pictures")
    run(f"{train} total_timesteps=20000 log_interval=4000", folder)
    first, *_, last = read_rows(folder / "runs/my_pond/metrics-player.csv")
    assert first["caught"] < 5 and last["caught"] > 15
    result = json.loads(run(f"{evaluate} --episodes 32 --json", folder).splitlines()[-1])
    assert result["player"]["means"]["caught"] > 15
    assert run(f"{record} --seconds 2", folder).strip() == "my_pond.mp4: 20 frames"
    run("joybridge export runs/my_pond policy.json", folder)
    shutil.copy(ROOT / "proto/examples/python/policy.py", folder)
    page = (ROOT / "docs/exported-policies.md").read_text()
    program = page.split("```python\n")[2].split("```")[0].replace("my_game", "my_pond").replace("MyGame", "MyPond")
    (folder / "product.py").write_text(program)
    assert json.loads(shell("python product.py", folder).replace("'", '"'))["caught"] > 10


@pytest.mark.promise("E2")
def test_an_author_has_written_at_most_sixty_lines():
    path = TEMPLATE / "my_game.py"
    assert 40 < len(code_lines(path)) <= 60


def code_lines(path: Path) -> set[int]:
    """Return the lines of a module that hold more than comments and docstrings."""
    words = {
        line
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        for line in range(node.lineno, (node.end_lineno or node.lineno) + 1)
    }
    empty = {tokenize.ENCODING, tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT}
    empty |= {tokenize.ENDMARKER}
    with path.open("rb") as file:
        tokens = [token for token in tokenize.tokenize(file.readline) if token.type not in empty]
    return {line for token in tokens for line in range(token.start[0], token.end[0] + 1)} - words


def test_code_lines_are_counted(tmp_path):
    path = tmp_path / "a.py"
    path.write_text(
        '"""Words.\n\nMore."""\n\n# and more\nx = [  # a list\n\n    1,\n]\n\ndef f():\n    """Say."""\n    return x\n'
    )
    assert code_lines(path) == {6, 8, 9, 11, 13}


def test_a_configuration_elsewhere_is_trained_from_here_where_the_module_of_its_environment_is(folder, capsys):
    assert main(["new", "--gym", "CartPole-v1", "--folder", "else where"]) == 0
    train, evaluate, *_ = typed(capsys.readouterr().out)
    assert train.endswith("train 'else where/CartPole-v1.yaml' --run runs/CartPole-v1")
    assert evaluate.endswith("evaluate runs/CartPole-v1") and (folder / "else where" / "CartPole-v1.yaml").exists()


def test_its_names_are_the_authors_everywhere(folder, capsys):
    assert main(["new", "red_kite7"]) == 0
    assert {path.name for path in folder.iterdir()} == {"red_kite7.py", "red_kite7.yaml"}
    for path in folder.iterdir():
        text = path.read_text()
        template = (TEMPLATE / f"my_game{path.suffix}").read_text()
        assert "my_game" not in text and "MyGame" not in text
        assert text.replace("red_kite7", "my_game").replace("RedKite7", "MyGame") == template


def test_it_may_be_written_elsewhere(folder, capsys):
    assert main(["new", "my_pond", "--folder", "some where/else"]) == 0
    assert {path.name for path in Path("some where/else").iterdir()} == {"my_pond.py", "my_pond.yaml"}
    go, serve, again, *_ = typed(capsys.readouterr().out)
    assert go == again == "cd 'some where/else'"
    listed = shell(f"{go} && {serve.replace(' serve ', ' list ')}", folder)
    assert "my_pond: " in listed


@pytest.mark.parametrize(
    ("name", "complaint"),
    [
        ("9lives", "'9lives': its module has the same name; use lower-case letters"),
        ("my-game", "'my-game': its module has the same name; use lower-case letters"),
        ("MyGame", "'MyGame': its module has the same name; use lower-case letters"),
        ("a/b", "'a/b': its module has the same name; use lower-case letters"),
        ("", "'': its module has the same name; use lower-case letters"),
        ("class", "'class', a keyword of Python; try class_game"),
        ("none", "the class of 'none' would be None, a name that is taken; try my_none"),
        ("action", "the class of 'action' would be Action, a name that is taken; try my_action"),
        ("json", "a module 'json' already, which json.py would hide; try json_game"),
        ("antigravity", "a module 'antigravity' already, which antigravity.py would hide; try antigravity_game"),
        ("numpy", "a module 'numpy' already, which numpy.py would hide; try numpy_game"),
        ("trainer", "a module 'trainer' already, which trainer.py would hide; try trainer_game"),
        *((name, f"'{name}' is a built-in game; choose another name, for example my_{name}") for name in BUILT_IN),
    ],
)
def test_a_bad_name_is_refused_with_the_next_move(name, complaint, folder, capsys):
    assert main(["new", name]) == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert error.startswith("error: ") and complaint in error
    assert not list(folder.iterdir())


def test_a_package_in_the_folder_is_not_hidden_either(folder, capsys):
    (folder / "there/my_pond").mkdir(parents=True)
    (folder / "there/my_pond/__init__.py").touch()
    assert main(["new", "my_pond", "--folder", "there"]) == 2
    assert "there is a module 'my_pond' already" in capsys.readouterr().err
    assert [path.name for path in (folder / "there").iterdir()] == ["my_pond"]


@pytest.mark.parametrize("suffix", [".py", ".yaml"])
def test_nothing_is_overwritten(suffix, folder, capsys):
    path = folder / f"my_pond{suffix}"
    path.write_text("precious")
    assert main(["new", "my_pond"]) == 2
    wanted = f"error: {path.name} exists and is not overwritten; choose another name or --folder\n"
    assert capsys.readouterr().err == wanted
    assert [(path.name, path.read_text()) for path in folder.iterdir()] == [(path.name, "precious")]


def test_nothing_is_left_behind_when_not_everything_can_be_written(tmp_path):
    first, second = tmp_path / "game.py", tmp_path / "folder" / "game.yaml"
    second.parent.write_text("no folder", encoding="utf-8")
    with pytest.raises(NewGameError, match="choose another --folder"):
        write_new({first: "text", second: "text"})
    assert not first.exists()


def test_a_folder_that_is_none_is_refused(folder, capsys):
    (folder / "file").touch()
    assert main(["new", "my_pond", "--folder", "file"]) == 2
    assert capsys.readouterr().err == "error: cannot write file: File exists; choose another --folder\n"


# ---------------------------------------------------------------------------- a configuration for a running server


@pytest.mark.parametrize("game", BUILT_IN)
def test_the_configuration_for_a_running_server_suits_its_spec(simulator, game, folder, capsys):
    assert main(["new", "--for", simulator, "--game", game, "--folder", "there"]) == 0
    written = Path(f"there/{game}.yaml")
    config = load_config(written)
    spec = describe(simulator, game, {})
    lanes = config.arenas * max(behavior.agents_per_arena for behavior in spec.behaviors)
    assert config.game == game and 32 <= lanes <= 64 and config.arenas <= spec.max_arenas
    assert config.policy.rollout_steps == config.policy.time_horizon <= (spec.max_episode_decisions or 60)
    train = f"train there/{game}.yaml --simulator {simulator} --run runs/{game}"
    assert typed(capsys.readouterr().out)[0].endswith(train)
    written.write_text(written.read_text().replace("# penalty_ramp:", "penalty_ramp:"))  # what is proposed is a key
    assert config.policy.penalty_ramp == 0 and load_config(written).policy.penalty_ramp == 100_000


@pytest.mark.filterwarnings("ignore:The old environment creation API:DeprecationWarning")
def test_the_configuration_of_an_environment_needs_no_server(folder, capsys):
    assert main(["new", "--gym", "CartPole-v1"]) == 0
    assert load_config(Path("CartPole-v1.yaml")).game == "gym:CartPole-v1"
    written = typed(capsys.readouterr().out)
    assert written[0].endswith("train CartPole-v1.yaml --run runs/CartPole-v1")
    assert main(["new", "--pettingzoo", "pettingzoo.classic.tictactoe_v3"]) == 0
    assert "train tictactoe_v3.yaml --pettingzoo pettingzoo.classic.tictactoe_v3 --run " in capsys.readouterr().out
    assert main(["new", "--gym", "gone:Nothing-v0"]) == 2
    assert "error: --gym 'gone:Nothing-v0' does not work: " in capsys.readouterr().err


def test_a_game_whose_name_looks_like_an_option_is_written_as_a_file(folder):
    described = load_game(BUILT_IN["orchard"]).describe({"observation": "state"})
    described.name = "-rf"
    said = starter.write_config(described, ("--simulator", "127.0.0.1:1"), folder)
    assert " train ./-rf.yaml --simulator " in said and " record runs/-rf ./-rf.mp4" in said


def test_no_video_is_proposed_of_a_game_that_cannot_be_drawn(folder):
    described = load_game(BUILT_IN["orchard"]).describe({"observation": "state"})
    described.ClearField("picture")
    said = starter.write_config(described, ("--simulator", "127.0.0.1:1"), folder)
    assert "record" not in said and " evaluate runs/orchard\n" in said and "check 127.0.0.1:1 --game orchard" in said


def test_sizes_follow_the_numbers_of_an_observation():
    def config(numbers, **settings):
        player = behavior("player", sensors=[sensor("all", [numbers])], branches=[button("press")])
        return yaml.load(starter_config(GameSpec(name="my: game", behaviors=[player], **settings), "my: game"))

    yaml = YAML(typ="safe")
    few, many = config(3, max_arenas=16, max_episode_decisions=9), config(900, max_arenas=1024)
    assert few["game"] == "my: game"
    assert (few["arenas"], few["policy"]["rollout_steps"], few["policy"]["hidden_sizes"]) == (16, 9, [32, 32])
    assert (many["arenas"], many["policy"]["rollout_steps"], many["policy"]["hidden_sizes"]) == (64, 60, [128, 128])


@pytest.mark.parametrize(
    ("kind", "centered", "layout"),
    [
        ("position", False, "map-16x12"),
        ("velocity", False, "bucket-7"),
        ("position", True, "bucket-7"),
        ("", False, "hybrid"),
    ],
)
def test_who_sees_an_image_begins_with_settings_for_images(kind, centered, layout):
    shown = image("screen", 48, 64, channels=3, centered=centered)
    player = behavior(
        "player", sensors=[shown], axes=[axis(name, kind=kind) for name in "xy" if kind], branches=[button("jump")]
    )
    text = starter_config(GameSpec(name="field", behaviors=[player], max_arenas=128), "field")
    config = YAML(typ="safe").load(text)
    assert config["layout"] == layout and config["arenas"] == 16 and "the image of 64x48" in text
    assert config["policy"]["frame_stack"] == 2 and config["policy"]["image_encoder"] == "auto"


def test_who_points_and_holds_several_buttons_is_shown_a_mixture_that_can(tmp_path):
    player = behavior(
        "player",
        sensors=[image("screen", 48, 64, channels=3)],
        axes=[axis(name, kind="position") for name in "xy"],
        branches=[button("run"), button("shoot")],
    )
    text = starter_config(GameSpec(name="field", behaviors=[player], max_arenas=128), "field")
    mixture = text.partition("several at once: ")[2].partition("\n")[0]
    made = make_layouts(mixture, player.device)[""]
    assert mixture == "hybrid, x=map-16x12, y=map-16x12" and len(made.discrete) == 3


def test_the_games_of_a_running_server_are_listed_as_the_built_in_ones_are(simulator, capsys):
    assert main(["list"]) == 0
    built_in = capsys.readouterr().out.rstrip()
    assert main(["list", "--simulator", simulator]) == 0
    listed = capsys.readouterr().out
    assert listed.rstrip().endswith(f"\n\n{built_in}") and listed.startswith("hybrid: Move a point with two axes")
    assert "  option size: small | large (default small)\n  option masks: on | off (default on)\n" in listed


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--simulator", "127.0.0.1:1"], "error: no answer from a server at 127.0.0.1:1: "),
        (["--simulator", "127.0.0.1:1", "--game", "a:B"], "which has its own games"),
    ],
)
def test_a_server_whose_games_cannot_be_listed_is_one_sentence(arguments, complaint, capsys):
    assert main(["list", *arguments]) == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert complaint in error


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--for", "ADDRESS"], "; choose one with --game"),
        (["--for", "ADDRESS", "--game", "chess"], "; --game chess is none of them"),
        (["--for", "127.0.0.1:1"], "error: no answer from a server at 127.0.0.1:1: "),
        (["my_pond", "--game", "chess"], "error: --game, --tls-ca and --token-file are for --for ADDRESS; "),
    ],
)
def test_a_configuration_that_cannot_be_written_is_one_sentence(simulator, arguments, complaint, folder, capsys):
    assert main(["new", *(simulator if word == "ADDRESS" else word for word in arguments)]) == 2
    (error,) = capsys.readouterr().err.splitlines()
    assert complaint in error and not list(folder.iterdir())


def test_a_configuration_is_not_overwritten(simulator, folder, capsys):
    (folder / "archer.yaml").write_text("precious")
    assert main(["new", "--for", simulator, "--game", "archer"]) == 2
    assert "archer.yaml exists and is not overwritten" in capsys.readouterr().err
    assert (folder / "archer.yaml").read_text() == "precious"


@pytest.mark.slow
def test_the_configuration_for_a_running_server_learns(simulator, folder):
    main(["new", "--for", simulator, "--game", "archer"])
    short = ["stop_at=45000", "log_interval=15000"]
    assert main(["train", "archer.yaml", *short, "--simulator", simulator, "--run", "run"]) == 0
    first, *_, last = read_rows(folder / "run/metrics-archer.csv")
    assert first["accuracy"] < 0.2 and last["accuracy"] > 0.3


# --------------------------------------------------------------------------------- other arguments that are refused

PORTS = "expected HOST:PORT with a port from 0 to 65535, as in 127.0.0.1:5005, or unix:PATH"


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["serve", "--address", "127.0.0.1:65536"], f"argument --address: got '127.0.0.1:65536', {PORTS}"),
        (["serve", "--address", "127.0.0.1:-1"], f"argument --address: got '127.0.0.1:-1', {PORTS}"),
        (["serve", "--address", "localhost"], f"argument --address: got 'localhost', {PORTS}"),
        (["serve", "--address", ":5005"], f"argument --address: got ':5005', {PORTS}"),
        (["check", "127.0.0.1:70541"], f"argument ADDRESS: got '127.0.0.1:70541', {PORTS}"),
        (["serve", "--sessions", "0"], "argument --sessions: got '0', expected an integer of at least 1"),
        (["serve", "--sessions", "many"], "argument --sessions: got 'many', expected an integer of at least 1"),
    ],
)
def test_an_argument_out_of_range_is_refused_by_name(arguments, complaint, capsys):
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    assert caught.value.code == 2
    assert capsys.readouterr().err.splitlines()[-1].endswith(f"error: {complaint}")
