"""The command line of the paper's experiments: what it refuses before it starts anything."""

from collections.abc import Callable

import pytest

from joybridge.compare import ResultName, RunName, add_results
from tools.paper.__main__ import main

TIMESTEPS = 12_000


@pytest.fixture
def run(tmp_path) -> Callable[..., int]:
    """Return the command `run` on folders of its own, with one configuration."""
    (tmp_path / "survive.yaml").write_text("game: beastly_rivals")

    def run(*more: str) -> int:
        folders = ["--configs", str(tmp_path), "--runs", str(tmp_path), "--results", str(tmp_path / "results")]
        return main(["run", *folders, "--timesteps", str(TIMESTEPS), *more])

    return run


def test_an_unknown_experiment_is_refused_by_name(run, tmp_path, capsys):
    with pytest.raises(SystemExit):
        run("--experiments", "fly")
    assert f"there is no {tmp_path / 'fly.yaml'}" in capsys.readouterr().err


def test_a_run_whose_results_could_not_be_kept_is_refused(run, tmp_path, capsys):
    kept = ResultName(RunName("survive", 0), TIMESTEPS, "axes")
    add_results(tmp_path / "results", {kept: [{"timesteps": "9000"}]})
    with pytest.raises(SystemExit):
        run("--experiments", "survive")
    assert f"has survive-s0 of a run that is not in {tmp_path}; use another folder" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.nightly
def test_keys_are_set_for_every_run(run, capsys):
    assert run("--experiments", "survive", "--set", "arenas=3", "pipeline_groups=1", "--set", "policy.epochs=x") == 1
    assert "policy.epochs: got 'x'" in capsys.readouterr().err


@pytest.mark.parametrize(("setting", "option"), [("seed=3", "--seeds"), ("stop_at=9", "--timesteps")])
def test_keys_with_an_option_of_their_own_cannot_be_set(setting, option, run, capsys):
    with pytest.raises(SystemExit):
        run("--experiments", "survive", "--set", setting)
    assert f"use {option} instead" in capsys.readouterr().err
