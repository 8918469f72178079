"""Measures of inputs on sequences with known answers, and on a run that was trained and plays with a limited hand."""

import json
import math
from itertools import pairwise

import numpy as np
import pytest

from joybridge.cli import main
from joybridge.config.config import Config
from joybridge.config.policy_config import PolicyConfig
from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.layouts.device_names import rest_choice
from joybridge.play.input_statistics import InputMeasures, Inputs
from joybridge.run.train import train
from joybridge.v1 import bridge_pb2 as pb

SECONDS = 0.1


def device(axes: dict[str, tuple[float, float]] | None = None, *branches: list[str], names: str = "abc") -> pb.Device:
    return pb.Device(
        axes=[pb.Axis(name=name, low=low, high=high) for name, (low, high) in (axes or {}).items()],
        branches=[pb.Branch(name=name, choices=choices) for name, choices in zip(names, branches, strict=False)],
    )


BUTTON = ["released", "pressed"]
POSITION = device({"x": (0.0, 10.0), "y": (0.0, 10.0)}, BUTTON)
VELOCITY = device({"velocity_x": (-2.0, 2.0), "velocity_y": (-2.0, 2.0)}, BUTTON)
POLAR = device({"angle": (-1.0, 1.0), "speed": (-1.0, 1.0)}, BUTTON)


def measure(made: pb.Device, axes=None, choices=None, *, seconds=SECONDS, deciding=None, ended=()) -> Inputs:
    """Measure sequences: axes [decisions, lanes, axes], choices and deciding [decisions, lanes(, branches)].

    ended: (decision, lane) each.
    """
    decisions, lanes = np.shape(axes if axes is not None else choices)[:2]
    axes = np.zeros((decisions, lanes, 0)) if axes is None else np.asarray(axes)
    choices = np.zeros((decisions, lanes, len(made.branches))) if choices is None else np.asarray(choices)
    measures = InputMeasures(pb.Behavior(name="player", device=made), seconds, lanes)
    for t in range(decisions):
        act = ActArrays(axes[t].astype(np.float32), choices[t].astype(np.int32))
        last = np.array([lane for at, lane in ended if at == t], np.int32)
        over = np.isin(np.arange(lanes), last)
        quiet = np.zeros((lanes, 1), np.float32)
        before = StepArrays([], quiet, ~over, ~over, deciding=None if deciding is None else deciding[t])
        measures.add(before, act, StepArrays([], quiet, over, np.zeros(lanes, bool), ended=last))
    return measures.result()


def pressed(decisions: int, *times: int, lanes: int = 1) -> np.ndarray:
    """Return a button that is pressed at these times, [decisions, lanes, 1]."""
    choices = np.zeros((decisions, lanes, 1))
    choices[list(times)] = 1
    return choices


def along(*corners: tuple[float, float], steps: int) -> np.ndarray:
    """Return places on the way from corner to corner, so many steps per side, [decisions, 1, 2]."""
    sides = [np.linspace(a, b, steps, endpoint=False) for a, b in pairwise(corners)]
    return np.concatenate([*sides, [corners[-1]]])[:, None]


# ---------------------------------------------------------------------------------------------------------- clicks


def test_regular_clicks_have_their_rate_and_their_interval():
    found = measure(POSITION, np.zeros((600, 3, 2)), pressed(600, *range(0, 600, 20), lanes=3))
    assert (found.decisions, found.decision_seconds) == (1800, SECONDS)
    for branch in ("", ".a"):
        assert found.measures[f"clicks_per_minute{branch}"] == pytest.approx(30.0)
        assert found.measures[f"click_interval_median_seconds{branch}"] == pytest.approx(2.0)
        assert found.measures[f"click_interval_p5_seconds{branch}"] == pytest.approx(2.0)


def test_intervals_have_the_median_and_the_percentile_of_what_was_played():
    pauses = np.random.default_rng(0).integers(2, 30, 100)
    times = np.concatenate([[3], 3 + pauses.cumsum()])
    found = measure(device(None, BUTTON), None, pressed(times[-1] + 1, *times)).measures
    assert found["click_interval_median_seconds"] == pytest.approx(np.median(pauses) * SECONDS)
    assert found["click_interval_p5_seconds"] == pytest.approx(np.percentile(pauses, 5) * SECONDS)


