"""Programs written with pygame in commands and configurations: trained, evaluated, replayed, driven."""

import io
import json
import re
import shlex
import shutil
from argparse import Namespace
from contextlib import redirect_stderr
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

from joybridge.client.client import Session
from joybridge.client.command_line import add_own_game
from joybridge.client.errors import SimulatorLost
from joybridge.client.own_games import choose_game
from joybridge.commands import drive
from joybridge.config.config import load_config
from joybridge.config.errors import ConfigError
from joybridge.config.programs import programs_of
from joybridge.layouts import make_acts
from joybridge.policy.config_fit import find_and_load
from joybridge.progress import Progress
from joybridge.simulator.__main__ import main
from joybridge.simulator.catalog import CatalogError, load_game
from tests.support.command_line import joybridge
from tests.support.programs import CATCH, CATCHING, HEAD, LOOP, SHOW
from tests.support.servers import server

KEYS = "written with pygame. Keys in its sources: LEFT, RIGHT; that it was seen to read: LEFT, RIGHT."


def test_a_server_gives_its_program_rewards_keys_and_arguments(tmp_path):
    path = tmp_path / "program.py"
    path.write_text("import sys\nassert sys.argv[1:] == ['--level']\n" + HEAD + LOOP + SHOW)
    words = ["--pygame", str(path), "--reward", r"Score: (\d+)", "--keys", "UP,a", "--", "--level"]
    listed = joybridge("list", *words)
    assert "rewards: score (weight 1)" in listed.output
    assert "key_UP (released | pressed [ArrowUp]), key_a (released | pressed [KeyA])" in " ".join(listed.output.split())
    quoted = joybridge("list", "--pygame", f"{path} -- --level", "--keys", "UP,a")
    assert "key_UP" in quoted.output and "key_LEFT" not in quoted.output
    with server(*words) as process, Session(process.address, "program", arenas=2, seed=1) as session:
        (step,) = session.step(make_acts(session.spec, 2))
        process.kill()  # then the processes of the program end by themselves
    assert step.observations[0].shape == (2, 55, 74, 3)


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (["--reward", "Score"], "--reward is for the program in a --pygame before it"),
        (["--gym", "CartPole-v1", "--done", "over"], "--done is for the program in a --pygame before it"),
        (["--", "--level", "3"], "got '--level' after --"),
    ],
)
def test_options_of_a_program_without_one_are_refused(words, what):
    errors = io.StringIO()
    with redirect_stderr(errors), pytest.raises(SystemExit):
        main(["list", *words])
    assert what in errors.getvalue()


def test_commands_name_a_program_by_its_place(tmp_path):
    done = joybridge("look", f"pygame:{CATCH} name=fruit", str(tmp_path / "look.png"), "--pictures", "2")
    assert done == (
        0,
        f"{tmp_path / 'look.png'}: 2 pictures of fruit, one every 4 decisions\n{CATCH} name=fruit, a program {KEYS}\n",
        "",
    )


@pytest.mark.parametrize("place", ["pygame:", "pygame:-- x", "pygame:'open"])
def test_a_place_without_a_program_is_refused_by_both_sides(place):
    with pytest.raises(CatalogError, match=r"missing|quotation"):
        load_game(place)
    with pytest.raises(ConfigError, match=r"missing|quotation"):
        choose_game(place, (), None)


CONFIG = r"""
game: {pygame: PROGRAM, reward: ['Score: (\d+)', 'sound:none'], done: Game over, keys: [LEFT, RIGHT], mouse: false,
       max_decisions: 8, name: fruit}
options: {screen: '48', colors: gray}
arenas: 2
pipeline_groups: 1
total_timesteps: 32
log_interval: 16
policy: {hidden_sizes: [4], rollout_steps: 8, frame_stack: 1, image_encoder: none, epochs: 1}
"""


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    config = folder / "fruit.yaml"
    config.write_text(CONFIG.replace("PROGRAM", str(CATCHING)))
    trained = joybridge("train", str(config), "--run", str(folder / "run"), "game.max_decisions=4")
    assert trained.status == 0, trained.errors
    return folder / "run"


