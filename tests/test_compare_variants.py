"""The variants of `joybridge compare`: their names, their values, and in what they differ."""

import pytest

from joybridge.compare import command
from joybridge.compare.launch import repetition
from joybridge.compare.over import trained_span
from joybridge.compare.page_settings import settings_block
from joybridge.compare.variants import (
    Variant,
    make_variants,
    read_change,
    read_values,
)
from joybridge.config.config import load_config
from joybridge.config.config_files import find_config
from joybridge.config.differences import differences
from joybridge.config.errors import ConfigError
from joybridge.v1 import bridge_pb2 as pb


def test_values_may_be_lists_and_variants_are_named_after_what_differs():
    sizes = read_values("policy.hidden_sizes=[8, 8], [16]")
    assert sizes == ("policy.hidden_sizes", ["[8, 8]", "[16]"])
    made = make_variants(["archer/hybrid"], ["arenas=4"], [("layout", ["bucket-3", "hybrid"]), sizes])
    assert [variant.label for variant in made[:2]] == ["bucket-3, hidden_sizes=[8, 8]", "bucket-3, hidden_sizes=[16]"]
    assert [variant.name for variant in made[2:]] == ["hybrid-hidden_sizes=_8-8", "hybrid-hidden_sizes=_16"]
    assert made[3].config.layout == "hybrid" and made[3].config.policy.hidden_sizes == [16]
    assert {variant.config.arenas for variant in made} == {4}
    (alone,) = make_variants(["archer/hybrid"], [], [])
    assert alone.label == "hybrid"


def test_changes_are_compared_one_at_a_time_with_what_is_unchanged():
    changes = [read_change("layout=bucket-3"), read_change("policy.epochs=2 policy.hidden_sizes=[8,16]")]
    made = make_variants(["archer/hybrid"], [], [], changes)
    assert [variant.label for variant in made] == ["unchanged", "bucket-3", "epochs=2, hidden_sizes=[8,16]"]
    before = made[0].config.model_dump()
    pairs = [("policy.memory", "{kind: gru, size: 32}"), ("arenas", "2")]
    assert read_change(" policy.memory={kind: gru, size: 32}  arenas=2 ") == ("", pairs)
    assert read_change("with memory:  policy.memory={kind: gru, size: 32} arenas=2") == ("with memory", pairs)
    deep = "{episodes: 4, parameters: {size: {uniform: [1, 2]}}}"
    assert read_change(f"held: evaluate_during={deep} arenas=2").pairs == [("evaluate_during", deep), ("arenas", "2")]
    assert read_change('both: layout="hybrid, x=beta" arenas=2').pairs[0] == ("layout", '"hybrid, x=beta"')
    assert read_values(f"evaluate_during={deep},{{episodes: 5}}", "--set")[1] == [deep, "{episodes: 5}"]
    changed = [[key for key, *_ in differences(before, variant.config.model_dump())] for variant in made]
    assert changed == [[], ["layout"], ["policy.hidden_sizes.0", "policy.hidden_sizes.1", "policy.epochs"]]
    both = make_variants(["archer/hybrid"], [], [("policy.gamma", ["0.9", "0.99"])], changes[:1])
    assert [each.label for each in both] == ["gamma=0.9", "gamma=0.9, bucket-3", "gamma=0.99", "gamma=0.99, bucket-3"]
    far = read_change("far: policy.gamma=0.999 policy.epochs=2")
    (_, named) = make_variants(["archer/hybrid"], [], [], [far])
    assert (named.label, named.config.policy.gamma, named.config.policy.epochs) == ("far", 0.999, 2)
    with pytest.raises(ConfigError, match="--change got 'far: ', expected KEY=VALUE, "):
        read_change("far: ")
    with pytest.raises(ConfigError, match="--change got 'far:arenas=2'; a name needs a space behind its colon"):
        read_change("far:arenas=2")


def test_layouts_may_be_mixtures_and_overrides_may_stand_behind_them():
    words = [
        "compare",
        "x.yaml",
        "--layouts",
        "hybrid",
        "bucket-3, direction=hybrid",
        "arenas=4",
        "--output",
        "y",
        "seed=1",
    ]
    options = command.parse(words, "joybridge")
    assert options.layouts == ["hybrid", "bucket-3, direction=hybrid"]
    assert sorted(options.overrides) == ["arenas=4", "seed=1"]
    suite = ["compare", "--suite", "hybrid", "--output", "y", "--tasks", "goal", "moving", "arenas=4"]
    options = command.parse(suite, "joybridge")
    assert (options.tasks, options.overrides) == (["goal", "moving"], ["arenas=4"])


def test_the_command_of_a_search_has_all_that_makes_it_the_same_search():
    words = ["compare", "archer/hybrid", "--output", "y", "--search", "policy.epochs=1..2", "--trials", "3"]
    options = command.parse([*words, "--prune-from", "0.5", "seed=7"], "joybridge")
    options.typed = (options.overrides, [])
    again = (
        "joybridge compare archer/hybrid --search policy.epochs=1..2 --trials 3 --prune-from 0.5 --output FOLDER seed=7"
    )
    assert repetition(options) == again
    options.score = 123456.789
    assert "--score 123456.789 " in repetition(options)


def test_what_was_trained_with_spans_all_lessons():
    config, size = load_config(find_config("archer/curriculum")), pb.Parameter(name="size", default_value=0.3)
    spec = pb.GameSpec(parameters=[size])
    assert trained_span([Variant("", config)], [spec], "parameters.size") == (0.2, 3.0)


def test_a_page_says_what_differs_but_not_layouts_alone():
    layouts = make_variants(["archer/hybrid"], [], [("layout", ["hybrid", "bucket-3"])])
    shared = "## What all share\n\nSettings that differ from the defaults: `arenas: 32`"
    assert settings_block(layouts, []).startswith(shared) and "layout" not in settings_block(layouts, [])
    tuned = make_variants(["archer/hybrid"], [], [("layout", ["hybrid"]), ("policy.epochs", ["2", "3"])])
    block, _, _ = settings_block(tuned, []).partition("\n\n## What all share")
    assert block == "## What differs\n\n| key | hybrid, epochs=2 | hybrid, epochs=3 |\n| --- | --- | --- |\n" + (
        "| `policy.epochs` | 2 | 3 |"
    )


def test_differences_name_the_innermost_key():
    before, now = {"a": {"b": [1, 2]}, "c": 3}, {"a": {"b": [1, 4]}, "d": 5}
    assert list(differences(before, now)) == [("a.b.1", 2, 4), ("c", 3, None), ("d", None, 5)]
