"""What `joybridge compare` refuses before it trains, and what it warns of."""

from argparse import Namespace
from contextlib import nullcontext

import pytest

from joybridge.compare import command
from joybridge.compare.compare import remarks
from joybridge.compare.launch import check_metric, too_short_for_scores
from joybridge.compare.peer_arguments import keep_peer_arguments, peer_arguments
from joybridge.compare.tested import check_test
from joybridge.compare.variants import (
    Variant,
    beside,
    make_variants,
)
from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.games.hybrid_suite.moving import Moving
from joybridge.v1 import bridge_pb2 as pb
from tests.support.command_line import joybridge
from tests.support.compared import OUT, SMALL, run_in

pytestmark = pytest.mark.usefixtures("signals")


def test_what_another_trainer_has_trained_plays_no_test():
    (variant,) = make_variants(["archer/hybrid"], [], [])
    options = command.parse(["compare", "archer/hybrid", "--output", "x", "--test"], "joybridge")
    with pytest.raises(ConfigError, match="--test cannot play hybrid, SB3, of Stable-Baselines3; leave this variant"):
        check_test([Variant("hybrid, SB3", variant.config, "sb3")], [pb.GameSpec()], options)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            ["--over", "hand.delay=0,2", "--over", "hand.reach=1,0.3"],
            "argument --over: it is given twice; give it once",
        ),
        (
            ["--deterministic"],
            "--episodes and --deterministic are for a test; say what is tested with --test or --over",
        ),
        (["--ppo", '{"gamma": 0.9}'], "--ppo has arguments of another PPO; name that with --beside"),
        (["--search", "policy.epochs=1..8", "--test"], "--test is for a comparison of one configuration; compare what"),
    ],
)
def test_options_that_mean_nothing_without_others_are_refused(words, message, capsys):
    with pytest.raises(SystemExit):
        command.parse(["compare", "archer/hybrid", "--output", "x", *words], "joybridge")
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--test", "parameters.sise=2"], "--test got parameters.sise; archer has options.observation=screen, "),
        (["--over", "parameters.sise=1,2"], "--over got parameters.sise; archer has options.observation=screen, "),
        (["--over", "options.observation=no,state"], "--over got options.observation=no; archer has options.observ"),
        (["--over", "policy.gamma=0.5,1"], "--over got 'policy.gamma=0.5,1', expected options.NAME=CHOICE"),
        (["--test", "policy.gamma=0.5"], "policy belongs to the training of hybrid and cannot change now; what can is"),
        (
            ["--metric", "entropy", "--test"],
            "--test got --metric entropy; of its episodes it has reward, length, hits, ",
        ),
        (
            ["total_timesteps=160"],
            "log_interval is 320, longer than the runs of 160 timesteps, so they have no metrics;",
        ),
        (["--metric", "held_out_reward"], "hybrid measures nothing held out; set evaluate_during, as in evaluate_"),
        (
            ["--metric", "held_out_hit", "evaluate_during={episodes: 2}"],
            "--metric got 'held_out_hit'; archer has reward, length, hits, accuracy, reward_std, episodes; held_out_… "
            "before each of these; of the training: ",
        ),
    ],
)
def test_what_no_run_would_have_is_refused_before_anything_is_trained(words, message, tmp_path, simulator):
    done = run_in(tmp_path, simulator, *words)
    assert done.status == 1 and message in done.errors and "done" not in done.output
    assert not (tmp_path / OUT / "runs").exists()


def test_a_configuration_that_goes_by_a_metric_says_so_where_rewards_are_compared():
    said = {}
    for metric in ("reward", "success"):
        options = command.parse(["compare", "hybrid_suite/moving", "--output", "x", "--metric", metric], "joybridge")
        variants = make_variants(["hybrid_suite/moving"], [], [])
        said[metric] = [text for text in remarks(variants, [Moving.describe({})], options, {}) if "best_metric" in text]
    (text,) = said["reward"]
    assert text.endswith("the configuration goes by success (best_metric): --metric success compares that")
    assert not said["success"]


