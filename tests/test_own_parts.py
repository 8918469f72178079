"""A network and a term of the loss of one's own: those of the page, in real runs, and those of a stranger in none."""

import json
import re
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from joybridge.client.client import describe
from joybridge.client.errors import SimulatorError
from joybridge.commands.train import _noting_sources
from joybridge.config.config import Config
from joybridge.config.errors import ConfigError, UntrustedRunError
from joybridge.config.metrics import read_rows
from joybridge.config.policy_config import PolicyConfig
from joybridge.layouts import make_layouts
from joybridge.policy.actor import make_actors
from joybridge.run.checkpoint import load_checkpoint
from joybridge.run.folder import play_config
from joybridge.run.others import load_other
from joybridge.run.own_code import FILE
from joybridge.run.sources import changed_sources, marks
from joybridge.simulator import axis, behavior, branch, image, sensor
from joybridge.v1 import bridge_pb2 as pb
from tests.support.command_line import joybridge
from tests.support.demonstrated import record
from tests.test_actions import POINTER
from tests.test_own_runs import COMMANDS

PAGE = Path(__file__).parents[1] / "docs" / "own-parts.md"
LAYOUTS = PAGE.with_name("layouts.md")
PLAYER = behavior(
    "player",
    sensors=[sensor("place", [2], -1, 1), sensor("grid", [3, 2], 0, 9), image("view", 6, 5)],
    axes=[axis("x")],
    branches=[branch("act", ["a", "b"])],
)
SPEC = pb.GameSpec(name="still", behaviors=[PLAYER])
OWN = """
import torch
from torch import nn

class Shapes(nn.Module):
    def __init__(self, shapes):
        super().__init__()
        self.shapes, self.layer = shapes, nn.Linear(1, 4)
    def forward(self, sensors):
        for name, shape in self.shapes.items():
            assert sensors[name].shape[1:] == shape
        assert sensors["view"].dtype == torch.uint8 and sensors["place"].dtype == torch.float32
        return self.layer(sensors["grid"][:, -1, 2, 1, None])

class Flat(Shapes):
    def forward(self, sensors):
        return torch.zeros(7)

class One(Shapes):
    def forward(self, sensors):
        return torch.ones(1, 4)

def term(outputs, log_probs, batch):
    return 0.0 * log_probs.sum()

def vector(outputs, log_probs, batch):
    return log_probs

def number(outputs, log_probs, batch):
    return 0.0

def of_nothing(outputs, log_probs, batch):
    return outputs.mean.square().mean()

def mine(device, setting):
    from joybridge.layouts import make_layouts
    return make_layouts("hybrid", device)
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Return the current folder, which holds the modules of the page and those above."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    pages = PAGE.read_text() + LAYOUTS.read_text()
    for text, name in re.findall(r"```python\n(# (\w+\.py)\n.*?)```", pages, re.DOTALL):
        Path(name).write_text(text)
    Path("parts.py").write_text(OWN)
    yield tmp_path
    for name in ("my_network", "my_loss", "my_layouts", "parts", "strange"):
        sys.modules.pop(name, None)


def trained(simulator: str, *overrides: str, run: str = "run", more: tuple[str, ...] = ()) -> None:
    settings = "arenas=4", "total_timesteps=320", "log_interval=80", "policy.rollout_steps=20", "policy.time_horizon=20"
    status, _, errors = joybridge(
        "train", "hybrid_suite/catch_point", "--run", run, "--simulator", simulator, *more, *settings, *overrides
    )
    assert status == 0, errors


def test_the_network_of_the_page_is_trained_kept_played_and_continued_to_the_same_bits(folder, simulator):
    own = "policy.network=my_network:PerSensor"
    trained(simulator, own)
    trained(simulator, own, "stop_at=160", run="parts")
    trained(simulator, own, run="parts", more=("--resume",))
    whole, continued = (load_checkpoint(Path(run))[0] for run in ("run", "parts"))
    weights = [name for name in whole if "network.encoders.0.module.layers" in name]
    assert len(weights) >= 2
    assert all(np.array_equal(whole[name], continued[name]) for name in whole if "/policy/network." in name)
    status, output, errors = joybridge("evaluate", "run", "--simulator", simulator, "--episodes", "4", "--json")
    assert status == 0, errors
    assert json.loads(output.splitlines()[-1])
    status, _, errors = joybridge("export", "run", "policy.onnx", "--simulator", simulator)
    assert status and "has a network of its own, my_network:PerSensor, which no exported file can hold" in errors
    assert "play its run with `joybridge.play.agent.load`" in errors
    status, _, errors = joybridge(
        "train", "hybrid_suite/catch_point", "--from", "run", "--run", "x", "--simulator", simulator
    )
    assert status and "network was my_network:PerSensor, now None" in errors


def test_the_term_of_the_page_has_a_figure_of_its_own_and_changes_what_is_learned(folder, simulator):
    trained(simulator)
    trained(simulator, "policy.loss=my_loss:pull", run="pulled")
    rows = read_rows(next(Path("pulled").glob("metrics-*.csv")))
    assert all(row["loss_pull"] >= 0 for row in rows if "policy_loss" in row) and any(
        "loss_pull" in row for row in rows
    )
    plain, pulled = (load_checkpoint(Path(run))[0] for run in ("run", "pulled"))
    assert any(not np.array_equal(plain[name], pulled[name]) for name in plain if "actor" in name and "network" in name)


def test_the_layout_of_the_page_is_trained_mixed_exported_and_refused_as_those_of_packages_are(folder, simulator):
    settings = "arenas=4", "total_timesteps=320", "log_interval=80", "policy.rollout_steps=20", "policy.time_horizon=20"
    place = "--simulator", simulator
    status, _, errors = joybridge(
        "train", "marble/hybrid", "--run", "run", *place, *settings, "layout=my_layouts:compass-8"
    )
    assert status == 0, errors
    status, output, errors = joybridge("evaluate", "run", *place, "--episodes", "4", "--json")
    assert status == 0 and json.loads(output.splitlines()[-1]), errors
    assert "have changed" not in errors
    assert joybridge("export", "run", "policy.json", *place).status == 0
    with Path("my_layouts.py").open("a") as file:
        file.write("# another line")
    said = "the files of my_layouts have changed since run was"
    assert f"{said} trained: numbers may differ," in joybridge("evaluate", "run", *place, "--episodes", "4").errors
    longer = joybridge("train", "run/config.yaml", "--run", "run", "--resume", "total_timesteps=400", *place)
    assert longer.status == 0 and f"{said} last trained; it goes on with them" in longer.errors
    assert "have changed" not in joybridge("evaluate", "run", *place, "--episodes", "4").errors
    Path("run/sources.json").write_text("[1]")
    assert "run/sources.json cannot be read" in joybridge("evaluate", "run", *place).errors
    for layout, message in {
        "my_layouts:compass": "expected compass-N with N directions",
        "hybrid, shoot=my_layouts:compass-3": "a compass moves two axes and presses nothing",
        "my_layouts:circle": "layout: 'my_layouts:circle' cannot be imported: AttributeError: ",
        "nothing:at-all": "layout: 'nothing:at' cannot be imported: ModuleNotFoundError: No module named 'nothing'",
    }.items():
        with pytest.raises(ConfigError, match=re.escape(message)):
            make_layouts(layout, POINTER)


@pytest.mark.parametrize("key", ["policy.network=parts:Shapes", "policy.loss=parts:term", "layout=parts:mine"])
def test_a_run_of_a_stranger_imports_nothing_that_it_names(key, folder, tmp_path, monkeypatch, simulator):
    name, _, value = key.partition("=")
    own = {"policy.network": "my_network:PerSensor", "policy.loss": "my_loss:pull", "layout": "parts:mine"}[name]
    trained(simulator, f"{name}={own}")
    play_config(Path("run"), ())
    text = Path("run/config.yaml").read_text()
    Path("run/config.yaml").write_text(text.replace(own, f"strange:{value[6:]}"))
    Path("strange.py").write_text("open('OWNED', 'w').close()\n" + OWN)
    Path("run/simulators.json").unlink()
    for words in (words for name, words in COMMANDS.items() if name != "train --from"):  # it takes weights only
        status, _, errors = joybridge(*(word.replace("RUN", "run") for word in words))
        assert status == 2 and "run wants to import strange:" in errors and "--trust-run" in errors
    status, _, errors = joybridge("train", "run/config.yaml", "--run", "new")
    assert status == 2 and "run wants to import strange:" in errors
    record(Path("demos"), simulator, "marble", 130)
    beside = "run/config.yaml"
    for others in (
        ["clone", "demos", "--config", beside, "--run", "copy"],
        ["compare", beside, "--seeds", "1", "--output", "copy"],
        ["compare", beside, "--search", "policy.gamma=0.9..0.99", "--output", "copy"],
    ):
        status, _, errors = joybridge(*others)
        assert status == 2 and "run wants to import strange:" in errors and "--trust-run" in errors, others
    with pytest.raises(UntrustedRunError, match="run wants to import strange:"):
        load_other("run", "marble", describe(simulator, "marble", {}))
    assert not Path("OWNED").exists()


def test_a_clone_with_parts_of_its_own_is_believed(folder, simulator):
    record(Path("demos"), simulator, "marble", 260)
    clone = ["clone", "demos", "--run", "copy", "--passes", "1", "policy.network=my_network:PerSensor"]
    assert joybridge(*clone).status == 0
    assert play_config(Path("copy"), ()).policy.network == "my_network:PerSensor"
    Path("copy/code.json").unlink()  # as if it were a stranger's
    again = ["clone", "demos", "--config", "copy/config.yaml", "--run", "again", "--passes", "1"]
    assert joybridge(*again).status == 2 and joybridge(*again, "--trust-run").status == 0


def test_an_own_run_that_is_moved_is_believed_but_from_another_folder_it_is_not(folder, simulator, monkeypatch):
    trained(simulator, "policy.loss=my_loss:pull")
    shutil.move("run", "moved")
    assert play_config(Path("moved"), ()).policy.loss == "my_loss:pull"
    (folder / "other").mkdir()
    monkeypatch.chdir("other")
    with pytest.raises(UntrustedRunError, match="wants to import my_loss:pull"):
        play_config(Path("../moved"), ())
    (folder / "moved" / FILE).write_text("[1")
    with pytest.raises(ConfigError, match="cannot be read"):
        play_config(Path("../moved"), ())


def actor(network: str, seed: int = 0, layout: str = "hybrid"):
    policy = PolicyConfig(network=network, frame_stack=2, hidden_sizes=[8])
    (made,) = make_actors(Config(game="still", seed=seed, layout=layout, policy=policy), SPEC)
    return made


@pytest.mark.parametrize("layout", ["hybrid", "bucket-5", "beta"])
def test_sensors_keep_their_names_and_shapes_and_the_seed_fixes_the_network(layout, folder):
    states = [actor("parts:Shapes", seed, layout).state() for seed in (3, 3, 4)]
    name = "encoders.0.module.layer.weight"
    assert np.array_equal(states[0][name], states[1][name]) and not np.array_equal(states[0][name], states[2][name])
    (encoder,) = actor("parts:Shapes", layout=layout).network.encoders
    assert encoder.module.shapes == {"place": (2, 2), "grid": (2, 3, 2), "view": (2, 6, 5, 1)}


@pytest.mark.parametrize(
    ("network", "message"),
    [
        ("nowhere:Net", "network: 'nowhere:Net' cannot be imported"),
        ("parts:term", "'parts:term' is no subclass of torch.nn.Module"),
        ("parts:Flat", r"parts:Flat returns \[7\] for two rows, expected \[2, features\]"),
        ("torch.nn:Linear", "torch.nn:Linear does not work with"),
        ("parts:One", r"parts:One returns \[1, 4\] for two rows"),
    ],
)
def test_a_network_that_cannot_work_is_refused_by_name(network, message, folder):
    with pytest.raises(ConfigError, match=message):
        actor(network)


def test_a_network_drops_nothing_when_it_acts_because_no_checkpoint_would_know_what(folder):
    (encoder,) = actor("parts:Shapes").network.encoders
    assert not encoder.module.training


@pytest.mark.parametrize(
    ("term", "message"),
    [
        ("vector", r"loss: parts:vector returned a tensor of \[\d+\], expected a tensor of one number"),
        ("number", "loss: parts:number returned float, expected a tensor of one number"),
        ("of_nothing", r"returned nan, expected a finite number; the shapes .*'mean': \[\d+, 0\]"),
    ],
)
def test_a_term_that_is_no_finite_number_is_refused_by_name(term, message, folder, simulator):
    settings = "policy.rollout_steps=20", "policy.time_horizon=20", f"policy.loss=parts:{term}", "layout=bucket-3"
    status, _, errors = joybridge("train", "hybrid_suite/catch_point", "--simulator", simulator, "arenas=4", *settings)
    assert status == 1 and re.search(message, errors)


def test_names_are_of_modules_and_terms_are_functions(folder, simulator):
    status, _, errors = joybridge("train", "hybrid_suite/catch_point", "policy.loss=os")
    assert status and "policy.loss: got 'os'" in errors
    status, _, errors = joybridge(
        "train", "hybrid_suite/catch_point", "--run", "r", "--simulator", simulator, "policy.loss=parts:Shapes"
    )
    assert status and "loss: 'parts:Shapes' is type, expected a function" in errors


def test_a_change_of_sources_is_noticed_until_something_is_saved_that_was_played_with_them(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    run, sources = Path("run"), (Path("run"), ["reach_game:Reach"], Config(game="reach"))
    run.mkdir()
    Path("reach_game.py").write_text("REACH = 0.1")
    with _noting_sources(*sources):
        pass
    Path("reach_game.py").write_text("REACH = 0.3")
    with pytest.raises(SimulatorError), _noting_sources(*sources):
        raise SimulatorError("the episode of arena 0 is over before its 69 decisions")
    said = capsys.readouterr().err
    assert "the files of reach_game have changed since run was last trained" in said
    assert "begin new ones with the same policy: --from run" in said
    assert changed_sources(*sources) == ["reach_game"]
    with _noting_sources(*sources):
        (run / "checkpoints" / "000000000064").mkdir(parents=True)
    assert changed_sources(*sources) == []


def test_a_change_of_what_a_game_imports_from_its_folder_is_noticed(folder):
    Path("crane_game.py").write_text("import json, numpy\nimport crane_rules as rules\n")
    Path("crane_rules.py").write_text("def load():\n    from crane_parts.rope import LENGTH\n    import crane_game\n")
    Path("crane_parts").mkdir()
    Path("crane_parts/__init__.py").touch()
    rope, hook = Path("crane_parts/rope.py"), Path("crane_hook.py")
    rope.write_text("LENGTH = 1")
    hook.write_text("from crane_rules import load")
    program = f"pygame:{folder}/crane_game.py hook=crane_hook.py"
    games = ["gym:crane_game:Crane-v0", program]
    modules = "crane_game", "crane_parts", "crane_rules"
    files = "crane_game.py", "crane_parts", "crane_rules.py"
    before = marks(games, [])
    assert set(before) == {*modules, "crane_hook.py", *files[::2], *(f"{folder}/{name}" for name in files)}
    rope.write_text("LENGTH = 2")
    after = marks(games, [])
    assert {name for name in before if before[name] != after[name]} == {"crane_parts", f"{folder}/crane_parts"}
    hook.write_text("def (")
    assert {*modules, "crane_hook.py"} <= set(marks(games, []))
