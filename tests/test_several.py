"""One policy that plays several games: what it sees and does in each, and a run from its training to a video."""

import json
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from joybridge.client.client import Session
from joybridge.client.several_session import SeveralSession
from joybridge.config.config import load_config, make_config
from joybridge.config.errors import ConfigError
from joybridge.config.metrics import read_rows
from joybridge.contract.codec import ActArrays
from joybridge.demonstrations.of_games import load_translated
from joybridge.demonstrations.recorded import load_recorded
from joybridge.layouts import make_acts
from joybridge.policy.common_observation import common_sensors
from joybridge.policy.episodes import Episodes
from joybridge.policy.hand import pointer_speeds
from joybridge.policy.lineup import arenas_by_game, kinds_of, make_lineup
from joybridge.ppo.return_scale import ReturnScale
from joybridge.run.checkpoint import load_checkpoint
from joybridge.run.folder import changes
from joybridge.simulator import image, sensor
from joybridge.v1 import bridge_pb2 as pb
from tests.support.command_line import joybridge
from tests.support.demonstrated import record

TWO = Path(__file__).parents[1] / "configs" / "several" / "two.yaml"


def test_pictures_get_one_size_and_one_color_and_numbers_one_length():
    wide, high = image("screen", 2, 4, channels=3), image("screen", 4, 2)
    games = {"wide": [wide], "high": [sensor("place", [2], 0, 10), high], "blind": [sensor("one", [1])]}
    sensors, views = common_sensors(games, dict.fromkeys(games), tell_game=True)
    assert {s.name: list(s.shape) for s in sensors} == {"screen": [4, 4, 1], "numbers": [2], "known": [2], "game": [3]}
    white = np.full((1, 2, 4, 3), 255, np.uint8)
    screen, numbers, known, game = views["wide"].see([white])
    assert screen[0, :, :, 0].tolist() == [[0] * 4, [255] * 4, [255] * 4, [0] * 4]
    assert (numbers.tolist(), known.tolist(), game.tolist()) == ([[0, 0]], [[False, False]], [[1, 0, 0]])
    gray = np.arange(8, dtype=np.uint8).reshape(1, 4, 2, 1)
    screen, numbers, known, game = views["high"].see([np.array([[0, 7.5]], np.float32), gray])
    assert screen[0, :, :, 0].tolist() == [[0, 0, 1, 0], [0, 2, 3, 0], [0, 4, 5, 0], [0, 6, 7, 0]]
    assert (numbers.tolist(), known.tolist(), game.tolist()) == ([[-1, 0.5]], [[True, True]], [[0, 1, 0]])
    _, numbers, known, _ = views["blind"].see([np.array([[7]], np.float32)])
    assert (numbers.tolist(), known.tolist()) == ([[7, 0]], [[True, False]])  # without bounds it stays as it is


def test_arenas_are_divided_by_the_shares_with_one_for_each_game_at_least():
    games = {"a": {"share": 2.0}, "b": {}, "c": {"share": 0.01}}
    config = make_config({"games": games, "arenas": 9, "pipeline_groups": 1})
    assert arenas_by_game(config) == [[5, 3, 1]]
    config = make_config({"games": {"a": {"share": 2.0}, "b": {}}, "arenas": 9, "pipeline_groups": 2})
    assert arenas_by_game(config) == [[3, 2], [3, 1]]
    assert kinds_of([[3, 2], [3, 1]]).tolist() == [0, 0, 0, 1, 1, 0, 0, 0, 1]