def test_a_button_that_is_held_is_clicked_once_and_another_branch_has_its_own_rate():
    choices = np.zeros((100, 1, 2))
    choices[10:40, 0, 0] = choices[60:62, 0, 0] = 1
    choices[20, 0, 1] = choices[60, 0, 1] = 1
    found = measure(device(None, BUTTON, BUTTON), None, choices).measures
    assert found["clicks_per_minute.a"] == found["clicks_per_minute.b"] == pytest.approx(12.0)
    assert found["clicks_per_minute"] == pytest.approx(18.0)  # of 10, 20 and 60; two at once are one
    assert found["click_interval_median_seconds"] == pytest.approx(2.5)
    assert found["click_interval_median_seconds.a"] == pytest.approx(5.0)
    assert found["click_interval_median_seconds.b"] == pytest.approx(4.0)
    assert found["hold_median_seconds.a"] == pytest.approx(1.6) and found["hold_p5_seconds.a"] == pytest.approx(0.34)
    assert found["hold_median_seconds.b"] == found["hold_p5_seconds.b"] == pytest.approx(0.1)
    assert "hold_median_seconds" not in found


def test_each_change_to_another_choice_is_a_click_unless_its_name_says_that_it_does_nothing():
    walk = np.array([1, 0, 0, 2, 1, 2, 2, 0])[:, None, None]  # stay, left, left, right, stay, right, right, left
    found = measure(device(None, ["left", "stay", "right"]), None, walk, seconds=0).measures
    assert found["clicks_per_1000_decisions.a"] == pytest.approx(1000 * 4 / 8)
    cells = measure(device(None, ["a1", "a2", "a3"]), None, walk, seconds=0).measures  # none does nothing
    assert cells["clicks_per_1000_decisions.a"] == pytest.approx(1000 * 6 / 8)
    assert rest_choice(["left", "stay", "right"]) == 1 and rest_choice(["a1", "a2"]) is None


def test_no_interval_and_no_path_reaches_from_one_episode_into_the_next():
    places = np.array([[0, 0], [1, 0], [9, 9], [9, 8]], float)[:, None]
    choices = pressed(4, 0, 1, 2, 3)
    choices[1] = 0
    held = measure(POSITION, places, choices).measures
    assert held["clicks_per_minute"] == pytest.approx(60 / SECONDS * 2 / 4)
    over = measure(POSITION, places, choices, ended=[(1, 0), (2, 0)]).measures
    assert over["clicks_per_minute"] == pytest.approx(60 / SECONDS * 3 / 4)  # still pressed, in a new episode
    assert "click_interval_median_seconds" not in over and "path_efficiency.x+y" not in over
    assert over["diagonal_bias.x+y"] == -0.5  # the only movement was along x


def test_what_is_held_when_an_episode_ends_has_no_duration():
    let_go = pressed(4, 0, 1, 2)
    whole = measure(device(None, BUTTON), None, let_go).measures
    assert whole["hold_median_seconds.a"] == pytest.approx(3 * SECONDS)
    parts = measure(device(None, BUTTON), None, let_go, ended=[(1, 0)]).measures
    assert parts["hold_median_seconds.a"] == pytest.approx(SECONDS)


def test_where_a_lane_waits_nothing_is_measured_and_no_time_passes():
    rng = np.random.default_rng(3)
    axes, choices = rng.uniform(0, 10, (200, 1, 2)), rng.integers(0, 2, (200, 1, 1))
    alone = measure(POSITION, axes, choices)
    turns = np.zeros((400, 1), bool)
    turns[::2] = True
    between = np.repeat(axes, 2, axis=0), np.repeat(choices, 2, axis=0)
    between[0][1::2], between[1][1::2] = rng.uniform(0, 10, (200, 1, 2)), rng.integers(0, 2, (200, 1, 1))
    assert measure(POSITION, *between, deciding=turns) == alone
    assert measure(POSITION, *between).measures != alone.measures


# ------------------------------------------------------------------------------------------------------------ paths


def test_a_straight_path_is_efficient_and_half_a_square_and_half_a_circle_are_less_so():
    clicks = pressed(41, 0, 40)
    straight = measure(POSITION, along((1, 1), (9, 5), steps=40), clicks)
    assert straight.pointers == {"x+y": "position"}
    assert straight.measures["path_efficiency.x+y"] == pytest.approx(1.0)
    square = measure(POSITION, along((1, 1), (9, 1), (9, 9), steps=20), clicks).measures
    assert square["path_efficiency.x+y"] == pytest.approx(math.sqrt(2) / 2)
    angle = np.linspace(0, math.pi, 41)
    circle = np.stack([5 + 4 * np.cos(angle), 5 + 4 * np.sin(angle)], axis=1)[:, None]
    found = measure(POSITION, circle, clicks).measures
    assert found["path_efficiency.x+y"] == pytest.approx(2 / math.pi, rel=1e-3)
    assert abs(found["diagonal_bias.x+y"]) < 0.02
    whole = measure(POSITION, along((1, 1), (9, 1), (9, 9), (1, 9), (1, 1), steps=10), clicks).measures
    assert whole["path_efficiency.x+y"] == pytest.approx(0.0, abs=1e-6)


