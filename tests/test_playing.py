"""A trained policy plays elsewhere: under other options and parameters, at other simulators, in every kind of file."""

import json
import re
import sys
from itertools import pairwise
from types import SimpleNamespace
from typing import cast

import av
import numpy as np
import pytest
from scipy.stats import ttest_1samp

from joybridge.cli import main
from joybridge.client.simulator_source import FILE, SimulatorSource, last_simulators, remember
from joybridge.config.config import Config
from joybridge.config.policy_config import PolicyConfig
from joybridge.play.evaluate import _half_widths, _matches
from joybridge.play.sweep import Results, plot, read_sweep
from joybridge.run.train import train
from tests.support.command_line import joybridge
from tests.support.games import PLACES

pytestmark = pytest.mark.usefixtures("signals")

SMALL = PolicyConfig(frame_stack=2, hidden_sizes=[8], rollout_steps=16, time_horizon=16, minibatch_size=32)


@pytest.fixture(scope="module")
def run(simulator, tmp_path_factory):
    """Return a run that has hardly begun."""
    folder = tmp_path_factory.mktemp("playing") / "run"
    config = Config(game="hybrid", arenas=4, total_timesteps=64, log_interval=64, policy=SMALL)
    train(config, folder, [simulator], resume=False)
    return folder


def evaluate(run, simulator, capsys, *more):
    """Return what an evaluation prints as JSON, and its messages."""
    assert main(["evaluate", str(run), "--episodes", "8", "--json", "--simulator", simulator, *more]) == 0
    printed = capsys.readouterr()
    return json.loads(printed.out.splitlines()[-1]), printed


def test_a_policy_is_evaluated_under_other_parameters_and_options_and_says_what_differs(run, simulator, capsys):
    before, printed = evaluate(run, simulator, capsys)
    assert before["player"]["changed"] == {} and "trained with" not in printed.err
    after, printed = evaluate(run, simulator, capsys, "parameters.drift=0", "--seed", "1", "options.masks=off")
    assert after["player"]["changed"] == {
        "options.masks": {"trained": "on", "played": "off"},
        "parameters.drift": {"trained": 1.0, "played": 0.0},
    }
    assert "; options.masks=off (trained with on); parameters.drift=0 (trained with 1)\n" in printed.err
    assert f"next: joybridge record {run} play.mp4" in printed.err
    assert after["player"]["means"]["length"] > before["player"]["means"]["length"]  # without drift nobody leaves


@pytest.mark.parametrize("episodes", [1, 7, 64, 70])
def test_as_many_episodes_are_played_as_are_asked_for_and_each_return_is_told(episodes, run, simulator, capsys):
    (report, printed) = evaluate(run, simulator, capsys, "--episodes", str(episodes))
    played = report["player"]
    assert played["episodes"] == len(played["returns"]) == episodes
    assert played["means"]["reward"] == pytest.approx(np.mean(played["returns"]), rel=1e-6)
    assert f"player: {episodes} episodes after" in printed.out


def test_one_episode_has_no_interval(run, simulator, capsys):
    report, printed = evaluate(run, simulator, capsys, "--episodes", "1")
    assert set(report["player"]["half_widths"].values()) == {None}
    assert printed.out.count(" ± ?") == len(report["player"]["means"]) and "nan" not in printed.out.lower()


def test_fewer_episodes_than_there_are_choices_to_play_equally_often_are_refused(simulator, tmp_path, capsys):
    config = Config(
        game="shooting_birds", arenas=4, stratify_by="level", policy=SMALL, total_timesteps=64, log_interval=64
    )
    train(config, tmp_path, [simulator], resume=False)
    command = ["evaluate", str(tmp_path), "--simulator", simulator, "--episodes"]
    assert main([*command, "6"]) == 1
    assert "got 6 episodes, expected at least one for each of the 7 choices of level" in capsys.readouterr().err


