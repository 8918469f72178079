"""The measures of behavior on made-up episodes with known results, and both tools on real runs."""

import json
import math
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from PIL import Image

from joybridge.client.client import describe
from joybridge.config.config import load_config
from joybridge.config.errors import ConfigError
from joybridge.play import playing
from joybridge.policy.stratify import balanced_options
from joybridge.run.folder import run_config
from joybridge.run.train import train
from tools.paper import behavior, birds, videos
from tools.paper.behavior import Trace, add_measures, beastly_rivals, lap_radius, measure, shooting_birds

CONFIGS = Path(__file__).parents[1] / "configs"
SMALL = ["arenas=6", "total_timesteps=60", "log_interval=60", "policy.rollout_steps=10", "policy.time_horizon=10"]


def trace(ended, seconds=0.1, sensors=None, pressed=None, metrics=None, groups=1) -> Trace:
    return Trace(seconds, sensors or {}, pressed or {}, np.array(ended, bool), metrics or {}, groups)


def ends(decisions, lanes, *places) -> np.ndarray:
    """Return where episodes end: after the last decision of every lane, and at `places`, (decision, lane) each."""
    ended = np.zeros((decisions, lanes), bool)
    ended[-1] = True
    for place in places:
        ended[place] = True
    return ended


def circle(decisions, lanes, radius, lap) -> np.ndarray:
    """Return places on a circle, a lap of so many decisions, each lane's somewhere else and begun elsewhere on it."""
    angle = 2 * np.pi * np.arange(decisions)[:, None] / lap + np.arange(lanes)
    return np.stack([radius * np.cos(angle) + np.arange(lanes), radius * np.sin(angle) - 3.0], axis=-1)


# ------------------------------------------------------------------------------------------------------ lap radius


@pytest.mark.parametrize(("radius", "lap"), [(5.0, 100), (2.0, 25)])
def test_whole_laps_on_a_circle_have_its_radius_at_any_place(radius, lap):
    points = lap_radius(trace(ends(300, 3)), circle(300, 3, radius, lap))
    assert points == [[5.0, pytest.approx(radius)], [15.0, pytest.approx(radius)], [25.0, pytest.approx(radius)]]


def test_standing_has_lap_radius_0_a_straight_walk_that_of_a_rod_and_almost_a_lap_almost_its_own():
    ((_, nearly),) = lap_radius(trace(ends(100, 3)), circle(100, 3, 7.0, 110))
    assert 6.8 < nearly < 7.0
    standing = np.ones((100, 3, 2))
    assert lap_radius(trace(ends(100, 3)), standing) == [[5.0, 0.0]]
    walk = standing * np.arange(100)[:, None, None] / 100 * 8.0  # 8 along either axis
    ((_, radius),) = lap_radius(trace(ends(100, 3)), walk)
    assert radius == pytest.approx(8.0 * math.sqrt(2) / math.sqrt(12), rel=1e-3)


def test_lap_radius_is_measured_over_the_time_of_the_episode():
    places = circle(200, 3, 1.0, 50)
    places[120:] *= 4.0
    # Everybody dies after 120 decisions: the second episode, too, begins at 0, and never sees its first window's end.
    dies = [(119, lane) for lane in range(3)]
    assert lap_radius(trace(ends(200, 3, *dies)), places) == [[5.0, pytest.approx(1.0)]]
    dies = [(99, lane) for lane in range(3)]
    ((_, mixed),) = lap_radius(
        trace(ends(200, 3, *dies)), circle(200, 3, 1.0, 50) * np.repeat([1, 4], 100)[:, None, None]
    )
    assert mixed == pytest.approx(2.5)


def test_a_window_counts_if_three_episodes_last_through_it():
    ended = ends(300, 4, (150, 0))
    assert [seconds for seconds, _ in lap_radius(trace(ended), circle(300, 4, 1.0, 50))] == [5.0, 15.0, 25.0]
    ended[150, 1] = True
    assert [seconds for seconds, _ in lap_radius(trace(ended), circle(300, 4, 1.0, 50))] == [5.0]