def test_the_same_path_by_velocities_and_by_angles_has_the_same_measures():
    rng = np.random.default_rng(1)
    steps, clicks = rng.uniform(-1, 1, (150, 12, 2)), rng.integers(0, 2, (150, 12, 1))
    steps[:, :, 0] = np.abs(steps[:, :, 0]) * np.sign(steps[:, :, 1])  # in two quadrants only
    steps /= np.maximum(1.0, np.linalg.norm(steps, axis=-1, keepdims=True))
    by_velocity = measure(VELOCITY, 2.0 * steps, clicks)
    side = np.where(steps[..., 0] < 0, -1.0, 1.0)  # a negative speed reverses
    angle = np.arctan(steps[..., 1] / steps[..., 0]) / (math.pi / 2)
    by_angle = measure(POLAR, np.stack([angle, side * np.linalg.norm(steps, axis=-1)], axis=-1), clicks)
    assert by_velocity.pointers == {"velocity_x+velocity_y": "movement"}
    assert by_angle.pointers == {"angle+speed": "movement"}
    assert list(by_velocity.measures.values()) == pytest.approx(list(by_angle.measures.values()), rel=1e-4)
    places = np.concatenate([np.zeros((1, 12, 2)), steps.cumsum(axis=0)])
    wide = device({"x": (-500.0, 500.0), "y": (-500.0, 500.0)}, BUTTON)
    by_place = measure(wide, places, np.concatenate([np.zeros((1, 12, 1)), clicks])).measures
    for name in ("path_efficiency", "diagonal_bias"):
        velocity = by_velocity.measures[f"{name}.velocity_x+velocity_y"]
        assert by_place[f"{name}.x+y"] == pytest.approx(velocity, rel=1e-4), name


def test_a_square_path_along_the_axes_or_the_diagonals_is_biased_and_isotropic_motion_is_not():
    square = along((1, 1), (9, 1), (9, 9), (1, 9), (1, 1), steps=10)
    assert measure(POSITION, square).measures["diagonal_bias.x+y"] == pytest.approx(-0.5)
    diamond = along((5, 1), (9, 5), (5, 9), (1, 5), (5, 1), steps=10)
    assert measure(POSITION, diamond).measures["diagonal_bias.x+y"] == pytest.approx(0.5)
    rng = np.random.default_rng(2)
    angle, length = rng.uniform(0, 2 * math.pi, (100, 400)), rng.uniform(0, 2, (100, 400))
    isotropic = np.stack([length * np.cos(angle), length * np.sin(angle)], axis=-1)
    assert abs(measure(VELOCITY, isotropic).measures["diagonal_bias.velocity_x+velocity_y"]) < 0.01
    # Two axes that are chosen by themselves, each anywhere in its range, are faster along the diagonals.
    each = measure(VELOCITY, rng.uniform(-2, 2, (100, 400, 2))).measures["diagonal_bias.velocity_x+velocity_y"]
    near, whole = (
        (math.tan(end) / math.cos(end) + math.asinh(math.tan(end))) / 2 for end in (math.pi / 8, math.pi / 4)
    )
    assert each == pytest.approx(0.5 - near / whole, abs=0.01) and each > 0.1  # integrals of the length over the angle


def test_times_that_follow_fittss_law_have_its_slope_and_its_fit():
    distances = np.random.default_rng(4).integers(1, 100, 24)
    pauses = np.round(10 * np.log2(distances / 5 + 1) + 5).astype(int)
    places, times, now = [0.0], [0], 0
    for number, (distance, pause) in enumerate(zip(distances, pauses, strict=True)):
        aim = places[-1] + (distance if number % 2 else -distance)
        places += np.linspace(places[-1], aim, pause + 1)[1:].tolist()
        times.append(now := now + pause)
    path = np.stack([places, np.zeros(len(places))], axis=1)[:, None]
    made = device({"x": (-50.0, 50.0), "y": (-50.0, 50.0)}, BUTTON)  # a target is 5 wide, 1/20 of the range
    clicks = pressed(len(places), *times)
    found = measure(made, path, clicks).measures
    assert found["fitts_seconds_per_bit.x+y"] == pytest.approx(10 * SECONDS, rel=0.02)
    assert found["fitts_r2.x+y"] > 0.995
    assert measure(made, path, clicks, seconds=0).measures["fitts_decisions_per_bit.x+y"] == pytest.approx(10, rel=0.02)
    regular = measure(made, path, pressed(len(places), *range(0, len(places), 10))).measures
    assert abs(regular["fitts_seconds_per_bit.x+y"]) < 1e-9 and "fitts_r2.x+y" not in regular