def test_a_run_remembers_the_program_that_its_configuration_has_named(run):
    assert (run / "config.yaml").read_text().startswith("game: fruit\n")
    evaluated = joybridge("evaluate", str(run), "--episodes", "2", "--json")
    assert evaluated.status == 0 and '"length": 4.0' in evaluated.output


@pytest.mark.parametrize(("acts", "proposed"), [(0, "joybridge export"), (1, "joybridge watch")])
def test_no_export_is_proposed_that_would_be_refused(acts, proposed, run, tmp_path):
    if acts:
        config, run = run / "config.yaml", tmp_path / "run"
        trained = joybridge("train", str(config), "--run", str(run), f"policy.remember_acts={acts}")
        assert trained.status == 0, trained.errors
    recorded = joybridge("record", str(run), str(tmp_path / "play.gif"), "--seconds", "0.5")
    assert recorded.status == 0 and f"next: {proposed} {run}" in recorded.errors, recorded.errors


def test_settings_of_an_evaluation_are_laid_over_those_of_the_training(run, tmp_path):
    program = f"{CATCHING} tapes={tmp_path / 'tapes'}"
    evaluated = joybridge("evaluate", str(run), "--pygame", program, "--episodes", "1", "--json")
    assert evaluated.status == 0 and '"length": 4.0' in evaluated.output, evaluated.errors
    assert {path.name[:6] for path in (tmp_path / "tapes").glob("*.tape")} == {"fruit-"}


def test_a_fault_of_a_run_is_replayed_with_the_program_of_the_run(run, tmp_path):
    (place,) = json.loads((run / "simulators.json").read_text())["games"]
    copy = Path(shutil.copytree(run, tmp_path / "run"))
    with server("--game", place) as process:
        session = Session(process.address, "fruit", arenas=1, seed=1, timeout=20)
        session.record_faults(copy / "faults")
        session.step(make_acts(session.spec, 1))
        process.kill()
        process.wait()
    with session, pytest.raises(SimulatorLost):
        session.step(make_acts(session.spec, 1))
    (fault,) = (copy / "faults").iterdir()
    done = joybridge("replay", str(fault))
    assert done.status == 0 and "2 steps are as they were recorded" in done.output, done.errors


def test_the_configuration_of_a_run_trains_another_one_with_its_program(run, tmp_path):
    again = joybridge("train", str(run / "config.yaml"), "--run", str(tmp_path / "again"))
    assert again.status == 0, again.errors
    assert (tmp_path / "again/simulators.json").read_text() == (run / "simulators.json").read_text()


def test_a_configuration_that_names_its_program_takes_no_other_from_the_command_line(tmp_path):
    config = tmp_path / "fruit.yaml"
    config.write_text(f"game: {{pygame: {CATCHING}}}\n")
    done = joybridge("train", str(config), "--pygame", "other.py", "--run", str(tmp_path / "run"))
    assert done.status == 1 and f"names its own program, pygame:{CATCHING}, so that of --pygame" in done.errors
    assert "write game.pygame=other.py" in done.errors


def test_a_program_is_found_beside_the_configuration_that_names_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "below"
    folder.mkdir()
    (folder / "fruit.yaml").write_text("game: {pygame: fruit.py, hook: hook.py, arguments: [fruit.py]}\n")
    for name in ("fruit.py", "hook.py"):
        (folder / name).touch()
    assert programs_of("below/fruit.yaml", []) == {"game": "pygame:below/fruit.py hook=below/hook.py -- fruit.py"}
    assert find_and_load("below/fruit.yaml").game == "fruit"
    (tmp_path / "hook.py").touch()
    assert programs_of("below/fruit.yaml", []) == {"game": "pygame:below/fruit.py hook=hook.py -- fruit.py"}
    assert programs_of("below/fruit.yaml", ["game.pygame=none.py"])["game"].startswith("pygame:none.py ")