def test_the_first_line_says_how_actions_are_chosen(run, simulator, capsys):
    _, printed = evaluate(run, simulator, capsys)
    first = "policy after 64 timesteps, sampled actions (--deterministic: the most probable)\n"
    assert printed.err.startswith(first)
    _, printed = evaluate(run, simulator, capsys, "--deterministic")
    assert printed.err.startswith("policy after 64 timesteps, the most probable actions\n")


def test_chance_plays_as_it_does_under_any_layout_and_is_called_so(run, simulator, tmp_path, capsys):
    first, printed = evaluate(run, simulator, capsys, "--random")
    assert printed.err.startswith("random play\n") and "player: 8 episodes of random play" in printed.out
    assert first["player"]["random"] and evaluate(run, simulator, capsys, "--random")[0] == first
    assert evaluate(run, simulator, capsys)[0]["player"]["returns"] != first["player"]["returns"]
    config = Config(game="hybrid", layout="multiagent", arenas=4, total_timesteps=64, log_interval=64, policy=SMALL)
    train(config, tmp_path, [simulator], resume=False)
    two, _ = evaluate(tmp_path, simulator, capsys, "--random")
    axes, buttons = two.values()
    assert axes["means"]["length"] == buttons["means"]["length"]  # one device, and one who presses at random
    for option in (["--deterministic"], ["--checkpoint", "64"]):
        with pytest.raises(SystemExit):
            main(["evaluate", str(run), "--random", *option])
        assert "--random is not the policy; leave out --deterministic and --checkpoint" in capsys.readouterr().err


def test_each_agent_of_an_arena_has_episodes_and_short_ones_count_no_more_often(simulator, tmp_path, capsys):
    config = Config(game="duel", arenas=4, total_timesteps=64, log_interval=64, policy=SMALL)
    train(config, tmp_path, [simulator], resume=False)
    report, _ = evaluate(tmp_path, simulator, capsys, "--episodes", "70")
    assert {name: played["episodes"] for name, played in report.items()} == {"runner": 140, "judge": 70}


def test_a_parameter_that_is_set_as_an_option_is_named(run, simulator, capsys):
    assert main(["record", str(run), "play.mp4", "options.drift=0.5", "--simulator", simulator]) == 1
    wanted = "error: options.drift: it is a parameter of hybrid; write parameters.drift=VALUE\n"
    assert capsys.readouterr().err.endswith(wanted)


def test_what_is_set_as_in_the_training_is_no_difference(run, simulator, capsys):
    report, _ = evaluate(run, simulator, capsys, "parameters.drift=1", "options.size=small")
    assert report["player"]["changed"] == {}


def test_an_option_that_changes_the_sensors_is_refused_with_what_does_not_fit(run, simulator, capsys):
    assert main(["evaluate", str(run), "options.size=large", "--simulator", simulator]) == 1
    wanted = "the sensors had 20 numbers, now 32 (2 frames of place 2, count 1, image 10, lamps 3)"
    assert f"error: player: the trained network does not fit: {wanted}\n" in capsys.readouterr().err


def test_a_parameter_is_swept_into_a_table_a_plot_and_json(run, simulator, capsys):
    report, printed = evaluate(run, simulator, capsys, "--over", "parameters.drift=0,0.5,2", "--figures", "pdf")
    assert list(report) == ["parameters.drift=0", "parameters.drift=0.5", "parameters.drift=2"]
    lengths = [report[setting]["player"]["means"]["length"] for setting in report]
    assert lengths == sorted(lengths, reverse=True) and lengths[0] > lengths[2]
    alone, _ = evaluate(run, simulator, capsys, "parameters.drift=2")
    assert alone == report["parameters.drift=2"]
    head, *rows = printed.out.splitlines()[1:5]
    assert head.split() == ["parameters.drift", "reward", "length", "game_length", "presses"]
    assert [row.split()[0] for row in rows] == ["0", "0.5", "2"]
    assert f"{lengths[2]:.3f} ± " in rows[2]
    assert printed.out.splitlines()[5] == str(run / "over-parameters.drift.png")
    assert (run / "over-parameters.drift.png").read_bytes()[:4] == b"\x89PNG"
    figure = run / "over-parameters.drift.pdf"
    assert printed.out.splitlines()[6] == str(figure) and b"/FontFile2" in figure.read_bytes()  # text stays text