@pytest.mark.parametrize(
    ("keys", "wrong"),
    [
        ({"games": {"a": {}}, "game": "b"}, "there is a game, 'b', beside `games`"),
        ({"games": {"a": {}}, "parameters": {"size": 1}}, "write games.NAME.parameters"),
        ({"games": {"a": {}, "b": {}}, "arenas": 1}, "1 arenas are too few for 2 games"),
        ({"game": "b", "tell_game": True}, "`tell_game` does not go with one game"),
        ({"game": "b", "share_by": "progress"}, "`share_by` does not go with one game"),
        ({"games": {"a": {}}, "share_by": "progress"}, "set policy.scale_rewards=true"),
        (
            {
                "games": {"a": {}},
                "share_by": "progress",
                "policy": {"scale_rewards": True, "memory": {"kind": "gru"}},
            },
            "`share_by: progress` does not go with policy.memory",
        ),
        (
            {
                "games": {"a": {}},
                "share_by": "progress",
                "policy": {"scale_rewards": True},
                "policies": {"player": {"memory": {"kind": "gru"}}},
            },
            "`share_by: progress` does not go with policy.memory",
        ),
        ({"games": {"a.b": {}}}, "the name 'a.b' has other characters"),
        ({"games": ["a", "b"]}, r"games: got \['a', 'b'\]; expected names and values, written games.NAME.KEY=VALUE"),
        ({"games": {"a": {"simulator": "5005"}}}, "games.a.simulator: got '5005'; expected HOST:PORT"),
        ({"games": {"a": None}}, "no game is left in `games`"),
        ({"games": {"a": {"share": 0}}}, "games.a.share: got 0"),
    ],
)
def test_keys_that_contradict_each_other_are_refused(keys, wrong):
    with pytest.raises(ConfigError, match=wrong):
        make_config(keys)


def test_a_game_without_keys_is_played_unless_it_takes_one_of_another_file_out(tmp_path):
    (tmp_path / "two.yaml").write_text("games:\n  marble:\n  archer:\n    share: 2\narenas: 8\n")
    (tmp_path / "less.yaml").write_text("extends: two.yaml\ngames:\n  archer:\n  orchard:\n")
    assert [*load_config(tmp_path / "two.yaml").games] == ["marble", "archer"]
    assert [*load_config(tmp_path / "less.yaml").games] == ["marble", "orchard"]
    assert [*load_config(tmp_path / "two.yaml", ["games.marble=null"]).games] == ["archer"]


def test_a_run_goes_on_with_its_games_in_their_order_wherever_they_are_played():
    games: dict[str, dict[str, str]] = {"marble": {}, "archer": {}}
    before = make_config({"games": games})
    moved = make_config({"games": games | {"archer": {"simulator": "127.0.0.1:5006"}}})
    assert changes(before, moved) == {} and changes(before, make_config({"games": dict(reversed(games.items()))}))


@pytest.mark.parametrize(
    ("games", "wrong"),
    [
        ({"marble": {"options": {"observation": "smell"}}}, "observation"),
        ({"marble": {"parameters": {"observation": 1}}}, r"games.marble.parameters.observation: it is an option"),
        ({"marble": {"sensors": ["nose"]}}, "games.marble.sensors: the game has no 'nose'; it has marble, speed, ring"),
        ({"marble": {"reward_weights": {"x": 1}}}, "games.marble.reward_weights: there is no 'x'; it has reward"),
        ({"ferry": {}}, "games.ferry: ferry has 3 agents"),
    ],
)
def test_every_game_is_checked_before_anything_starts(games, wrong, simulator):
    with pytest.raises(Exception, match=wrong):
        make_lineup(simulator, make_config({"games": {"archer": {}, **games}}))


