"""Configurations are checked, merged and overridden; the experiments' files are as the paper has them."""

import os
from pathlib import Path

import pytest

from joybridge.config.config import Config, dump_config, load_config
from joybridge.config.config_files import read_overrides
from joybridge.config.errors import ConfigError
from joybridge.config.policy_config import PolicyConfig
from joybridge.config.wrong_keys import OTHER_NAMES
from joybridge.run.checkpoint import Manifest, save_checkpoint
from joybridge.run.folder import check_run, keep_config, run_name

CONFIGS = sorted(Path(__file__).parents[1].glob("configs/*/*.yaml"))
BUCKET = Path(__file__).parents[1] / "configs/shooting_birds/bucket-11.yaml"


def write(folder: Path, text: str, name: str = "config.yaml") -> Path:
    path = folder / name
    path.write_text(text)
    return path


@pytest.mark.parametrize("path", CONFIGS, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_every_file_loads_and_its_dump_is_the_same_configuration(path, tmp_path):
    config = load_config(path, [] if path.stem != "common" else ["layout=hybrid", "game=any"])
    assert load_config(write(tmp_path, dump_config(config))) == config


def test_a_distribution_is_replaced_as_a_whole_wherever_it_is(tmp_path):
    drawn = "{size: {uniform: [1, 2]}}"
    path = write(tmp_path, f"game: g\nparameters: {drawn}\nevaluate_during: {{parameters: {drawn}}}\n")
    for key in ("parameters", "evaluate_during.parameters"):
        config = load_config(path, [f"{key}.size={{choice: [3]}}"])
        part = config if key == "parameters" else config.evaluate_during
        assert part is not None and part.parameters == {"size": {"choice": [3.0]}}
    assert load_config(path, ["parameters.size={uniform: [0, 1]}"]).parameters == {"size": {"uniform": [0.0, 1.0]}}
    assert load_config(path, ["parameters.other=1"]).parameters.keys() == {"size", "other"}


def test_items_of_a_list_have_numbers(tmp_path):
    lesson = "{parameters: {size: 2}, until: {metric: hits, above: 3, episodes: 50}}"
    path = write(tmp_path, f"game: g\npolicy: {{hidden_sizes: [8, 4]}}\ncurriculum: [{lesson}, {{parameters: {{}}}}]")
    config = load_config(path, ["curriculum.0.until.episodes=7", "policy.hidden_sizes.1=6"])
    first = config.curriculum[0]
    assert first.until is not None and first.until.episodes == 7 and first.parameters == {"size": 2}
    assert config.policy.hidden_sizes == [8, 6]
    with pytest.raises(ConfigError, match=r"curriculum: got .*; Input should be a valid list"):
        load_config(path, ["curriculum.2.parameters={}"])


def test_there_is_a_file_for_each_experiment():
    layouts = [f"bucket-{n}" for n in (3, 11, 41)] + [f"threshold-{t}" for t in ("0.0", "0.1", "0.5")]
    for game in ("shooting_birds", "beastly_rivals"):
        for layout in (*layouts, "multiagent", "hybrid"):
            config = load_config(BUCKET.parents[1] / game / f"{layout}.yaml")
            assert (config.game, config.layout) == (game, layout)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("game: g\nlayuot: x", "unknown key 'layuot'; did you mean 'layout'"),
        (
            "game: g\npolicy: {learning_rat: 1}",
            r"unknown key 'policy.learning_rat'; did you mean 'policy.learning_rate'",
        ),
        (
            "game: g\npolicies: {axes: {epoch: 1}}",
            r"unknown key 'policies.axes.epoch'; did you mean 'policies.axes.epochs'",
        ),
        ("game: g\nnum_envs: 8", "unknown key 'num_envs'; the key is 'arenas'"),
        ("game: g\npolicy: {ent_coef: 0.1}", "the key is 'policy.entropy_coef'"),
        ("game: g\nlearning_rate: 0.1", "did you mean 'policy.learning_rate'"),
        ("game: g\nepocs: 3", "did you mean 'policy.epochs'"),
        ("game: g\npolicy: {seed: 3}", "did you mean 'seed', a key of the whole run, outside `policy`"),
        ("game: g\npolicy: {arena: 3}", "did you mean 'arenas', a key of the whole run, outside `policy`"),
        ("game: g\nppo: {epocs: 3}", "unknown key 'ppo.epocs'; did you mean 'policy.epochs'"),
        ("game: g\nsize: 0.5", "of the game are written options.NAME=CHOICE and parameters.NAME=VALUE"),
        ("game: g\npolicy: {hidden_sizes: '64,64'}", r"got '64,64'; expected a list, for example .*sizes=\[64, 64\]"),
        ("game: g\npolicy: {hidden_sizes: 64}", r"expected a list, for example policy.hidden_sizes=\[64\]"),
        ("game: g\npolicy: {sensors: gun rays}", r"expected a list, for example policy.sensors=\[gun, rays\]"),
        ("game: g\noptions: grid", "options: got 'grid'; expected names and values, written options.NAME=CHOICE"),
        ("game: g\npolicies: {epochs: 3}", r"policies.epochs: got 3; .* written policies.NAME.KEY=VALUE"),
        ("game: g\npolicy: 3", "policy: got 3; expected names and values, written policy.KEY=VALUE"),
        ("game: g\nzzzz: 1", "unknown key 'zzzz'; `joybridge keys` lists all keys; those of the game"),
        ("game: g\narenas: 0", "arenas: got 0"),
        ("game: g\narenas: many", "arenas: got 'many'"),
        ("game: g\npolicy: {clip_range: .nan}", "policy.clip_range: got nan"),
        ("game: g\nseed: -1", "seed: got -1"),
        ("layout: hybrid", "game: it is missing; every configuration has this key"),
        ("- a", "holds list"),
        ("a: [", "is not YAML"),
        ("extends: config.yaml", "leads back to the file itself"),
        ("extends: gone.yaml", "cannot read the configuration .*gone.yaml"),
    ],
)
def test_a_wrong_file_is_refused_naming_the_key(text, message, tmp_path):
    with pytest.raises(ConfigError, match=message):
        load_config(write(tmp_path, text))