@pytest.mark.parametrize(
    "over", ["parameters.drift=0,0.25,0.5,8", "options.sight=all that there is,the screen of the game,some squares"]
)
def test_what_is_below_a_panel_does_not_overlap(over):
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    sweep = read_sweep(over)
    played = {"player": SimpleNamespace(means={"reward": 1.0, "hits": 2.0}, half_widths={"reward": 0.1, "hits": 0.2})}
    figure = plot(sweep, cast(Results, dict.fromkeys(sweep.settings, played)))
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    for axes in figure.axes[:2]:
        labels = [label for label in axes.get_xticklabels() if label.get_text()]
        angles = {label.get_rotation() for label in labels}
        ends = [label.get_window_extent(canvas.get_renderer()) for label in labels]
        apart = [one.x1 < other.x0 for one, other in pairwise(ends)]
        assert all(apart) or (angles == {30.0} and {label.get_horizontalalignment() for label in labels} == {"right"})


def test_without_matplotlib_a_sweep_prints_its_table_and_names_the_extra(run, simulator, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    report, printed = evaluate(run, simulator, capsys, "--over", "options.masks=on,off")
    assert list(report) == ["options.masks=on", "options.masks=off"]
    assert "pip install 'joybridge[report]'" in printed.err
    assert not (run / "over-options.masks.png").exists()


def test_a_hand_with_several_limits_is_one_value(run, simulator, capsys):
    report, printed = evaluate(run, simulator, capsys, "--over", "hand={delay: 0, reach: 1},{delay: 2, reach: 0.5}")
    assert [*report] == ["hand={delay: 0, reach: 1}", "hand={delay: 2, reach: 0.5}"]
    assert report["hand={delay: 2, reach: 0.5}"]["player"]["changed"]["hand.delay"] == {"trained": 0, "played": 2}
    assert (run / "over-hand.png").exists() and "{delay: 0, reach: 1} " in printed.out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["evaluate", "layout=bucket-3"], "layout belongs to the training of .* written options.NAME=CHOICE, para"),
        (["evaluate", "size=0.5"], "unknown key 'size'; .* written options.NAME=CHOICE"),
        (["evaluate", "parameters.drift=much"], "parameters.drift: got 'much'"),
        (["evaluate", "--over", "drift=1,2"], "--over got 'drift=1,2', expected options.NAME=CHOICE,… or parameters"),
        (["evaluate", "--over", "parameters.drift"], "as in parameters.size=0.5,1,2"),
        (["evaluate", "--over", "parameters.drift=1,,2"], "as in parameters.size=0.5,1,2"),
        (["evaluate", "--over", "parameters.drift=1,1"], "names a value twice"),
        (["evaluate", "--over", "parameters.drift=1,1.0"], "names a value twice"),
        (["record", "play.avi"], "play.avi: unknown video format '.avi', expected .mp4, .mkv, .mov, .gif"),
        (["record", "play"], "play: unknown video format ''"),
        (["record", "play.mp4", "arenas=3"], "arenas belongs to the training"),
    ],
)
def test_what_cannot_be_played_is_refused_before_a_simulator_is_waited_for(arguments, message, run, capsys):
    command, *rest = arguments
    assert main([command, str(run), *rest, "--simulator", "127.0.0.1:1"]) == 1
    errors = capsys.readouterr().err
    assert re.search(message, errors), errors
    assert "waiting" not in errors