# -------------------------------------------------------------------------------------------------- Beastly Rivals


def play(shape, seconds, sensors, buttons, metrics) -> dict[str, Any]:
    """Return a play [decisions, lanes] in which nothing happens. sensors: their values, by name."""
    return {
        "ended": ends(*shape),
        "seconds": seconds,
        "sensors": {name: np.full((*shape, len(values)), values) for name, values in sensors.items()},
        "pressed": {name: np.zeros(shape, bool) for name in buttons},
        "metrics": {name: np.full(shape, np.nan) for name in metrics},
    }


def rivals(decisions=12, lanes=3) -> dict[str, Any]:
    sensors = {"character": [0.0] * 4, "cursor": [0.0] * 4, "slow_sphere": [1.0] * 4}
    return play((decisions, lanes), 0.12, sensors, ("move", "blink"), ("survival", "blinks"))


def test_a_decision_with_either_button_or_both_is_one_command():
    made = rivals()
    made["pressed"]["move"][::4] = True
    made["pressed"]["blink"][::6] = True
    assert beastly_rivals(trace(**made))["commands_per_decision"] == pytest.approx(4 / 12, abs=1e-4)  # 0, 4, 6, 8


def test_blinks_and_survival_are_means_over_episodes_and_a_clock_is_survived_by_its_only_episode():
    made = rivals(lanes=4)
    made["ended"][[3, 7, 5], [0, 0, 2]] = True
    made["metrics"]["survival"][[3, 11, 11, 11], [0, 0, 1, 2]] = 4, 8, 12, 12
    made["metrics"]["blinks"][[3, 11, 11, 11], [0, 0, 1, 2]] = 0, 1, 2, 3
    measures = beastly_rivals(trace(**made))
    assert measures["survival_seconds"] == pytest.approx(9 * 0.12) and measures["blinks_per_episode"] == 1.5
    assert measures["clocks_survived"] == 0.5


def test_time_in_the_slow_sphere_and_the_same_by_chance():
    made = rivals()
    made["sensors"]["character"][:, 0, :2] = 6.0 / 7.0, 0.0
    made["sensors"]["slow_sphere"][:, 0, :2] = 2.9 / 7.0, 0.0  # around (3.1, 0): arena 0 is inside all the time
    made["sensors"]["slow_sphere"][:6, 1, :2] = 0.0, 3.1 / 7.0  # around (0, -3.1), and later around (-7, -7)
    made["sensors"]["slow_sphere"][:6, 2, :2] = -6.0 / 7.0, 1.0 / 7.0  # around (6, -1): not here, but where arena 0 is
    measures = beastly_rivals(trace(**made))
    assert measures["slow_share"] == pytest.approx(1 / 3, abs=1e-4)
    assert measures["slow_share_by_chance"] == pytest.approx(1 / 6, abs=1e-4)
    made["sensors"]["slow_sphere"][:, 0, 0] = 3.1 / 7.0  # just outside
    assert beastly_rivals(trace(**made))["slow_share"] == 0.0


# -------------------------------------------------------------------------------------------------- Shooting Birds


def shooter(decisions=40, lanes=2) -> dict[str, Any]:
    sensors = {"crosshair": [0.0] * 5, "gun": [1.0] * 2}
    return play((decisions, lanes), 0.02, sensors, ("shoot",), ("hits", "click_accuracy"))


def test_speeds_are_in_units_per_second_whatever_their_sign():
    made = shooter()
    made["sensors"]["crosshair"][::2, :, 2:] = 0.6, -0.8, 0.5
    made["sensors"]["crosshair"][1::2, :, 2:] = -0.8, 0.6, 1.0
    measures = shooting_birds(trace(**made))
    assert measures["abs_vx"] == pytest.approx((15 + 40) / 2) and measures["abs_vy"] == pytest.approx((20 + 30) / 2)