LAUGHS = "game: g\noptions:\n  a0: &a0 ha\n" + "".join(
    f"  a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 12)
)

MERGES = "game: g\noptions:\n  a0: &a0 {x: 1}\n" + "".join(
    f"  a{i}: &a{i} {{<<: [*a{i - 1}, *a{i - 1}]}}\n" for i in range(1, 41)
)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (LAUGHS, "its aliases make it too large"),
        ("game: g\noptions: &a {b: *a}", "is not YAML|too large"),
        (MERGES, "it has the key `<<`; write the keys themselves, or use `extends`"),
        ("game: g\noptions: !!bool maybe", "is not YAML"),
        ("game: g\nseed: !!int ''", "is not YAML"),
        ("game: g\ntotal_timesteps: !!float ''", "is not YAML"),
        ("game: g\npolicy: {hidden_sizes: [1000000000]}", "got 1000000000; .* less than or equal to 65536"),
        ("game: g\npolicy: {memory: {kind: gru, size: 1000000000}}", "got 1000000000; .* less than or equal to 65536"),
        ("game: g\npolicy: {rollout_steps: 1000000000}", "got 1000000000; .* less than or equal to 16777216"),
        ("game: g\npolicy: {frame_stack: 1000000000}", "got 1000000000; .* less than or equal to 1000"),
        ("game: g\narenas: 4294967296", "got 4294967296; .* less than or equal to 1048576"),
        ('game: g\npolicy: {hidden_sizes: "\\e]0;owned\\a"}', r"for example policy.hidden_sizes=\[\\x1b\]0, owned"),
        ("game: " + "[" * 30_000, "it is nested more than 10 times"),
        ("game: g\nseed: 0x" + "f" * 30_000, "seed: got an integer of very many digits"),
        ("game: g\nseed: " + "9" * 5000, "is not YAML"),
        ("game: g\nseed: " + "x" * 30_000, "seed: got 'xxx"),
        (
            "game: g\n" + "#" * 70_000,
            "cannot read the configuration .*config.yaml: 70,008 bytes, expected at most 65,536",
        ),
        ("game: g\nextends: /dev/zero", "cannot read the configuration /dev/zero: not a regular file"),
        ("game: g\nextends: pipe", "cannot read the configuration .*pipe: not a regular file"),
        ("game: g\nextends: .", "cannot read the configuration .*: "),
        ("game: g\nextends: loop", "cannot read the configuration .*loop"),
        ('game: g\nextends: "a\\0b"', "cannot read the configuration .*null byte"),
        ("game: g\nextends: " + "x" * 5000, "cannot read the configuration .*: File name too long"),
        ("game: !!python/object/apply:os.system [id]", "is not YAML"),
    ],
)
@pytest.mark.promise("X3")
def test_a_file_of_a_stranger_is_refused_in_a_sentence(text, message, tmp_path):
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "loop").symlink_to("loop")
    with pytest.raises(ConfigError, match=message) as caught:
        load_config(write(tmp_path, text))
    assert len(str(caught.value)) < 6000


def test_an_override_of_very_many_parts_is_refused():
    with pytest.raises(ConfigError, match="has 3,001 parts, expected 10 at most"):
        read_overrides(["." * 3000 + "=1"])


def test_a_file_extends_an_installed_configuration_by_its_name_unless_there_is_a_file(tmp_path):
    file = write(tmp_path, "extends: archer/hybrid\narenas: 3")
    config = load_config(file)
    assert (config.game, config.layout, config.arenas) == ("archer", "hybrid", 3)
    (tmp_path / "archer").mkdir()
    write(tmp_path, "game: mine", "archer/hybrid")
    assert load_config(file).game == "mine"


def test_files_extend_each_other_ten_times_at_most(tmp_path):
    write(tmp_path, "game: g", "0.yaml")
    for number in range(1, 12):
        write(tmp_path, f"extends: {number - 1}.yaml", f"{number}.yaml")
    assert load_config(tmp_path / "9.yaml").game == "g"
    with pytest.raises(ConfigError, match=r"1\.yaml: `extends` leads through more than 10 files"):
        load_config(tmp_path / "11.yaml")