@pytest.mark.parametrize(
    ("over", "message"),
    [
        ("parameters.drift=0,99", "parameters.drift: got 99, expected 0.."),
        ("options.masks=on,of", "option 'masks' got 'of', expected one of"),
    ],
)
def test_the_last_value_is_checked_before_the_first_is_played(over, message, run, simulator, capsys):
    assert main(["evaluate", str(run), "--over", over, "--simulator", simulator]) == 1
    errors = capsys.readouterr().err
    assert message in errors and "policy after" not in errors


def test_a_run_is_played_at_the_simulators_of_its_training_if_these_have_the_game(run, simulator, capsys, tmp_path):
    remember(run, SimulatorSource((simulator,)), print)
    assert main(["evaluate", str(run), "--episodes", "1"]) == 0
    assert f"simulator: {simulator}, as in the training" in capsys.readouterr().err
    remember(run, SimulatorSource(("127.0.0.1:1",), (PLACES[0],)), print)
    assert main(["record", str(run), str(tmp_path / "play.gif"), "--seconds", "1", "parameters.drift=0.5"]) == 0
    errors = capsys.readouterr().err
    assert "the simulator of the training cannot be used: no simulator at 127.0.0.1:1" in errors
    assert "parameters.drift=0.5 (trained with 1)" in errors
    with av.open(str(tmp_path / "play.gif")) as video:
        pictures = [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]
    shades = [np.unique(picture[..., 0]).tolist() for picture in pictures]  # the game's pictures have one color each
    assert len(shades) == 10 and all(len(shade) == 1 for shade in shades) and len({*map(tuple, shades)}) > 5
    assert main(["record", str(run), str(tmp_path / "short.gif"), "--seconds", "0.001"]) == 0
    assert (tmp_path / "short.gif").exists() and "short.gif: 1 frames" in capsys.readouterr().out
    remember(run, SimulatorSource(), print)
    assert not (run / FILE).exists() and last_simulators(run).simulators == SimulatorSource()


@pytest.mark.parametrize(("text", "reason"), [("[1]", "Input should be"), ('{"count": "x"}', "count: Input should be")])
def test_a_damaged_memory_of_simulators_is_named(text, reason, run, capsys):
    (run / FILE).write_text(text)
    assert main(["evaluate", str(run)]) == 1
    assert f"{run / FILE} cannot be read ({reason}" in capsys.readouterr().err
    (run / FILE).unlink()


def test_intervals_are_those_of_the_t_distribution():
    rng = np.random.default_rng(0)
    group = rng.normal(size=(5, 2))
    (low, high) = ttest_1samp(group, 0).confidence_interval()
    np.testing.assert_allclose(_half_widths([group]), (high - low) / 2)
    held = 0
    for _ in range(400):  # two choices that differ in how much they vary and in their episodes
        groups = [rng.normal(1, 3, (4, 1)), rng.normal(2, 1, (3, 1))]
        held += abs(np.mean([group.mean() for group in groups]) - 1.5) <= _half_widths(groups)[0]
    assert 0.92 < held / 400 < 0.98
    assert np.isnan(_half_widths([group, group[:1]])).all()
    assert (_half_widths([np.ones((3, 2))]) == 0).all()


def test_agents_of_a_match_count_as_one_in_intervals():
    finished = np.array([[0, 1, 5], [2, 7, 9], [1, 3, 5], [0, 2, 4], [3, 9, 9], [1, 4, 4]], float)  # two arenas of two
    assert _matches(finished, 2)[:, 1:].tolist() == [[2, 5], [3, 4], [8, 9]]
    assert _matches(finished, 1) is finished


def test_a_policy_without_a_seat_in_so_few_episodes_is_named(simulator, tmp_path):
    small = ["arenas=2", "total_timesteps=64", "policy.rollout_steps=16", "policy.minibatch_size=16"]
    run = ["train", "ferry/hybrid", "--run", str(tmp_path), "--simulator", simulator, *small]
    assert joybridge(*run).status == 0
    done = joybridge("evaluate", str(tmp_path), "--others", str(tmp_path), "--episodes", "1", "--simulator", simulator)
    assert done.status == 1 and "in 1 episodes, others have held all seats of " in done.errors
