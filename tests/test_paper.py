"""The grid of runs: finished work is never repeated, failures stop nobody else, and killing it changes no figure."""

import csv
import fcntl
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import pytest

from joybridge.experiments import grid
from joybridge.experiments.cluster import read_files, write_files
from joybridge.experiments.grid import Display, Job, keep_results, run_grid, time_left
from joybridge.trainer.checkpoint import has_checkpoint
from tools.paper import main

ROOT = Path(__file__).parents[1]
TIMESTEPS = 12_000
TIMING = {"timesteps_per_second", "simulate", "wire", "act", "learn"}


@pytest.fixture(scope="module")
def configs(tmp_path_factory) -> Path:
    """Return a folder of two configurations, one of which fails."""
    folder = tmp_path_factory.mktemp("configs")
    base = ROOT / "configs" / "beastly_rivals" / "bucket-3.yaml"
    policy = "{hidden_sizes: [32, 32], rollout_steps: 50, time_horizon: 50, minibatch_size: 100}"
    (folder / "survive.yaml").write_text(
        f"{{extends: {base}, arenas: 8, log_interval: 3000, checkpoint_interval: 2000, policy: {policy}}}"
    )
    (folder / "fail.yaml").write_text(f"{{extends: {base}, arenaz: 4}}")
    return folder


def job(configs: Path, runs: Path, experiment: str = "survive", seed: int = 0) -> Job:
    return Job(experiment, seed, TIMESTEPS, configs, runs)


def command(configs: Path, runs: Path, *more: str) -> list[str]:
    return [
        sys.executable, str(ROOT / "tools" / "paper.py"), "run", "--configs", str(configs), "--runs", str(runs),
        "--results", str(runs / "results"), "--timesteps", str(TIMESTEPS), "--jobs", "2", *more,
    ]  # fmt: skip


def figures(results: Path) -> dict[str, list[dict[str, str]]]:
    """Return the text of every cell that is not a time, by file."""
    tables = {}
    for path in sorted(results.glob("*/*.csv")):
        with path.open(newline="") as file:
            tables[path.name] = [
                {name: cell for name, cell in row.items() if name not in TIMING} for row in csv.DictReader(file)
            ]
    return tables


@dataclass
class Whole:
    """A grid that nothing interrupted."""

    results: Path
    failed: dict[Job, str]


@pytest.fixture(scope="module")
def whole(configs, tmp_path_factory) -> Whole:
    folder = tmp_path_factory.mktemp("whole")
    jobs = [job(configs, folder, "survive", 0), job(configs, folder, "fail", 0), job(configs, folder, "survive", 1)]
    return Whole(folder / "results", run_grid(jobs, 3, folder / "results"))


