"""A run says with what it was made, in its folder and in its checkpoints; tables show all runs of a folder."""

import json
import shlex
import shutil
import sys
from importlib.metadata import version
from pathlib import Path

import pytest

from joybridge.cli import main
from joybridge.commands.runs import main as runs_main
from joybridge.config.config import Config, HandConfig
from joybridge.config.errors import ConfigError
from joybridge.config.policy_config import PolicyConfig
from joybridge.run.checkpoint import load_checkpoint, save_checkpoint
from joybridge.run.folder import keep_config, keep_spec, run_config, run_spec
from joybridge.run.origin import FILE, differences, files_mark, keep_origin, own_origin, remark, run_origins
from joybridge.run.results import _varied, find_runs, load, read_run
from joybridge.run.train import train
from joybridge.run.training import Audience

pytestmark = pytest.mark.usefixtures("signals")

ROOT = Path(__file__).parents[1]
SMALL = PolicyConfig(frame_stack=1, hidden_sizes=[8], rollout_steps=16, time_horizon=16, minibatch_size=32)


@pytest.fixture(scope="module")
def runs(simulator, tmp_path_factory):
    """Return a folder with two runs of different games, one of them deeper."""
    folder = tmp_path_factory.mktemp("runs")
    for name, game, layout in (("a", "hybrid", "bucket-3"), ("deep/b", "duel", "hybrid")):
        config = Config(game=game, layout=layout, arenas=4, total_timesteps=128, log_interval=64, policy=SMALL)
        train(config, folder / name, [simulator], resume=False, audience=Audience(say=lambda text: None))
    return folder


def test_a_run_and_its_checkpoints_say_with_what_they_were_made(runs):
    (origin,) = run_origins(runs / "a")
    assert origin == own_origin() == load_checkpoint(runs / "a")[1].origin
    assert origin.packages["torch"] == version("torch") and origin.joybridge == version("joybridge")
    assert origin.python == sys.version.split()[0] and origin.cores > 0 and origin.processor
    assert len(origin.commit.removesuffix("-dirty")) == (40 if (ROOT / ".git").exists() else 0)
    assert origin.command == shlex.join(sys.argv)


def test_files_that_pip_has_copied_from_a_checkout_have_a_mark_that_follows_from_them_alone():
    lines = ["joybridge/cli.py,sha256=abc,12", "joybridge/run/train.py,sha256=def,34"]
    mark = files_mark("\n".join(lines))
    assert len(mark) == len("files-") + 16
    of_this_place = [
        "../../../bin/joybridge,sha256=xyz,1",
        "joybridge/__pycache__/cli.pyc,,",
        "joybridge-0.1.0/RECORD,,",
    ]
    assert files_mark("\n".join([*of_this_place, *reversed(lines)])) == mark
    assert files_mark("\n".join(lines).replace("def", "deg")) != mark and files_mark("") == ""


def test_a_training_that_continues_is_noted_once(runs, tmp_path, monkeypatch):
    run = shutil.copytree(runs / "a", tmp_path / "a")
    keep_origin(run)
    assert len(run_origins(run)) == 1
    later = own_origin().model_copy(update={"command": "joybridge train --resume"})
    monkeypatch.setattr("joybridge.run.origin.own_origin", lambda: later)
    keep_origin(run)
    keep_origin(run)
    assert [one.command for one in run_origins(run)] == [own_origin().command, "joybridge train --resume"]
    (run / FILE).write_text("[1]")
    with pytest.raises(ConfigError, match=r"origin.json cannot be read \(.*; delete it"):
        keep_origin(run)


def test_secrets_are_left_out_of_the_environment(monkeypatch):
    monkeypatch.setenv("JOYBRIDGE_SECRET_WORD", "x")
    monkeypatch.setenv("JOYBRIDGE_MARK", "y")
    monkeypatch.setenv("EDITOR", "z")
    noted = own_origin.__wrapped__().environment
    assert noted["JOYBRIDGE_MARK"] == "y" and {"JOYBRIDGE_SECRET_WORD", "EDITOR"}.isdisjoint(noted)


def test_what_differs_is_named_computing_packages_first():
    here = own_origin()
    others = {name: "0" for name in list(here.packages)[:9] if name != "numpy"}
    packages = here.packages | others | {"numpy": "1.0", "unheard-of": "7"}
    trained = here.model_copy(update={"packages": packages, "joybridge": "0.0.1"})
    first, second, *rest = differences(trained)
    assert (first, second) == (f"joybridge 0.0.1 (here {here.joybridge})", f"numpy 1.0 (here {version('numpy')})")
    assert rest[-1] == "unheard-of 7 (here missing)"
    assert f", and {len(rest) - 1} more packages: numbers may differ" in remark(trained, most=3)
    assert remark(here) == "" and remark(None) == ""