# -------------------------------------------------------------------------------------------------------- reversals


def test_an_axis_reverses_as_often_as_a_wave_and_a_stop_is_no_reversal():
    time = np.arange(500)[:, None] + 0.5
    wave = np.stack([np.sin(2 * math.pi * time / 50), np.zeros_like(time)], axis=-1)
    by_velocity = measure(VELOCITY, wave).measures
    assert by_velocity["reversals_per_second.velocity_x"] == pytest.approx(19 / 50)  # ten waves in 50 s
    assert by_velocity["reversals_per_second.velocity_y"] == 0.0
    by_place = measure(POSITION, 5 + wave).measures
    assert by_place["reversals_per_second.x"] == pytest.approx(20 / 50)
    assert by_place["reversals_per_second.y"] == 0.0
    stops = np.array([1, 0, 0, 1, 0, -1, 0, 0, 1, 0], float)
    axis = np.stack([stops, np.zeros(10)], axis=1)[:, None]
    assert measure(VELOCITY, axis, seconds=0).measures["reversals_per_1000_decisions.velocity_x"] == 200.0


def test_axes_of_which_no_name_says_anything_are_a_stick_and_one_alone_is_no_pointer():
    rng = np.random.default_rng(5)
    found = measure(device({"left": (0.0, 1.0), "right": (0.0, 4.0), "lift": (0.0, 1.0)}), rng.random((9, 2, 3)))
    assert found.pointers == {"left+right": "stick"}
    assert [name for name in found.measures if "lift" in name] == ["reversals_per_second.lift"]
    assert not any("click" in name or "fitts" in name for name in found.measures)


# ------------------------------------------------------------------------------------------------------------- runs

SMALL = PolicyConfig(hidden_sizes=[8], rollout_steps=16, time_horizon=16, minibatch_size=32)


@pytest.fixture(scope="module")
def run(simulator, tmp_path_factory):
    """Return a run with two policies for one device that has hardly begun."""
    folder = tmp_path_factory.mktemp("inputs") / "run"
    config = Config(game="hybrid", layout="multiagent", arenas=4, total_timesteps=64, log_interval=64, policy=SMALL)
    train(config, folder, [simulator], resume=False)
    return folder


def evaluate(run, simulator, capsys, *more):
    """Return what an evaluation prints as JSON, and all lines."""
    assert main(["evaluate", str(run), "--episodes", "8", "--json", "--simulator", simulator, *more]) == 0
    lines = capsys.readouterr().out.splitlines()
    return json.loads(lines[-1]), lines


@pytest.mark.usefixtures("signals")
def test_evaluate_measures_inputs_where_it_is_asked_to_and_prints_a_device_once(run, simulator, capsys):
    report, lines = evaluate(run, simulator, capsys)
    assert {result["inputs"] for result in report.values()} == {None}
    assert not any("inputs of" in line for line in lines)
    report, lines = evaluate(run, simulator, capsys, "--inputs")
    axes, buttons = report.values()  # the two policies of one device
    assert axes["behavior"] == buttons["behavior"] == "player" and axes["inputs"] == buttons["inputs"]
    assert axes["inputs"]["decision_seconds"] == pytest.approx(0.1) and axes["inputs"]["pointers"] == {}
    (heading,) = (line for line in lines if "inputs of" in line)
    assert heading == f"inputs of player: at least {axes['inputs']['decisions']:,} decisions of 0.1 s"
    rate = axes["inputs"]["measures"]["clicks_per_minute.press"]
    assert any(line.split() == ["clicks_per_minute.press", f"{rate:.3f}"] for line in lines)


@pytest.mark.usefixtures("signals")
def test_a_hand_that_holds_its_buttons_is_seen_in_rates_and_intervals(run, simulator, capsys):
    more = ["--inputs", "--episodes", "40", "--over", "hand.hold=1,2,4"]
    report, lines = evaluate(run, simulator, capsys, *more)
    found = [next(iter(result.values()))["inputs"]["measures"] for result in report.values()]
    rates = [measures["clicks_per_minute.press"] for measures in found]
    assert rates == sorted(rates, reverse=True) and rates[2] < rates[0] / 1.2
    for measures, hold in zip(found, (1, 2, 4), strict=True):
        assert measures.get("click_interval_p5_seconds.press", math.inf) >= 2 * hold * 0.1 - 1e-6
    start = next(index for index, line in enumerate(lines) if "inputs of" in line)
    assert lines[start + 1].split() == ["hand.hold=1", "hand.hold=2", "hand.hold=4"]
