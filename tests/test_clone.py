"""`joybridge clone` learns from demonstrations alone, says how well, and leaves a run that is trained further."""

import re
from functools import partial

import numpy as np
import pytest

from joybridge.cli import main as trainer
from joybridge.client.client import Session
from joybridge.client.simulator_source import last_simulators
from joybridge.commands import clone
from joybridge.commands.clone import main
from joybridge.config.metrics import read_rows
from joybridge.contract.codec import StepArrays
from joybridge.demonstrations.recorded import RecordedEpisodes
from joybridge.demonstrations.returns import discounted_returns
from joybridge.layouts import make_acts
from joybridge.play.agent import load
from joybridge.progress import Progress
from joybridge.run.folder import run_config
from tests.support.demonstrated import record

pytestmark = pytest.mark.usefixtures("signals")

SMALL = [
    "policy={frame_stack: 1, hidden_sizes: [16], rollout_steps: 16, time_horizon: 16, minibatch_size: 32, "
    "learning_rate: 1.0e-2}"
]


@pytest.fixture(scope="module")
def demos(simulator, tmp_path_factory):
    """Record somebody who presses the button on the right, and pushes with a force that grows to the right."""
    folder = tmp_path_factory.mktemp("demos")
    with Session(simulator, "hybrid", arenas=8, seed=5, options={"masks": "off"}) as session:
        session.record_demonstration(folder)
        (act,) = make_acts(session.spec, 8)
        for _ in range(100):
            right = session.steps[0].observations[0][:, 0] / 3
            act.axes[:, 0], act.axes[:, 1] = 0.0, np.clip(1.25 + 0.75 * right, 0.5, 2.0)
            act.choices[:, 1] = right > 0
            session.step([act])
    return folder


def test_one_episode_is_cloned_whole_also_for_rewards_that_it_does_not_know(simulator, tmp_path, capsys):
    with Session(simulator, "hybrid", arenas=1, seed=5) as session:
        session.record_demonstration(tmp_path / "demos")
        ended = 0
        while not ended:
            ended = len(session.step(make_acts(session.spec, 1))[0].ended)
    weights, place = "policy.reward_weights={lives: -1}", ["--gym", "CartPole-v1"]
    command = [
        "clone",
        str(tmp_path / "demos"),
        "--passes",
        "2",
        "--run",
        str(tmp_path / "run"),
        *place,
        *SMALL,
        weights,
    ]
    assert main(command) == 0
    printed = capsys.readouterr()
    assert ", with nothing held out of one episode\n" in printed.out and "nan" not in printed.out
    assert "the demonstrations have no reward lives, so the critic does not learn to expect it" in printed.err
    assert run_config(tmp_path / "run").policy.reward_weights == {}
    assert last_simulators(tmp_path / "run").simulators.games == ("gym:CartPole-v1",)


@pytest.mark.parametrize("memory", ["none", "gru"])  # whose sequences are shorter than the episodes
def test_a_clone_does_what_is_demonstrated_and_is_measured_on_episodes_it_has_not_seen(
    memory, demos, simulator, tmp_path, capsys
):
    run, more = tmp_path / "clone", [*SMALL, f"policy.memory.kind={memory}", "policy.memory.length=8"]
    assert main(["clone", str(demos), "--layout", "bucket-11", "--run", str(run), *more]) == 0
    printed = capsys.readouterr()
    learned, held_out = re.findall(r"([\d,]+) decisions of", printed.err)
    assert int(learned) > 5 * int(held_out) > 50
    (force, off, _), (press, same, most) = re.findall(r"^  (force|press) +([\d.]+)% .*? ([\d.]+)%", printed.out, re.M)
    assert (force, press) == ("force", "press")
    assert float(off) < 6 and float(same) > 95 > float(most)
    agent, seen = load(run, deterministic=True), {"count": [1], "image": [[0, 0]] * 2, "lamps": [1, 0, 0]}
    assert agent.act({"place": [2.5, 0.0], **seen})["press"] == 1
    agent.begin()
    assert agent.act({"place": [-2.5, 0.0], **seen})["press"] == 0
    assert trainer(["train", str(run / "config.yaml"), "--run", str(run), "--resume", "--simulator", simulator]) == 1
    assert (
        "no training to go on with, as that of a clone; begin a new run with it, by --from" in capsys.readouterr().err
    )