def test_evaluate_warns_of_a_run_that_was_trained_otherwise(runs, simulator, tmp_path, capsys):
    command = ["evaluate", str(runs / "a"), "--episodes", "1", "--simulator", simulator]
    assert main(command) == 0
    assert "trained with" not in capsys.readouterr().err
    run = shutil.copytree(runs / "a", tmp_path / "a")
    arrays, manifest = load_checkpoint(run)
    older = own_origin().model_copy(update={"python": "3.0.0"})
    shutil.rmtree(run / "checkpoints")
    save_checkpoint(run, arrays, manifest.model_copy(update={"origin": older}))
    assert main(["evaluate", str(run), *command[2:]]) == 0
    assert f"trained with python 3.0.0 (here {own_origin().python}): numbers may differ\n" in capsys.readouterr().err


def test_evaluate_warns_of_rules_of_another_version(runs, simulator, tmp_path, capsys):
    run = shutil.copytree(runs / "a", tmp_path / "a")
    spec = run_spec(run)
    spec.version = "1b"
    keep_spec(spec, run)
    assert main(["evaluate", str(run), "--episodes", "1", "--simulator", simulator]) == 0
    assert "; version= (trained with 1b)\n" in capsys.readouterr().err


def test_runs_lists_what_a_folder_holds_and_what_cannot_be_read(runs, tmp_path, capsys):
    folder = shutil.copytree(runs, tmp_path / "runs")
    shutil.copytree(folder / "a", folder / "broken")
    (folder / "broken" / "config.yaml").write_text("game: [")
    assert runs_main(["runs", str(folder)]) == 0
    head, a, broken, b = capsys.readouterr().out.splitlines()
    assert head.split()[:4] == ["run", "game", "layout", "seed"] and a.split()[:4] == ["a", "hybrid", "bucket-3", "0"]
    assert "128 of 128" in a and own_origin().commit[:8] in a
    assert broken.startswith("broken  cannot be read: ") and b.split()[:3] == ["deep/b", "duel", "hybrid"]
    assert runs_main(["runs", str(folder), "--json"]) == 0
    assert [json.loads(line)["run"] for line in capsys.readouterr().out.splitlines()] == ["a", "broken", "deep/b"]
    shutil.rmtree(folder / "a" / "checkpoints")  # as of a training that has begun a moment ago
    assert runs_main(["runs", str(folder / "a")]) == 0 and "128 of 128" in capsys.readouterr().out
    assert runs_main(["runs", str(tmp_path / "deep")]) == 1
    assert "holds no run" in capsys.readouterr().err


def test_all_metrics_are_a_frame_of_pandas(runs):
    frame = load(runs)
    assert set(frame.policy) == {"player", "runner", "judge"} and set(frame.run) == {"a", "deep/b"}
    rows = sum(len(rows) for run in find_runs(runs) for rows in read_run(run).rows.values())
    assert len(frame) == rows > 5
    assert list(frame.columns[:6]) == ["run", "game", "layout", "seed", "policy", "timesteps"]  # they differ in no more
    assert frame[frame.policy == "player"].presses.notna().all() and frame[frame.game == "duel"].presses.isna().all()


def test_keys_in_which_runs_differ_are_columns(runs, tmp_path):
    shutil.copytree(runs, tmp_path, dirs_exist_ok=True)
    policy = SMALL.model_copy(update={"hidden_sizes": [8, 8]})
    late = run_config(tmp_path / "a").model_copy(update={"hand": HandConfig(delay=3), "policy": policy})
    keep_config(late, tmp_path / "a")
    frame = load(tmp_path)
    columns = ["run", "hand.delay", "policy.hidden_sizes"]
    values = frame[columns].drop_duplicates().to_numpy().tolist()
    assert values == [["a", 3, "[8, 8]"], ["deep/b", 0, "[8]"]]
    assert list(frame.columns).index("hand.delay") < list(frame.columns).index("timesteps")


def test_runs_may_differ_in_the_form_of_a_value():
    names = [{"size": {"uniform": [0.5, 1]}}, {"size": {"uniform": [0.5, 2]}}, {"size": 0.5}]
    sizes = [[8, 8], [8, 9], [8]]
    configs = [
        Config(game="archer", parameters=one, policy={"hidden_sizes": other})
        for one, other in zip(names, sizes, strict=True)
    ]
    configs[0] = configs[0].model_copy(update={"policy": PolicyConfig(hidden_sizes=[8, 8], loss="my_loss:pull")})
    assert [each["policy.loss"] for each in _varied(configs)] == ["my_loss:pull", "none", "none"]
    keys = ("parameters.size.uniform", "parameters.size", "policy.hidden_sizes")
    assert [[each.get(key) for key in keys] for each in _varied(configs)] == [
        ["[0.5, 1.0]", None, "[8, 8]"],
        ["[0.5, 2.0]", None, "[8, 9]"],
        [None, 0.5, "[8]"],
    ]
