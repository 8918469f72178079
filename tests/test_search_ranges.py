"""The ranges of a search, its rungs, and what is refused of them."""

from pathlib import Path

import pytest
from optuna.distributions import BaseDistribution, CategoricalDistribution
from optuna.trial import create_trial

from joybridge.compare import search_page
from joybridge.compare.command import parse
from joybridge.compare.page_parts import page_html
from joybridge.compare.ranges import Choices, Numbers, own_settings, read_ranges
from joybridge.compare.scores import Point, Run, score_at
from joybridge.compare.variants import make_variants
from joybridge.config.config import load_config
from joybridge.config.errors import ConfigError
from tests.support.searched import SMALL, WHAT
from tests.test_boundaries import modules

pytestmark = [pytest.mark.nightly, pytest.mark.usefixtures("signals")]


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--layouts", "hybrid"], "--layouts is not for a search; write what varies as --search KEY=VALUE,VALUE"),
        (["--seeds", "3"], "--seeds is not for a search"),
        (["--beside", "sb3"], "--beside is not for a search"),
        (["--score", "0"], "--score is not for a search"),
        (["--also", "x.yaml"], "--also is not for a search"),
        (
            ["--search", "policy.epochs=3"],
            "--search policy.epochs=3: nothing varies; write KEY=LOW..HIGH or KEY=VALUE,",
        ),
    ],
)
def test_options_that_mean_nothing_to_a_search_are_refused(words, message, capsys):
    search_words = [] if "--search" in words else ["--search", *WHAT]
    with pytest.raises(SystemExit):
        parse(["compare", "small.yaml", "--output", "out", *search_words, *words], "joybridge")
    assert message in capsys.readouterr().err


def test_keys_may_be_set_behind_what_is_searched():
    options = parse(["compare", "x.yaml", "--output", "y", "--search", *WHAT, "arenas=4", "policy.sensors=[a,b]"], "")
    assert options.search == WHAT and options.overrides == ["arenas=4", "policy.sensors=[a,b]"]


def test_optuna_is_imported_only_by_a_search():
    found = modules("joybridge.compare")
    users = {name for name, targets in found.items() if any(each.module.split(".")[0] == "optuna" for each in targets)}
    assert users == {f"joybridge.compare.{name}" for name in ("search", "trials", "search_page")}
    lazily = {name for name, targets in found.items() for each in targets if each.module in users and each.lazy}
    at_once = {name for name, targets in found.items() for each in targets if each.module in users and not each.lazy}
    assert lazily == {"joybridge.compare.command"} and at_once <= users


@pytest.fixture
def small(tmp_path) -> Path:
    path = tmp_path / "small.yaml"
    path.write_text(SMALL)
    return path


def test_ranges_are_whole_where_the_key_is_and_settings_are_short_and_never_outside(small):
    rate, gamma, epochs = "policy.learning_rate=1e-5..0.00123456789:log", "policy.gamma=0..1", "policy.epochs=3..10"
    first, second, third = read_ranges([rate, gamma, epochs], small, [])
    assert first == Numbers("policy.epochs", 3, 10, log=False, whole=True) and f"{first}" == epochs
    assert (
        second == Numbers("policy.gamma", 0.0, 1.0, log=False, whole=False) and f"{second}" == "policy.gamma=0.0..1.0"
    )
    assert isinstance(third, Numbers) and third.log
    assert [first.write(3), second.write(1 / 3), third.write(third.high)] == ["3", "0.333333", "0.00123456789"]
    assert [first.read("3"), first.read("3.5"), first.read("11"), second.read("nan")] == [3, None, None, None]


def test_choices_may_be_lists_and_keys_of_one_policy_are_searched(small):
    (sizes,) = read_ranges(["policy.hidden_sizes=[8, 8],[16]"], small, [])
    assert sizes == Choices("policy.hidden_sizes", ("[8, 8]", "[16]"))
    (epochs,) = read_ranges(["policies.archer.epochs=1..3"], small, [])
    assert epochs == Numbers("policies.archer.epochs", 1, 3, log=False, whole=True)


def test_own_settings_are_those_of_the_configuration_if_the_ranges_have_them(small):
    texts = ["layout=bucket-3,hybrid", "policy.hidden_sizes=[16],[8]", "policy.gamma=0..0.999"]
    own = own_settings(read_ranges(texts, small, []), load_config(small), small, [])
    assert own == {"layout": "hybrid", "policy.hidden_sizes": "[16]", "policy.gamma": "0.99"}
    assert own_settings(read_ranges(["policy.gamma=0..0.9"], small, []), load_config(small), small, []) == {}
    assert own_settings(read_ranges(["parameters.x=0..1"], small, []), load_config(small), small, []) == {}


def test_only_rows_until_a_rung_count():
    ends = (104, 208, 304)
    run = Run(0, tuple(Point(end, 0.0, float(i), begin=end - 104) for i, end in enumerate(ends, 1)), 304)
    assert score_at(run, 200, 2000, 100) == 1.5  # two of twenty
    assert score_at(run, 200, 1000, 100) == 2.0
    assert score_at(run, 99, 1000, 100) is None


def test_other_configurations_are_variants_of_a_comparison(small, tmp_path):
    other = tmp_path / "best.yaml"
    other.write_text(SMALL + "layout: bucket-3\n")
    made = make_variants([str(small), str(other)], [], [("policy.epochs", ["1", "2"])])
    assert [variant.label for variant in made] == [
        "small, epochs=1",
        "small, epochs=2",
        "best, epochs=1",
        "best, epochs=2",
    ]
    assert [variant.config.layout for variant in made] == ["hybrid"] * 2 + ["bucket-3"] * 2
    with pytest.raises(ConfigError, match="the configurations are of archer and orchard; compare those of one game"):
        make_variants([str(small), "orchard/hybrid"], [], [])


def test_settings_mean_nothing_to_markdown_and_html(tmp_path):
    ranges = [Choices("layout", ("a|<b>", "c*"))]
    distributions: dict[str, BaseDistribution] = {"layout": CategoricalDistribution(ranges[0].values)}
    trial = create_trial(params={"layout": "a|<b>"}, distributions=distributions, value=1.0)
    result = search_page.Outcome("g", "reward", 10, 0, ranges, [trial], 0, True, [], "joybridge …")
    html = page_html(search_page.page_text(result), tmp_path)
    assert "<td>a|&lt;b&gt;</td>" in html and html.count("<table>") == 1