def test_lanes_of_the_common_session_play_as_the_games_do_alone(simulator):
    config = make_config({"games": {"archer": {}, "force": {"game": "hybrid"}}})
    lineup = make_lineup(simulator, config)
    (player,) = lineup.spec.behaviors
    assert [axis.name for axis in player.device.axes] == ["x", "y"]
    assert [branch.name for branch in player.device.branches] == ["string", "gear", "button1"]
    assert [metric.name for metric in player.metrics] == [
        "archer.hits",
        "archer.accuracy",
        "force.game_length",  # beside the number of decisions, which is force.length
        "force.presses",
    ]

    def both(game: str) -> Session:
        return Session(simulator, game, arenas=2, seed=3)

    own = [both("archer"), both("hybrid")]
    several = SeveralSession(
        [both("archer"), both("hybrid")], [2, 2], [*map(lineup.translation, lineup.games)], lineup.spec
    )
    rng, ended = np.random.default_rng(0), 0
    with closing(several), closing(own[0]), closing(own[1]):
        for _ in range(150):
            (step,) = several.steps
            assert step.masks is not None
            (act,) = make_acts(lineup.spec, 4)
            act.axes[:] = rng.uniform(-1, 1, act.axes.shape)
            for branch, mask in enumerate(step.masks):
                act.choices[:, branch] = (mask * rng.random(mask.shape)).argmax(axis=1)
            assert not step.masks[2][:2, 1].any()  # the archer has no button
            archer = ActArrays(act.axes[:2, :1], act.choices[:2, :1])
            force = (act.axes[2:] * [1, 0.75] + [0, 1.25]).astype(np.float32)
            (alone,), (other,) = own[0].step([archer]), own[1].step([ActArrays(force, act.choices[2:, 1:])])
            (step,) = several.step([act])
            np.testing.assert_array_equal(step.rewards[:2], alone.rewards)
            np.testing.assert_allclose(step.rewards[2:, 0], other.rewards @ [1, 0.5], rtol=1e-5)
            np.testing.assert_array_equal(step.ended, [*alone.ended, *(other.ended + 2)])
            ended += len(step.ended)
            if len(alone.ended) and alone.metrics is not None and step.metrics is not None:
                np.testing.assert_array_equal(step.metrics[: len(alone.ended), :2], alone.metrics)
                assert np.isnan(step.metrics[: len(alone.ended), 2:]).all()
    assert ended > 4


def test_one_game_of_several_has_its_own_kinds_of_axes_and_all_have_them_together(simulator):
    games = {"birds": {"game": "shooting_birds", "options": {"locomotion": "axes"}}, "archer": {}}
    lineup = make_lineup(simulator, make_config({"games": games}))
    own = {game: [axis.kind for axis in lineup.spec_of(game).behaviors[0].device.axes] for game in games}
    alone = {game: [axis.kind for axis in spec.behaviors[0].device.axes] for game, spec in lineup.specs.items()}
    assert own["birds"] == alone["birds"] == [pb.AXIS_KIND_VELOCITY] * 2
    assert own["archer"][:1] == alone["archer"]
    config = make_config({"games": games, "pointer": "velocity"})
    with pytest.raises(ConfigError, match="no axis that places a pointer"):
        pointer_speeds(config, lineup.spec)


def test_numbers_have_bounds_where_those_of_all_games_have():
    bounded, free = sensor("a", [2], -1, 1), sensor("b", [2])
    for sensors, low in (({"one": [bounded], "two": [bounded]}, [-1]), ({"one": [bounded], "two": [free]}, [])):
        (numbers,), _ = common_sensors(sensors, dict.fromkeys(sensors), tell_game=False)
        assert list(numbers.low) == low


def test_rewards_are_scaled_and_episodes_summed_up_for_each_game():
    scale = ReturnScale(2, 0.0, np.array([0, 1]))
    rewards = np.array([[1, 100], [-1, -100]], np.float32)
    always = np.ones((2, 2), bool)
    np.testing.assert_allclose(scale.scale(rewards, always, ~always), [[1, 1], [-1, -1]], rtol=1e-5)
    again = ReturnScale(2, 0.0, np.array([0, 1]))
    again.load(scale.state())
    np.testing.assert_array_equal(again.scale(rewards, always, ~always), scale.scale(rewards, always, ~always))
    episodes = Episodes(3, ["a.hits", "b.kills"], games=(["a", "b"], np.array([0, 0, 1])))
    nan = np.nan
    episodes.finished = np.array([[0, 1, 10, 5, nan], [1, 3, 10, 7, nan], [2, 100, 20, nan, 9]])
    assert episodes.summarize() == {
        "episodes": 3,
        "reward": 51,
        "length": 15,
        "a.episodes": 2,
        "a.reward": 2,
        "a.length": 10,
        "a.hits": 6,
        "b.episodes": 1,
        "b.reward": 100,
        "b.length": 20,
        "b.kills": 9,
    }
    episodes.finished = np.array([[0, 1, 10, 5, nan]])
    assert "reward" not in episodes.summarize()  # which would be that of one game alone