@pytest.fixture(scope="module")
def killed(configs, tmp_path_factory) -> Path:
    """Return the folder of a grid of two runs that was killed in the middle, with all its processes."""
    runs = tmp_path_factory.mktemp("killed")
    process = subprocess.Popen(
        command(configs, runs, "--experiments", "survive", "--seeds", "0", "1"),
        start_new_session=True, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    first, second = job(configs, runs, seed=0), job(configs, runs, seed=1)
    while not (has_checkpoint(first.run) and has_checkpoint(second.run)):
        assert process.poll() is None
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert not (first.finished() and second.finished())
    return runs


def test_one_failing_run_is_reported_with_its_reason_and_does_not_stop_the_others(whole):
    assert [(job.name, complaint) for job, complaint in whole.failed.items()] == [
        ("fail s0", "error: unknown key 'arenaz'; did you mean 'arenas'?")
    ]
    assert list(figures(whole.results)) == ["survive-s0.csv", "survive-s1.csv"]


def test_trainers_whose_grid_is_killed_save_and_end_and_the_grid_goes_on(whole, configs, tmp_path):
    process = subprocess.Popen(
        command(configs, tmp_path, "--experiments", "survive", "--seeds", "0"), stdout=subprocess.DEVNULL
    )
    only = job(configs, tmp_path)
    while not has_checkpoint(only.run):
        assert process.poll() is None
        time.sleep(0.02)
    process.kill()  # it alone, not its trainers
    process.wait()
    assert run_grid([only], 1, tmp_path / "results") == {}
    assert "interrupted" in (only.run / "log.txt").read_text()
    name = "survive-s0.csv"
    assert figures(tmp_path / "results") == {name: figures(whole.results)[name]}


def test_a_run_that_is_killed_is_said_to_be(configs, tmp_path):
    victim = job(configs, tmp_path)

    def begin(chosen: Job) -> grid.Process:
        process = grid.start(chosen)
        os.kill(process.pid, signal.SIGKILL)  # type: ignore[attr-defined]
        return process

    assert run_grid([victim], 1, tmp_path / "results", begin) == {victim: "killed by SIGKILL"}


def test_every_finished_run_leaves_its_rows_and_different_seeds_different_ones(whole):
    tables = figures(whole.results)
    rows = tables["survive-s0.csv"]
    assert [int(row["timesteps"]) // 3000 for row in rows] == [1, 2, 3, 4]
    assert all(float(row["episodes"]) > 0 for row in rows)
    assert rows != tables["survive-s1.csv"]


def test_a_grid_killed_in_the_middle_and_started_again_ends_with_the_same_figures(whole, killed, configs, tmp_path):
    runs = shutil.copytree(killed, tmp_path / "runs")
    again = command(configs, runs, "--experiments", "survive", "--seeds", "0", "1")
    result = subprocess.run(again, capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stderr
    assert figures(runs / "results") == figures(whole.results)
    assert run_grid([job(configs, runs, seed=seed) for seed in (0, 1)], 2, runs / "once more", begin=refuse) == {}
    assert figures(runs / "once more") == figures(whole.results)  # kept again, not run again


def refuse(job: Job) -> grid.Process:
    raise AssertionError(f"{job.name} was started though it had finished")


def test_a_ray_cluster_goes_on_with_killed_runs_to_the_same_figures_and_reports_what_fails(
    whole, killed, configs, tmp_path
):
    runs = shutil.copytree(killed, tmp_path / "runs")
    seed = next(seed for seed in (0, 1) if not job(configs, runs, seed=seed).finished())
    on_ray = ["--experiments", "fail", "survive", "--seeds", str(seed), "--backend", "ray", "--jobs", "1"]
    result = subprocess.run(command(configs, runs, *on_ray), capture_output=True, text=True, check=False)
    assert result.returncode == 1
    assert f"survive s{seed}: done" in result.stdout
    assert f"failed: fail s{seed}: unknown key 'arenaz'; did you mean 'arenas'?" in result.stderr
    name = f"survive-s{seed}.csv"
    assert figures(runs / "results") == {name: figures(whole.results)[name]}


def test_a_run_that_another_process_trains_is_left_alone(configs, tmp_path, monkeypatch):
    monkeypatch.setattr(grid, "GRACE_SECONDS", 0.0)
    taken = job(configs, tmp_path)
    taken.run.mkdir()
    with (taken.run / "lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        failed = run_grid([taken], 1, tmp_path / "results")
    assert failed == {taken: f"another process is training {taken.run}; end that one first"}


class Endless:
    """A process that only ends when asked to."""

    def __init__(self) -> None:
        self.status: int | None = None

    def poll(self) -> int | None:
        return self.status

    def terminate(self) -> None:
        self.status = 130

    def wait(self) -> int:
        assert self.status is not None
        return self.status


def test_an_interruption_asks_every_running_process_to_save_and_waits_for_it(configs, tmp_path, monkeypatch):
    monkeypatch.setattr(grid, "GRACE_SECONDS", 0.0)
    processes: list[Endless] = []

    def begin(_: Job) -> Endless:
        if len(processes) == 2:
            raise KeyboardInterrupt
        processes.append(Endless())
        return processes[-1]

    with pytest.raises(KeyboardInterrupt):
        run_grid([job(configs, tmp_path, seed=seed) for seed in range(3)], 3, tmp_path / "results", begin)
    assert [process.status for process in processes] == [130, 130]


def test_time_left_follows_from_speed_and_is_not_guessed_before_there_is_any():
    assert time_left(9_000_000, 1000.0) == "1.0 k timesteps/s, 2 h 30 min left"
    assert time_left(9_000_000, 0.0) == "measuring"


def test_what_failed_no_longer_counts_for_the_time_left(configs, tmp_path):
    jobs = [job(configs, tmp_path, seed=seed) for seed in (0, 1)]
    display = Display(jobs, finished=0)
    display.update([])
    assert display.bars.tasks[display.all].total == 2 * TIMESTEPS
    display.end(jobs[0], "error: it failed")
    display.update([])
    assert display.bars.tasks[display.all].total == TIMESTEPS


def test_results_are_named_by_length_experiment_seed_and_policy(tmp_path):
    birds = Job("shooting_birds/bucket-11", 3, 3_000_000, ROOT / "configs", tmp_path / "runs")
    birds.run.mkdir(parents=True)
    (birds.run / "metrics-hunter.csv").write_text("timesteps\n300000\n")
    keep_results(birds, tmp_path / "results")
    assert (tmp_path / "results/3M/shooting_birds/bucket-11-s3.csv").read_text() == "timesteps\n300000\n"


def test_of_a_longer_run_only_what_was_asked_for_is_kept_and_another_run_is_never_replaced(tmp_path):
    birds = Job("shooting_birds/bucket-11", 0, 700_000, ROOT / "configs", tmp_path / "runs")
    birds.run.mkdir(parents=True)
    metrics, kept = birds.run / "metrics-hunter.csv", tmp_path / "results/0.7M/shooting_birds/bucket-11-s0.csv"
    metrics.write_text("timesteps,reward\n300024,1.5\n600021,2.5\n900018,3.5\n")
    for _ in range(2):
        keep_results(birds, tmp_path / "results")
        assert kept.read_text() == "timesteps,reward\n300024,1.5\n600021,2.5\n"
    metrics.write_text("timesteps,reward\n300024,1.5\n600021,9.5\n")
    with pytest.raises(FileExistsError, match="holds another run; move it away"):
        keep_results(birds, tmp_path / "results")
    assert [path.name for path in kept.parent.iterdir()] == [kept.name]
    assert kept.read_text().endswith("600021,2.5\n")


def test_an_unknown_experiment_is_refused_by_name(configs, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", command(configs, tmp_path, "--experiments", "fly")[1:])
    with pytest.raises(SystemExit):
        main()
    assert f"there is no {configs / 'fly.yaml'}" in capsys.readouterr().err


def test_a_grid_whose_results_could_not_be_kept_is_refused_before_it_begins(configs, tmp_path, monkeypatch, capsys):
    kept = tmp_path / "results" / "0.012M" / "survive-s0-axes.csv"
    kept.parent.mkdir(parents=True)
    kept.touch()
    monkeypatch.setattr(sys, "argv", command(configs, tmp_path, "--experiments", "survive")[1:])
    with pytest.raises(SystemExit):
        main()
    assert f"{kept} is of a run that is not in {tmp_path}; give --results FOLDER" in capsys.readouterr().err


def test_keys_can_be_set_for_every_run(configs, tmp_path, monkeypatch, capsys):
    more = ["--experiments", "survive", "--set", "arenas=3", "groups=1", "--set", "policy.epochs=x"]
    monkeypatch.setattr(sys, "argv", command(configs, tmp_path, *more)[1:])
    assert main() == 1
    assert "policy.epochs: got 'x'" in capsys.readouterr().err


def test_a_finished_run_of_another_configuration_is_not_passed_off_as_finished(whole, configs):
    plain = job(configs, whole.results.parent)
    assert plain.finished()
    other = replace(plain, overrides=("policy.epochs=1",))
    assert not other.finished()
    assert "policy changed" in run_grid([other], 1, whole.results)[other]


@pytest.mark.parametrize(("setting", "option"), [("seed=3", "--seeds"), ("stop=9", "--timesteps")])
def test_what_has_an_option_of_its_own_is_not_set(setting, option, configs, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", command(configs, tmp_path, "--experiments", "survive", "--set", setting)[1:])
    with pytest.raises(SystemExit):
        main()
    assert f"give {option} instead" in capsys.readouterr().err


def test_files_of_a_run_travel_and_old_checkpoints_go(tmp_path):
    there, here = tmp_path / "there", tmp_path / "here"
    first = {
        "metrics-a.csv": b"1",
        "log.txt": b"x",
        "checkpoints/000001/arrays": b"a",
        "checkpoints/000001/manifest": b"m",
    }
    second = {"metrics-a.csv": b"12", "log.txt": b"xy", "checkpoints/000002/arrays": b"b"}
    write_files(there, first)
    assert read_files(there) == first
    write_files(here, read_files(there))
    write_files(here, second)
    assert read_files(here) == second
    write_files(here, {})
    assert read_files(here) == second
    (here / "lock").touch()
    (here / "tensorboard").mkdir()
    assert read_files(here) == second