def test_files_that_extend_others_merge_mappings_and_replace_the_rest(tmp_path):
    write(tmp_path, "game: g\npolicy: {epochs: 9, hidden_sizes: [5, 5]}\nseed: 3", "base.yaml")
    config = load_config(write(tmp_path, "extends: base.yaml\npolicy: {hidden_sizes: [7]}"))
    assert (config.policy.epochs, config.policy.hidden_sizes, config.seed) == (9, [7], 3)


def test_any_key_can_be_overridden_on_the_command_line():
    config = load_config(BUCKET, ["seed=7", "policy.learning_rate=1e-4", "options.level=3", "layout=hybrid"])
    assert (config.seed, config.policy.learning_rate, config.layout) == (7, 1e-4, "hybrid")
    with pytest.raises(ConfigError, match=r"'2024-13-45' is not YAML: month must be in 1\.\.12"):
        load_config(BUCKET, ["seed=2024-13-45"])
    with pytest.raises(ConfigError, match="not of the form key=value"):
        load_config(BUCKET, ["seed"])
    with pytest.raises(ConfigError, match=r"unknown key 'policy.lerning_rate'"):
        load_config(BUCKET, ["policy.lerning_rate=1"])


def test_what_differs_for_one_policy_lies_on_top_of_what_all_share():
    config = load_config(BUCKET.with_name("multiagent.yaml"))
    assert (config.policy_config("axes").minibatch_size, config.policy_config("buttons").minibatch_size) == (512, 256)
    assert config.policy_config("axes").entropy_coef == config.policy.entropy_coef


def test_numbers_and_words_are_those_of_yaml_1_2(tmp_path):
    text = "game: g\ntotal_timesteps: 3e6\npolicy: {learning_rate: 1e-4}\noptions: {blink: off, walk: on}"
    config = load_config(write(tmp_path, text), ["stop_at=1e6"])
    assert (config.total_timesteps, config.stop_at, config.policy.learning_rate) == (3_000_000, 1_000_000, 1e-4)
    assert config.options == {"blink": "off", "walk": "on"}


def test_every_name_of_another_library_leads_to_a_key_that_exists():
    for name, key in OTHER_NAMES.items():
        assert name not in Config.model_fields and name not in PolicyConfig.model_fields, name
        where, _, last = key.rpartition(".")
        assert last in (PolicyConfig if where else Config).model_fields, name


def test_a_resumed_run_may_grow_but_neither_shrink_nor_change(tmp_path):
    keep_config(Config(game="g", total_timesteps=100), tmp_path)
    save_checkpoint(tmp_path, {}, Manifest(timesteps=50))
    check_run(Config(game="g", total_timesteps=200, stop_at=150, log_interval=7), tmp_path, resume=True)
    with pytest.raises(
        ConfigError, match="total_timesteps was 100 and can only grow, got 50; to end earlier, set stop"
    ):
        check_run(Config(game="g", total_timesteps=50), tmp_path, resume=True)
    with pytest.raises(ConfigError, match=r"seed was 0 and is now 1; resume .*/config\.yaml, or use another --run"):
        check_run(Config(game="g", total_timesteps=200, seed=1), tmp_path, resume=True)


def test_a_run_that_has_saved_nothing_may_begin_anew_with_another_configuration(tmp_path):
    keep_config(Config(game="g", seed=1), tmp_path)
    for resume in (False, True):
        check_run(Config(game="g"), tmp_path, resume=resume)
    save_checkpoint(tmp_path, {}, Manifest(timesteps=50))
    with pytest.raises(ConfigError, match="already holds a run"):
        check_run(Config(game="g", seed=1), tmp_path, resume=False)


@pytest.mark.parametrize(
    ("overrides", "name"),
    [
        ([], "g-base-s0"),
        (["seed=3", "stop_at=500", "keep_checkpoints=5", "log_interval=7"], "g-base-s3"),
        (["policy.learning_rate=1e-3"], "g-base-learning_rate=1e-3-s0"),
        (["policy.epochs=2", "arenas=4"], "g-base-arenas=4-epochs=2-s0"),
        (["arenas=4", "policy.epochs=9", "policy.epochs=2"], "g-base-arenas=4-epochs=2-s0"),
        (["policy.hidden_sizes=[64, 64]", "options.level=../x"], "g-base-hidden_sizes=64_64-options.level=.._x-s0"),
    ],
)
def test_the_default_name_of_a_run_tells_what_was_overridden(overrides, name, tmp_path):
    config = load_config(write(tmp_path, "game: g"), overrides)
    assert run_name(config, "base", overrides) == name


def test_a_very_long_name_of_a_run_is_cut_and_still_its_own(tmp_path):
    names = {run_name(Config(game="g"), "base", [f"policy.sensors={'x' * 300}{end}"]) for end in "ab"}
    assert len(names) == 2 and all(len(name) < 150 for name in names)