def test_a_button_that_no_observation_tells_is_named_with_what_would_tell_it(simulator, tmp_path, capsys):
    folder = tmp_path / "demos"
    with Session(simulator, "hybrid", arenas=8, seed=5, options={"masks": "off"}) as session:
        session.record_demonstration(folder)
        (act,) = make_acts(session.spec, 8)
        for decision in range(100):
            act.choices[:, 1] = decision % 2  # is pressed and released in turns
            session.step([act])
    said = {}
    for acts in (0, 1):
        more = [*SMALL, f"policy.remember_acts={acts}", "--run", str(tmp_path / f"run-{acts}")]
        assert main(["clone", str(folder), "--passes", "30", *more]) == 0
        said[acts] = capsys.readouterr()
    (button,) = re.findall(r"\n  (\w+) +\d+\.\d%", said[1].out)[-1:]
    assert f"not learned: {button}. What the policy sees may not show when: policy.remember_acts=1 " in said[0].err
    assert "not learned" not in said[1].err


def test_what_a_layout_cannot_say_of_the_held_out_episodes_is_said_beside_the_shares(simulator, tmp_path, capsys):
    with Session(simulator, "hard_move", arenas=8, seed=5) as session:
        session.record_demonstration(tmp_path / "demos")
        (act,) = make_acts(session.spec, 8)
        for number in range(150):
            act.axes[:] = 0.25
            act.choices[:, :2] = number % 3 != 0, number % 3 == 2  # two buttons in each third decision
            session.step([act])
    command = ["clone", str(tmp_path / "demos"), "--passes", "1", "--run", str(tmp_path / "run"), *SMALL]
    assert main([*command, "--layout", "bucket-5"]) == 0
    printed = capsys.readouterr()
    said = int(re.findall(r"([\d,]+) decisions of \d+ others are held out", printed.err)[0].replace(",", ""))
    unsaid, total = re.findall(
        r"^not counted: (\d+) of (\d+) held-out decisions, which bucket-5 cannot", printed.out, re.M
    )[0]
    assert int(unsaid) == int(total) - said and 0.3 < int(unsaid) / int(total) < 0.37


def test_a_clone_knows_its_game_and_is_trained_further(demos, simulator, tmp_path, capsys):
    run, file = tmp_path / "clone", tmp_path / "hybrid.yaml"
    file.write_text(
        "game: hybrid\nlayout: hybrid\narenas: 2\ntotal_timesteps: 64\nlog_interval: 64\n"
        f"{SMALL[0].replace('=', ': ')}\n"
    )
    command = ["clone", str(demos), "--config", str(file), "--passes", "2", "--run", str(run)]
    assert main(command) == 0
    config = run_config(run)
    assert (config.game, config.options, config.demonstrations) == ("hybrid", {"masks": "off"}, str(demos))
    assert (
        trainer(["train", str(file), "--from", str(run), "--run", str(tmp_path / "on"), "--simulator", simulator]) == 0
    )
    assert f"begins with the policies of {run} after 0 timesteps" in capsys.readouterr().out
    assert main(command) == 1
    assert "already holds a run" in capsys.readouterr().err