def test_an_output_that_is_a_file_is_no_damaged_comparison(tmp_path):
    (tmp_path / "taken").write_text("")
    for output in (tmp_path / "taken", tmp_path / "taken" / "below"):
        done = joybridge("compare", "archer/hybrid", "--set", "policy.gamma=0.9,0.8", "--output", str(output))
        assert (done.status, done.output) == (1, "")
        assert done.errors == f"error: {output} is, or is in, a file; name another folder with --output\n"


def test_a_column_of_the_training_and_of_held_out_episodes_can_be_compared():
    (variant,) = make_variants(["archer/hybrid"], ["evaluate_during.episodes=2"], [])
    device = pb.Device(branches=[pb.Branch(name="fire", choices=["released", "pressed"])])
    archer = pb.Behavior(name="archer", device=device, metrics=[pb.Metric(name="hits")])
    spec = pb.GameSpec(name="archer", behaviors=[archer])
    for metric in ("hits", "entropy_fire", "explained_variance", "held_out_hits", "held_out_reward_std"):
        check_metric(variant, spec, metric, None)
    for metric in ("entropy_hits", "loss_mine", "held_out_fire"):
        with pytest.raises(ConfigError, match=f"--metric got '{metric}'; archer has reward, length"):
            check_metric(variant, spec, metric, None)
    other = Variant("", variant.config, "sb3")  # it counts rewards and lengths alone
    for metric in ("hits", "explained_variance"):
        with pytest.raises(ConfigError, match=f"'{metric}'; a run of Stable-Baselines3 has reward, length"):
            check_metric(other, spec, metric, None)


def test_a_game_that_another_trainer_cannot_train_is_refused_at_once_with_the_next_move(tmp_path):
    done = run_in(tmp_path, "127.0.0.1:1", "--beside", "sb3", "--wait", "0.1")
    assert done.status == 1 and "waiting" not in done.errors
    assert "there is none called 'archer'; to train this game with Stable-Baselines3, write a program" in done.errors
    assert beside([Variant("a", Config(game="CartPole-v1", preset="sb3"))], "sb3")[0].label == "a, Stable-Baselines3"


def test_files_of_the_same_name_are_told_apart_by_their_folders(tmp_path):
    for folder, layout in (("a/x", "hybrid"), ("b/x", "bucket-3"), ("c", "bucket-5")):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "best.yaml").write_text(SMALL + f"layout: {layout}\n")
    paths = [str(tmp_path / path) for path in ("a/x/best.yaml", "b/x/best.yaml", "c/best.yaml")]
    made = make_variants([*paths, "archer/hybrid"], [], [])
    assert [variant.label for variant in made] == ["a/x/best", "b/x/best", "c/best", "hybrid"]
    assert [variant.name for variant in made] == ["a_x_best", "b_x_best", "c_best", "hybrid"]
    with pytest.raises(ConfigError, match="have the same configuration; leave one of them out"):
        make_variants([paths[0], paths[0]], [], [])


@pytest.mark.parametrize(
    ("more", "message"),
    [
        (["--set", "layout=hybrid,auto"], "layout is set twice; set it once, with all of its values"),
        (["--set", "policy.epochs=1,1"], "--set got 'policy.epochs=1,1', which names a value twice"),
        (["--set", "policy.epochs="], "expected KEY=VALUE,VALUE,… as in policy.gamma=0.9,0.99"),
        (["--set", "policy.gamma=0.9,0.90"], "'hybrid, gamma=0.9' and 'hybrid, gamma=0.90' have the same config"),
        (["--set", "seed=1,2"], "--set seed=…: seed does not vary here; use --seeds"),
        (["--set", "game=archer,orchard"], "use a comparison for each game"),
        (["--change", "policy.epochs=1,2"], "expected KEY=VALUE, or several that are set together"),
        (["--change", "layout=bucket-3"], "--change layout=…: layout is set twice; set it once"),
        (["--change", "seed=1"], "--change seed=…: seed does not vary here; use --seeds"),
        (["seed=7"], "seed=…: use --seeds for the number of seeds, and --first-seed for the first of them"),
        (["epocs=7"], "unknown key 'epocs'; did you mean 'policy.epochs'?"),
    ],
)
def test_a_wrong_grid_is_refused_before_a_simulator_is_waited_for(more, message, tmp_path):
    done = run_in(tmp_path, "127.0.0.1:1", *more)
    assert done.status == 1 and message in done.errors and "waiting" not in done.errors
    assert not (tmp_path / OUT).exists()


