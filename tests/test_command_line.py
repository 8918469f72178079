"""The trainer's command line: what is refused, and in which words. In process: only errors are looked at."""

import json
from pathlib import Path

import pytest

from joybridge.cli import main
from joybridge.run.checkpoint import Manifest, save_checkpoint

pytestmark = pytest.mark.usefixtures("signals")

CONFIG = "shooting_birds/bucket-11"
SMALL = ["arenas=4", "policy.rollout_steps=20", "policy.minibatch_size=40", "stop_at=100"]


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--simulator", "127.0.0.1:1", "--wait", "1.2"], "no simulator at 127.0.0.1:1 after 1.2 s"),
        (
            ["game=shooting_brids"],
            "no game named 'shooting_brids'; this server has hybrid, duel",
        ),
        (["options.rules=strict"], "option 'rules' got 'strict', expected one of original, corrected"),
        (["options.wind=on"], "unknown option 'wind', expected one of rules, locomotion, level"),
        (["parameters.bird_speed=9"], "parameters.bird_speed: got 9, expected 0..4"),
        (["parameters.wind=9"], "unknown parameter 'wind'"),
        (
            ["options.bird_speed=2"],
            "options.bird_speed: it is a parameter of shooting_birds; write parameters.bird_speed=",
        ),
        (["parameters.level=2"], "parameters.level: it is an option of shooting_birds; write options.level=CHOICE"),
        (
            ["parameters.rules=original"],
            "expected a number; if it is an option of the game, write options.rules=original",
        ),
        (["layout=bukket-11"], "unknown layout 'bukket-11'"),
        (["policy.sensors=[gnu]"], "hunter: sensors: the game has no 'gnu'; it has gun, crosshair"),
        (["policy.reward_weights={hits: 1}"], "hunter: reward_weights: the game has no 'hits'"),
        (["policies.hnter.epochs=1"], "there is no policy 'hnter'; this game and layout have hunter"),
        (["arenas=99999", "pipeline_groups=1"], "arenas is 99999, expected 1..4096"),
        (["epocs=3"], "unknown key 'epocs'"),
        (["layout=bucket-²"], "unknown layout 'bucket-²'"),
        (["policy.hidden_sizes=[0]"], "policy.hidden_sizes.0: got 0"),
        (["policy.hidden_sizes=[100"], "override 'policy.hidden_sizes=[100': '[100' is not YAML"),
        (["policy.sensors=[]"], "policy.sensors: got []"),
    ],
)
def test_a_wrong_setting_is_refused_in_one_sentence_that_names_it(more, message, simulator, tmp_path, capsys):
    address = [] if "--simulator" in more else ["--simulator", simulator]
    assert main(["train", CONFIG, "--run", str(tmp_path / "run"), *SMALL, *more, *address]) == 1
    errors = capsys.readouterr().err
    assert message in errors
    assert errors.splitlines()[-1].startswith("error: ") and "begin again" not in errors
    assert not list(Path(tmp_path).glob("run/checkpoints/*"))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["train", CONFIG, "epocs=3"], "unknown key 'epocs'; did you mean 'policy.epochs'?"),
        (["train", CONFIG, "--resume", "--run", "gone"], "gone is not the folder of a run: there is no such folder"),
        (["train", "shooting_birds/bucket-12"], "there is no configuration 'shooting_birds/bucket-12'"),
        (["train", "my_gane.yaml"], "did you mean my_game.yaml?"),
        (["train", "my_game"], "did you mean my_game.yaml?"),
        (["evaluate", "runs/frist"], "did you mean runs/first?"),
        (["evaluate", "gone"], "gone is not the folder of a run: there is no such folder"),
        (["record", "gone", "play.mp4"], "gone is not the folder of a run: there is no such folder"),
    ],
)
def test_settings_are_checked_before_a_simulator_is_waited_for(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for file in (tmp_path / "my_game.yaml", tmp_path / "runs/first/config.yaml"):
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("game: hybrid")
    assert main([*arguments, "--simulator", "127.0.0.1:1", "--wait", "100"]) == 1
    errors = capsys.readouterr().err
    assert message in errors
    assert "waiting" not in errors


@pytest.mark.parametrize(
    ("arguments", "code"),
    [
        (["gone"], "CONFIG"),
        (["run", "--simulator", "127.0.0.1:1", "--token-file", "gone"], "CREDENTIALS"),
        (["run", "--simulator", "127.0.0.1:1", "--wait", "0.01"], "SIMULATOR_LOST"),
    ],
)
def test_an_error_is_an_object_for_programs(arguments, code, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "run").mkdir()
    (tmp_path / "run/config.yaml").write_text("game: hybrid")
    save_checkpoint(tmp_path / "run", {}, Manifest(timesteps=1))
    assert main(["evaluate", *arguments, "--json"]) == 1
    output, errors = capsys.readouterr()
    said = json.loads(output.splitlines()[-1])["error"]
    assert said["code"] == code and f"error: {said['text']}\n" in errors


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["train", CONFIG, "--game", "a:B", "--simulator", "127.0.0.1:1"],
            "are for a simulator that this command starts",
        ),
        (["evaluate", "run", "--simulator", "a:1", "--simulator", "b:2"], "evaluate uses one simulator, got 2"),
        (["train", CONFIG, "--sed", "1"], "unrecognized arguments: --sed"),
        (["train", CONFIG, "--simulator", "foo"], "got 'foo', expected HOST:PORT"),
        (["train", CONFIG, "--wait", "nan"], "got 'nan', expected a positive number of seconds"),
        (["evaluate", "run", "--episodes", "0"], "got '0', expected an integer of at least 1"),
        (["evaluate", "run", "--seed", "-1"], "--seed"),
        (["record", "run", "play.mp4", "--seconds", "-1"], "--seconds"),
    ],
)
def test_wrong_arguments_end_with_the_usage(arguments, message, capsys):
    with pytest.raises(SystemExit, match="2"):
        main(arguments)
    assert message in capsys.readouterr().err