@pytest.mark.parametrize(
    ("game", "error"),
    [
        ("{reward: 'Score'}", "expected one program, as in {pygame: my_game.py}"),
        ("{pygame: game.py keys=}", "the setting 'keys' is a key of its own, as in {pygame: my_game.py, keys: …}"),
    ],
)
def test_a_configuration_without_a_program_behind_its_keys_is_refused(game, error, tmp_path):
    config = tmp_path / "fruit.yaml"
    config.write_text(f"game: {game}\n")
    done = joybridge("train", str(config), "--run", str(tmp_path / "run"))
    assert done.status == 1 and error in done.errors


@pytest.mark.parametrize("keys", ["[]", "''", ""])
def test_a_program_in_a_configuration_may_have_no_keys(keys, tmp_path):
    (tmp_path / "fruit.yaml").write_text(f"game:\n  pygame: fruit.py\n  keys: {keys}\n  arguments: []\n")
    assert programs_of(str(tmp_path / "fruit.yaml"), []) == {"game": "pygame:fruit.py keys="}


def test_a_configuration_may_name_an_environment_with_its_module(tmp_path):
    (tmp_path / "dock.yaml").write_text("game: gym:my_module:Dock-v0 size=3\n")
    assert programs_of(str(tmp_path / "dock.yaml"), []) == {"game": "gym:my_module:Dock-v0 size=3"}
    assert find_and_load(str(tmp_path / "dock.yaml")).game == "Dock-v0"
    with pytest.raises(ConfigError, match=r"game \"gym:Dock-v0 'a\": No closing quotation"):
        find_and_load(str(tmp_path / "dock.yaml"), ["game=gym:Dock-v0 'a"])


@pytest.mark.parametrize("nothing", ["[]", ""])
def test_what_pays_and_ends_may_be_left_empty(nothing, tmp_path):
    """An empty pattern would end an episode with its first text."""
    (tmp_path / "fruit.yaml").write_text(f"game:\n  pygame: fruit.py\n  reward: {nothing}\n  done: {nothing}\n")
    assert programs_of(str(tmp_path / "fruit.yaml"), []) == {"game": "pygame:fruit.py"}


def test_a_hook_and_a_configuration_are_written_for_a_program(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "game.py").write_text(f"{CATCHING.read_text()}\nEND, WON = 'GAME OVER (r: restart)', 'you won'\n")
    made = joybridge("new", "--pygame", "game.py keys=LEFT buttons=left -- easy")
    assert made.status == 0 and "train game.yaml --run runs/game" in made.output, made.errors
    assert len((tmp_path / "game_hook.py").read_text().splitlines()) <= 20
    options = Namespace(game=[], simulator=[], overrides=[])
    add_own_game(options, ["game.yaml"])
    load_config(tmp_path / "game.yaml", options.overrides)
    written = (tmp_path / "game.yaml").read_text()
    assert (
        '  #   - "^Score: (-?\\\\d+)"  # 0 to ' in written
        and '  # done: "GAME OVER"  # ' in written
        and '"you won", too' in written
    )
    paid = written.replace("  # reward:", "  reward:").replace("  #   - ", "    - ").replace("  # done:", "  done:")
    keys = YAML(typ="safe").load(paid)["game"]
    assert "^Score: (-?\\d+)" in keys["reward"] and keys["done"] == "GAME OVER"
    (place,) = options.game
    assert place == "pygame:game.py keys=LEFT buttons=left hook=game_hook.py -- easy"
    game: Any = load_game(place)
    game.processes.end()
    assert game.look.channels == ["reward"]
    (tmp_path / "far").mkdir()
    assert joybridge("new", "--pygame", "game.py hook=game_hook.py", "--folder", "far").status == 0
    assert 'hook: "../game_hook.py"' in (tmp_path / "far" / "game.yaml").read_text()
    again = joybridge("new", "--pygame", "game.py")
    assert again.status == 2 and "game.yaml exists and is not overwritten" in again.errors