def test_shots_are_timed_within_episodes_and_an_empty_gun_does_not_shoot():
    made = shooter()
    made["pressed"]["shoot"][3::10] = True
    assert shooting_birds(trace(**made))["seconds_between_shots"] == pytest.approx(0.2)
    made["sensors"]["gun"][13, :, 0] = 0.0
    assert shooting_birds(trace(**made))["seconds_between_shots"] == pytest.approx((0.4 + 0.2) / 2)
    made["ended"][20] = True  # 3 | 23, 33
    assert shooting_birds(trace(**made))["seconds_between_shots"] == pytest.approx(0.2)
    made["pressed"]["shoot"][:] = False
    assert shooting_birds(trace(**made))["seconds_between_shots"] is None


def test_hits_are_counted_per_level():
    made = shooter(lanes=6)
    made["metrics"]["hits"][-1] = 10, 20, 1, 3, 5, 5
    made["metrics"]["click_accuracy"][-1] = 0.5, 1.0, 1.0, 1.0, 0.5, 0.5
    measures = shooting_birds(trace(**made, groups=3))
    assert measures["hits_per_level"] == [15.0, 2.0, 5.0] and measures["click_accuracy"] == 0.75


# ---------------------------------------------------------------------------------------------------- files and runs


def test_the_longer_trained_run_stays_in_the_file(tmp_path, capsys):
    path = tmp_path / "deep" / "behavior.json"
    add_measures(path, "ferry/hybrid-s0", {"timesteps": 30, "x": 1})
    assert add_measures(path, "ferry/hybrid-s0", {"timesteps": 20, "x": 2})["ferry/hybrid-s0"]["x"] == 1
    assert "ferry/hybrid-s0: kept the measures after 30 timesteps" in capsys.readouterr().err
    add_measures(path, "ferry/hybrid-s0", {"timesteps": 30, "x": 3})
    add_measures(path, "ferry/hybrid-s1", {"timesteps": 1, "x": 4})
    assert {name: entry["x"] for name, entry in json.loads(path.read_text()).items()} == {
        "ferry/hybrid-s0": 3,
        "ferry/hybrid-s1": 4,
    }


@pytest.fixture(scope="module")
def runs(simulator, tmp_path_factory) -> dict[str, Path]:
    """Return a run of each game that has hardly begun."""
    made = {}
    for game in ("shooting_birds", "beastly_rivals"):
        made[game] = tmp_path_factory.mktemp(game) / "bucket-3-s0"
        config = load_config(CONFIGS / game / "bucket-3.yaml", SMALL)
        train(config, made[game], [simulator], resume=False)
    return made


@pytest.mark.slow
@pytest.mark.nightly
def test_the_tool_measures_real_runs_of_both_games(runs, simulator, tmp_path, capsys, monkeypatch):
    config = run_config(runs["shooting_birds"])
    levels = balanced_options(config, describe(simulator, config.game, {}))
    assert list(levels) == list("0123456")
    fewer = {level: levels[level] for level in "26"}
    monkeypatch.setattr(birds, "EPISODE_TICKS", 200)
    monkeypatch.setattr(playing, "balanced_options", lambda config, _: fewer if config.stratify_by else {"": {}})
    output = tmp_path / "behavior.json"
    assert behavior.main([*map(str, runs.values()), "--episodes", "4", "--output", str(output)]) == 0
    found = json.loads(output.read_text())
    assert list(found) == ["beastly_rivals/bucket-3-s0", "shooting_birds/bucket-3-s0"]
    rivals, shooter = found.values()
    assert shooter["episodes"] == 4 and shooter["timesteps"] == rivals["timesteps"] == 60
    assert len(shooter["hits_per_level"]) == 2 and {"side_changes", "half_hidden_hits", "dense_hits"} <= set(shooter)
    # Untrained, 3 values per axis: speed is 50 in two of three, its angle -90°, 0° or 90°.
    assert shooter["abs_vx"] == pytest.approx(50 * 2 / 3 / 3, rel=0.15)
    assert shooter["abs_vy"] == pytest.approx(50 * 2 / 3 * 2 / 3, rel=0.15)
    # It presses shoot and reload in a third of the decisions each, so the gun is hardly ever empty for long.
    assert shooter["seconds_between_shots"] == pytest.approx(0.06, rel=0.1)
    assert 0.0 <= shooter["click_accuracy"] < 0.1
    assert rivals["episodes"] > 4 and 1.0 < rivals["survival_seconds"] < 60.0
    assert rivals["commands_per_decision"] == pytest.approx(2 / 3, abs=0.05)  # move, blink, nothing
    assert rivals["blinks_per_episode"] > 0
    assert 0.0 < rivals["slow_share"] < 1.0
    assert rivals["lap_radius"] and all(0.0 < radius < 8.0 for _, radius in rivals["lap_radius"])
    assert "bucket-3-s0" in capsys.readouterr().out
    assert (tmp_path / "figures" / "behavior.png").stat().st_size > 10_000
    again = measure(runs["beastly_rivals"], simulator, episodes=4, seed=1)
    assert again == ("beastly_rivals/bucket-3-s0", rivals)