def test_a_layout_that_cannot_play_the_game_is_refused_before_anything_is_trained(tmp_path, simulator):
    done = run_in(tmp_path, simulator, "--layouts", "hybrid", "joint-9999")
    assert done.status == 1
    assert "joint-9999: layout: 'joint-9999' cannot express this device: " in done.errors
    done = run_in(tmp_path, simulator, "policy.sensors=[gnu]")
    assert done.status == 1 and "hybrid: archer: sensors: the game has no 'gnu'" in done.errors
    assert not (tmp_path / OUT).exists()
    done = run_in(tmp_path, simulator, "--behavior", "archers")
    assert done.status == 1 and "--behavior got 'archers'; archer has archer" in done.errors


def test_other_arguments_of_another_trainer_are_another_comparison(tmp_path):
    def given(ppo, beside="sb3"):
        return Namespace(output=tmp_path, ppo=ppo, beside=beside)

    keep_peer_arguments(peer_arguments(given('{"gamma": 0.9}')), tmp_path)
    assert peer_arguments(given('{"gamma":0.9}')) == {"gamma": 0.9}
    with pytest.raises(ConfigError, match=r'holds runs with --ppo {"gamma": 0.9}, not {}; repeat'):
        peer_arguments(given("{}"))
    assert peer_arguments(given("{}", beside="")) == {}
    for text in ("{bad", "[1]"):
        with pytest.raises(ConfigError, match=r"--ppo got .*, expected a JSON object"):
            peer_arguments(given(text))


@pytest.mark.parametrize(("kept", "refused"), [("a", False), ("a-Stable-Baselines3", True)])
def test_arguments_of_another_trainer_may_be_given_if_it_has_not_trained_in_the_folder(kept, refused, tmp_path):
    (tmp_path / "variants.json").write_text(f'{{"{kept}": {{"config": {{"game": "archer"}}, "spec": {{}}}}}}')
    given = Namespace(output=tmp_path, ppo='{"gamma": 0.9}', beside="sb3")
    with pytest.raises(ConfigError, match=r"holds runs with --ppo \{\}") if refused else nullcontext():
        assert peer_arguments(given) == {"gamma": 0.9}


def test_runs_in_whose_last_tenth_few_long_episodes_end_are_warned_of():
    spec = pb.GameSpec(max_episode_decisions=100, behaviors=[pb.Behavior(agents_per_arena=2)])

    def said(timesteps: int, metric: str = "reward") -> str:
        config = Config(game="x", arenas=8, total_timesteps=timesteps, log_interval=50)
        return too_short_for_scores([Variant("a", config)], [spec], metric)

    assert "episodes that end in the last 1,599 of 15,999 timesteps, and an episode of 100 decisions" in said(15_999)
    assert "in each of 8 arenas takes 1,600: train for longer, or add --test" in said(15_999)
    assert not said(16_000) and not said(100, "held_out_reward") and not said(100, "entropy")


def test_keys_with_capitals_and_digits_are_keys_behind_layouts():
    words = ["--layouts", "hybrid", "options.Level2=3", "--pairs", "layout", "games.my-game1.share=2"]
    options = command.parse(["compare", "archer/hybrid", "--output", "x", *words], "joybridge")
    assert options.layouts == ["hybrid"] and options.overrides == ["options.Level2=3", "games.my-game1.share=2"]