def test_the_policy_of_a_run_plays_the_program_in_its_own_window(run, tmp_path, monkeypatch):
    shorter = tmp_path / "shorter.py"
    source = CATCHING.read_text().replace("randint(2, 5)", "randint(40, 50)").replace("0, 20\n", "0, 1\n")
    source = source.replace("pygame.init()\n", "pygame.init()\n    pygame.mixer.init()\n", 1)
    shorter.write_text(source.replace("sys.exit()", "break") + CLOSED.format(tmp_path / "closed"))
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.delenv("SDL_AUDIODRIVER", raising=False)  # there may be no sound card
    driven = joybridge("drive", str(shorter), str(run), "--episodes", "2")
    assert driven.status == 0, driven.errors
    assert re.fullmatch(rf"({PACE}){{2}}", driven.output)
    assert float((tmp_path / "closed").read_text()) > 0  # written outside of any fence, by the real clock


def test_a_window_needs_a_display(tmp_path, monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "SDL_VIDEODRIVER"):
        monkeypatch.delenv(name, raising=False)
    driven = joybridge("drive", str(CATCHING), str(tmp_path))
    assert driven.status == 1 and driven.errors.startswith("error: there is no display on which a window could open")


PACE = r"reward [-\d.]+ in \d+ decisions(, [\d.]+ per second of 12.5)?\n"


@pytest.mark.parametrize("suffix", ["onnx", "json"])
def test_an_exported_policy_plays_the_program_in_its_own_window(run, tmp_path, monkeypatch, suffix):
    exported = joybridge("export", str(run), str(tmp_path / f"policy.{suffix}"))
    assert exported.status == 0, exported.errors
    (words,) = re.findall(r"next: (.*)", exported.errors)
    assert shlex.split(words)[:2] == ["joybridge", "drive"] and "'reward=Score: (\\d+)'" in shlex.split(words)[2]
    shorter = tmp_path / "shorter.py"
    source = CATCHING.read_text().replace("randint(2, 5)", "randint(40, 50)").replace("0, 20\n", "0, 1\n")
    shorter.write_text(source)
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    monkeypatch.setenv("SDL_AUDIODRIVER", "dummy")
    monkeypatch.setattr(drive, "Progress", partial(Progress, seconds=0.0))
    driven = joybridge("drive", str(shorter), str(tmp_path / f"policy.{suffix}"))
    assert driven.status == 0, driven.errors
    assert "1 decisions, reward 0; nothing ends the episode but the program, its window or Ctrl-C" in driven.errors
    assert re.fullmatch(PACE, driven.output) and "does not say what pays and what ends an episode" in driven.errors
    driven = joybridge("drive", f"{shorter} 'reward=Score: (\\d+)'", str(tmp_path / f"policy.{suffix}"))
    assert driven.status == 0 and "does not say" not in driven.errors
    other = joybridge("drive", f"{shorter} keys=UP", str(tmp_path / f"policy.{suffix}"))
    assert other.status == 1 and "the policy was trained with ['key_LEFT', 'key_RIGHT']" in other.errors


def test_a_file_that_is_no_policy_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    for suffix in ("onnx", "json"):
        path = tmp_path / f"policy.{suffix}"
        path.write_bytes(b"{}")
        driven = joybridge("drive", str(CATCHING), str(path))
        assert driven.status == 1 and f"{path} is no exported policy" in driven.errors, driven.errors
        driven = joybridge("drive", str(CATCHING), str(path), "--deterministic")
        assert driven.status == 1 and "was exported with its own" in driven.errors, driven.errors


CLOSED = """
    import contextlib, pathlib, time
    with contextlib.suppress(PermissionError):  # behind the fences of its first look
        pathlib.Path('{}').write_text(str(time.time() - 1_750_000_000))
"""