def test_the_same_seed_clones_the_same_and_the_best_pass_is_kept(demos, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(clone, "Progress", partial(Progress, seconds=0.0))  # every pass says how far it is
    arrays = []
    for name in ("a", "b"):
        assert main(["clone", str(demos), "--passes", "30", "--run", str(tmp_path / name), *SMALL]) == 0
        arrays.append(next((tmp_path / name).rglob("arrays.safetensors")).read_bytes())
    assert arrays[0] == arrays[1]
    out, err = capsys.readouterr()
    kept = float(re.findall(r"held out (-?[\d.]+)", out)[0])
    assert kept <= min(float(loss) for loss in re.findall(r"held out (-?[\d.]+)", err))


@pytest.mark.parametrize("more", ["shared_body=true", "shared_body=false", "memory.kind=gru", "scale_rewards=true"])
def test_the_critic_of_a_clone_predicts_what_is_earned(more, demos, simulator, tmp_path, capsys):
    run, config = tmp_path / "clone", tmp_path / "clone" / "config.yaml"
    assert main(["clone", str(demos), "--run", str(run), "--layout", "bucket-5", *SMALL, f"policy.{more}"]) == 0
    (explained,) = re.findall(r"^critic: explains (\d+)% of how much held-out", capsys.readouterr().out, re.M)
    assert int(explained) > 10
    once = ["total_timesteps=128", "log_interval=128", "arenas=8", "policy.normalize_advantage=none"]
    found = {}
    for name, begin in (("on", ["--from", str(run)]), ("anew", [])):
        command = ["train", str(config), "--run", str(tmp_path / name), "--simulator", simulator, *once, *begin]
        assert trainer([*command, "demonstrations=null"]) == 0
        (row,) = read_rows(tmp_path / name / "metrics-player.csv")
        found[name] = row["explained_variance"], row["value_loss"]
    assert found["on"][0] > max(0.1, found["anew"][0]) and found["on"][1] < found["anew"][1]


def test_returns_are_discounted_where_a_lane_decides_and_end_with_its_episode():
    def step(rewards, terminated=(False, False), truncated=(False, False), deciding=(True, True)):
        earned = np.array(rewards)[:, None]
        return [StepArrays([], earned, np.array(terminated), np.array(truncated), None, np.array(deciding))]

    steps = [
        step([9.0, 9.0]),  # of what was before
        step([1.0, 10.0], deciding=(True, False)),
        step([2.0, 20.0], terminated=(True, False)),
        step([4.0, 40.0]),
        step([8.0, 80.0], truncated=(True, True)),
    ]
    stretch = RecordedEpisodes(steps, [[]] * 4, [None] * 4)
    returns = discounted_returns(stretch, 0, lambda step: step.rewards[:, 0], 0.5)
    assert returns[:, 0].tolist() == [2.0, 2.0, 8.0, 8.0]
    assert returns[:, 1].tolist() == [10 + 60.0, 20 + 0.5 * 80.0, 80.0, 80.0]


def test_an_interruption_keeps_the_best_pass_so_far(demos, tmp_path, capsys, monkeypatch):
    class Interrupting(Progress):
        def report(self, text):
            if "pass 3:" in text:
                raise KeyboardInterrupt

    assert main(["clone", str(demos), "--passes", "3", "--run", str(tmp_path / "a"), *SMALL]) == 0
    monkeypatch.setattr(clone, "Progress", Interrupting)
    assert main(["clone", str(demos), "--passes", "30", "--run", str(tmp_path / "b"), *SMALL]) == 0
    assert "interrupted: the best pass so far is kept" in capsys.readouterr().err
    whole, interrupted = (next((tmp_path / name).rglob("arrays.safetensors")).read_bytes() for name in ("a", "b"))
    assert whole == interrupted
    monkeypatch.setattr(Interrupting, "report", lambda self, text: None)
    monkeypatch.setattr("joybridge.demonstrations.supervised.minibatches", interrupt)
    assert main(["clone", str(demos), "--run", str(tmp_path / "c"), *SMALL]) == 130  # before there is a pass


def interrupt(*_):
    raise KeyboardInterrupt


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (
            ["--config", "archer/hybrid"],
            r"error: the configuration is for archer, but .* shows hybrid; name another one",
        ),
        (
            ["--config", "{same}", "options.masks=on"],
            r"error: options.masks: got 'on', but .* shows .*'off'",
        ),
        (["options.masks=on"], r"error: options.masks: got 'on', but .* shows .*'off'"),
        (["game=archer"], r"error: the configuration is for archer, but .* shows hybrid; name another one"),
        (["--layout", "bucket-x"], "error: layout: unknown layout 'bucket-x'"),
        (["policy.scale_observations=running"], "cannot be scaled alike; set it to bounds or none"),
        (["policy.learning_rate=1e30"], "the loss is not finite; take a smaller policy.learning_rate"),
    ],
)
def test_what_cannot_be_cloned_is_named(more, message, demos, tmp_path, capsys):
    run, same = tmp_path / "run", tmp_path / "same.yaml"
    same.write_text("game: hybrid\n")
    assert main(["clone", str(demos), "--run", str(run), *(word.format(same=same) for word in more)]) == 1
    assert re.search(message, capsys.readouterr().err)
    assert not (run / "config.yaml").exists()