@pytest.fixture(scope="module")
def run(simulator, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("several") / "run"
    small = ["arenas=8", "stop_at=1000", "log_interval=960"]  # both games end an episode
    done = joybridge("train", str(TWO), "--run", str(folder), *small, "--simulator", simulator)
    assert done.status == 0, done.errors
    assert "x = marble: tilt_x, archer: turn" in done.output
    return folder


def test_a_run_has_columns_for_each_game(run):
    row = read_rows(run / "metrics-player.csv")[-1]
    assert {"reward", "marble.reward", "marble.inside", "archer.reward", "archer.accuracy"} <= row.keys()
    assert row["reward"] == pytest.approx((row["marble.reward"] + row["archer.reward"]) / 2, rel=1e-4)


def test_all_games_of_a_run_are_evaluated_or_only_one(run, simulator):
    done = joybridge("evaluate", str(run), "--episodes", "2", "--json", "--simulator", simulator)
    results = json.loads(done.output.splitlines()[-1])
    assert [*results] == ["marble", "archer"]
    assert results["marble"]["player"]["means"].keys() == {"reward", "length", "inside", "lost"}
    one = joybridge(
        "evaluate",
        str(run),
        "--episodes",
        "2",
        "--json",
        "--only-game",
        "archer",
        "games.archer.parameters.size=4",
        "--simulator",
        simulator,
    )
    assert "parameters.size=4 (trained with 1)" in one.errors
    (played,) = json.loads(one.output.splitlines()[-1]).values()
    assert played["player"]["means"]["accuracy"] > results["archer"]["player"]["means"]["accuracy"]
    at = ("--simulator", simulator)
    over = ("--episodes", "2", "--only-game", "archer", "--over", "parameters.size=0.5,4")
    swept = joybridge("evaluate", str(run), *over, *at)
    assert swept.status == 0 and "parameters.size" in swept.output, swept.errors
    for words, message in (
        (["--only-game", "chess"], "there is no game 'chess' among several; there are marble, archer"),
        (["games.archer.share=3"], "games.archer.share belongs to the training of"),
        (["games.chess={}"], "games.chess belongs to the training of"),
    ):
        assert message in joybridge("evaluate", str(run), *words, *at).errors


def test_a_run_of_one_game_begins_with_no_policy_of_several(run, simulator, tmp_path):
    small = ["--run", str(tmp_path / "one"), "--from", str(run), "--simulator", simulator, "arenas=2"]
    one = joybridge("train", "recall/echo", "policy.memory.kind=none", *small)
    assert "was trained with `games`, and this is a run with the key `game`" in one.errors


def test_a_policy_clones_demonstrations_of_single_games(run, simulator, tmp_path):
    demos, at = tmp_path / "demos", ("--simulator", simulator)
    for game in ("archer", "marble"):
        shown = ["evaluate", str(run), "--only-game", game, "--episodes", "3", "--demos", str(demos), *at]
        assert joybridge(*shown).status == 0
    lineup = make_lineup(simulator, make_config({"games": {"marble": {}, "archer": {}}}))
    for demonstration, game in zip(
        [load_translated(file, lineup) for file in sorted(demos.iterdir())], ("archer", "marble"), strict=True
    ):
        assert [*lineup.games][demonstration.kind] == game and demonstration.spec == lineup.spec
        recorded = load_recorded(demonstration.path, lineup.specs[game])
        for common, own in zip(demonstration.stretches, recorded.stretches, strict=True):
            for (act,), (done,) in zip(common.acts, own.acts, strict=True):
                back = lineup.translation(game).act(act)
                np.testing.assert_allclose(back.axes, done.axes, atol=1e-6)
                np.testing.assert_array_equal(back.choices, done.choices)
    small = ["arenas=4", "total_timesteps=960", "log_interval=480", "policy.minibatch_size=64", *at]
    clone = joybridge("train", str(TWO), "--run", str(tmp_path / "clone"), "--demos", str(demos), *small)
    assert clone.status == 0, clone.errors
    assert "of 6 episodes are cloned (3 of marble, 3 of archer)" in clone.output
    first, *_, last = read_rows(tmp_path / "clone" / "metrics-player.csv")
    assert last["cloning_loss"] < first["cloning_loss"]
    for wrong, message in (
        (["clone", str(demos), "--config", str(TWO)], "clone a policy for all with `joybridge train"),
        (
            ["train", str(TWO), "--run", str(tmp_path / "other"), "games.archer=null", "--demos", str(demos), *at],
            "is a demonstration of archer, expected one of marble",
        ),
    ):
        assert message in joybridge(*wrong).errors


def test_a_demonstration_is_of_the_game_with_its_options(simulator, tmp_path):
    birds = {"game": "shooting_birds"}
    levels = {name: birds | {"options": {"locomotion": "axes", "level": name[1:]}} for name in ("a1", "b6", "c3")}
    lineup = make_lineup(simulator, make_config({"games": levels}))
    for name, kind in (("b6", 1), ("c3", 2), ("a1", 0)):
        file = record(tmp_path, simulator, "shooting_birds", 3, options=levels[name]["options"])
        assert load_translated(file, lineup).kind == kind
    other = record(tmp_path, simulator, "shooting_birds", 3, options={"locomotion": "axes", "level": "5"})
    assert load_translated(other, lineup).kind == 0  # nothing but the levels differs


def test_a_video_shows_all_games_side_by_side(run, simulator, tmp_path):
    import av

    done = joybridge("record", str(run), str(tmp_path / "all.mp4"), "--seconds", "0.2", "--simulator", simulator)
    assert done.status == 0, done.errors
    with av.open(str(tmp_path / "all.mp4")) as video:
        pictures = [frame.to_ndarray(format="rgb24") for frame in video.decode(video=0)]
    assert [picture.shape for picture in pictures] == [(240, 720, 3)] * 6
    assert pictures[0][:, :30].max() < 30  # beside the marble's board, which is square
    assert pictures[0][:, 400:].mean() > 100  # the archer's sky


def test_a_run_of_games_with_snapshots_resumes_to_the_same_bits(simulator, tmp_path):
    games = ["games.marble=null", "games.archer=null", "games.beastly_rivals.options.locomotion=axes"]
    small = [
        *games,
        "games.birds={game: shooting_birds, share: 2, options: {locomotion: axes}}",
        "arenas=6",
        "policy.rollout_steps=20",
        "policy.minibatch_size=40",
        "log_interval=480",
        "tell_game=true",
        "share_by=progress",
        "policy.scale_rewards=true",
        "layout=bucket-5",
        "hand.delay=1",
        "--simulator",
        simulator,
    ]
    for stop in ("stop_at=960", "stop_at=480"):
        assert joybridge("train", str(TWO), "--run", str(tmp_path / stop), *small, stop).status == 0
    again = joybridge("train", str(TWO), "--run", str(tmp_path / "stop_at=480"), *small, "stop_at=960", "--resume")
    assert again.status == 0, again.errors
    whole, resumed = (load_checkpoint(tmp_path / stop)[0] for stop in ("stop_at=960", "stop_at=480"))
    assert whole.keys() == resumed.keys()
    assert any(name.startswith("simulator/") for name in whole)
    for name, array in whole.items():
        np.testing.assert_array_equal(array, resumed[name], err_msg=name)


def test_a_policy_of_several_games_is_exported(run, simulator, tmp_path):
    file = tmp_path / "policy.json"
    done = joybridge("export", str(run), str(file), "--only-game", "archer", "--simulator", simulator)
    assert done.status == 0, done.errors
    assert [axis["name"] for axis in json.loads(file.read_text())["axes"]] == ["x", "y"]