@pytest.mark.slow
@pytest.mark.nightly
def test_birds_that_are_hit_are_replaced_at_the_edge(runs, monkeypatch):
    monkeypatch.setattr(birds, "EPISODE_TICKS", 300)
    field = birds.watch(runs["shooting_birds"], episodes=8, seed=1)
    assert field.crosshair.shape == (300, 14, 2)
    hits, jumps = field.hits[:-1], abs(np.diff(field.birds, axis=0)).max(axis=-1) > 1.0
    assert hits.sum() >= 3 and jumps[hits].mean() > 0.8  # those that are hit at the edge appear near it again
    assert (abs(field.birds[1:][hits][:, 0]) > 19.0).all() and jumps.sum() < hits.sum() + 10  # the others flew out
    assert not field.hidden[field.size == 0].any() and 0.1 < (field.hidden[field.size == 2] > 0.5).mean() < 0.5
    assert (field.hidden[field.hits] < 1.0).all()


def test_a_game_without_measures_is_refused_by_name(simulator, tmp_path):
    (tmp_path / "config.yaml").write_text("game: ferry")
    with pytest.raises(ConfigError, match="plays ferry; behavior is measured in shooting_birds and beastly_rivals"):
        measure(tmp_path, simulator, episodes=1, seed=1)


@pytest.mark.slow
@pytest.mark.nightly
def test_videos_of_the_best_runs_are_small_and_play(runs, tmp_path):
    output = tmp_path / "videos"
    assert videos.main([str(runs["beastly_rivals"]), "--seconds", "0.4", "--output", str(output)]) == 0
    with av.open(str(output / "beastly_rivals-bucket-3.mp4")) as video:
        pictures = [picture.to_ndarray(format="rgb24") for picture in video.decode(video=0)]
        assert video.streams.video[0].codec_context.name == "h264"
    assert len(pictures) == 10 and {picture.shape for picture in pictures} == {(360, 480, 3)}
    assert (pictures[0] != pictures[-1]).any()
    with Image.open(output / "beastly_rivals.webp") as moving:
        assert (getattr(moving, "n_frames", 1), moving.size, moving.info["loop"]) == (5, (480, 360), 0)
    assert max(path.stat().st_size for path in output.iterdir()) < 100_000


def test_the_best_of_several_runs_has_the_highest_reward_at_the_end(tmp_path):
    for name, layout, rewards in (("a", "hybrid", (9, 1)), ("b", "hybrid", (0, 5)), ("c", "bucket-3", (3, 3))):
        run = tmp_path / name
        run.mkdir()
        (run / "config.yaml").write_text(f"{{game: ferry, layout: {layout}}}")
        late = [rewards[1]] * videos.ROWS
        (run / "metrics-x.csv").write_text("timesteps,reward\n" + "".join(f"1,{r}\n" for r in (rewards[0], *late)))
    found = [tmp_path / name for name in "abc"]
    assert videos.best(found, "game", "layout") == {("ferry", "hybrid"): found[1], ("ferry", "bucket-3"): found[2]}
    assert videos.best(found, "game") == {("ferry",): found[1]}