def test_options_that_differ_from_file_to_file_are_left_to_the_configuration(simulator, tmp_path, capsys):
    for masks in ("on", "off"):
        record(tmp_path / "demos", simulator, decisions=60, arenas=4, options={"masks": masks, "size": "small"})
    command = ["clone", str(tmp_path / "demos"), "--passes", "1", *SMALL]
    assert trainer([*command, "--run", str(tmp_path / "run")]) == 0
    assert "shows several values of masks" in capsys.readouterr().err
    assert "masks" not in run_config(tmp_path / "run").options
    assert trainer([*command, "--run", str(tmp_path / "on"), "options.masks=on"]) == 0
    assert run_config(tmp_path / "on").options["masks"] == "on"


def test_a_policy_to_which_nothing_is_shown_stays_untrained(simulator, tmp_path, capsys):
    with Session(simulator, "ferry", arenas=2, seed=5) as session:
        demonstration, acts = session.record_demonstration(tmp_path / "demos"), make_acts(session.spec, 2)
        demonstration.hold([[0, 1], []])
        while not len(session.step(acts)[0].ended):
            pass
    assert trainer(["clone", str(tmp_path / "demos"), "--passes", "1", "--run", str(tmp_path / "run"), *SMALL]) == 0
    said = capsys.readouterr()
    assert "none of its decisions is demonstrated, so it stays untrained" in said.err
    load(tmp_path / "run", "lookout")


def test_a_folder_without_a_demonstration_is_named(tmp_path, capsys):
    assert main(["clone", str(tmp_path)]) == 1
    assert f"error: demonstrations: {tmp_path} holds no file *.demo" in capsys.readouterr().err


def test_options_of_a_configuration_give_way_to_the_recorded_ones_and_it_says_so(demos, tmp_path, capsys):
    config, run = tmp_path / "other.yaml", tmp_path / "run"
    config.write_text(f"game: hybrid\noptions: {{masks: 'on'}}\n{SMALL[0].replace('=', ': ', 1)}\n")
    assert main(["clone", str(demos), "--config", str(config), "--run", str(run), "--passes", "2"]) == 0
    assert "the options {'masks': 'on'} of --config are replaced" in capsys.readouterr().err
    assert run_config(run).options["masks"] == "off"


def test_held_out_episodes_that_a_layout_cannot_express_keep_nobody_from_learning_others(simulator, tmp_path, capsys):
    for number in range(4):
        with Session(simulator, "hard_move", arenas=1, seed=number) as session:
            session.record_demonstration(tmp_path / "demos")
            (act,) = make_acts(session.spec, 1)
            act.axes[:], act.choices[:, :2] = 0.25, (1, number == 0)  # in the first episode two buttons at once
            while not len(session.step([act])[0].ended):
                pass
    for seed in range(4):
        words = ["--layout", "bucket-5", "--run", str(tmp_path / str(seed)), "--passes", "1", f"seed={seed}"]
        assert main(["clone", str(tmp_path / "demos"), *words, *SMALL]) == 0, capsys.readouterr().err
