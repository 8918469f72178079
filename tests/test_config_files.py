"""Configurations are found as files and by name, in a checkout as in an installed package."""

from pathlib import Path

import pytest

from joybridge.config.config import load_config
from joybridge.config.config_files import config_names, find_config
from joybridge.config.errors import ConfigError
from joybridge.config.game_or_config import game_or_config

CONFIGS = Path(__file__).parents[1] / "configs"


def test_a_checkout_has_its_own_files_under_their_names_but_those_that_others_extend():
    expected = {path.relative_to(CONFIGS).as_posix()[: -len(".yaml")] for path in CONFIGS.glob("*/*.yaml")}
    assert set(config_names()) == {name for name in expected if not name.endswith("/common")}
    assert "shooting_birds/bucket-11" in config_names()
    for name in config_names():
        assert find_config(name).samefile(CONFIGS / f"{name}.yaml")


@pytest.mark.parametrize("text", ["shooting_birds/bucket-11", "shooting_birds/bucket-11.yaml"])
def test_a_configuration_is_found_by_name_from_any_folder_and_can_be_loaded(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert load_config(find_config(text)).layout == "bucket-11"


def test_a_program_is_no_configuration(tmp_path):
    program = tmp_path / "sorter.py"
    program.write_text("import pygame\n")
    with pytest.raises(
        ConfigError, match=r"sorter\.py is a program, no configuration; `joybridge new --pygame .*sorter\.py` writes"
    ):
        load_config(find_config(str(program)))


def test_a_program_with_a_configuration_as_its_argument_is_still_a_program():
    assert game_or_config("pygame:my_game.py -- levels.yaml", [])[0] == "pygame:my_game.py -- levels.yaml"


def test_an_existing_file_comes_before_an_installed_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mine = tmp_path / "archer/hybrid.yaml"
    mine.parent.mkdir()
    mine.write_text("game: archer\n")
    assert find_config("archer/hybrid.yaml").samefile(mine)
    assert not find_config("archer/hybrid").samefile(mine)  # the folder's file has another name
    assert find_config(str(mine)) == mine


def test_an_unknown_name_is_refused_with_the_names_that_are_near():
    with pytest.raises(ConfigError, match=r"'shooting_bird/bucket-11'.* did you mean .*shooting_birds/bucket-11"):
        find_config("shooting_bird/bucket-11")
    with pytest.raises(ConfigError, match=r"did you mean marble/hybrid\?$"):
        find_config("marble")
    with pytest.raises(ConfigError, match=r"did you mean hybrid_suite/platform\?$"):
        find_config("platform/hybrid")
    with pytest.raises(ConfigError, match=r"there are some for archer, .*shooting_birds; name one of those$"):
        find_config("chess")


@pytest.mark.parametrize("text", ["../configs/archer/hybrid", "", ".", "shooting_birds/common", "/archer/hybrid"])
def test_nothing_but_the_names_of_configurations_is_looked_up(text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match="there is no configuration"):
        find_config(text)
