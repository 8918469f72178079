"""Grids: finished runs are skipped, a failed run stops no other, and a killed grid ends with the same results."""

import io
import lzma
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from joybridge.compare import (
    Job,
    Process,
    ResultName,
    RunName,
    add_results,
    grid,
    job,
    read_table,
    run_grid,
    start,
)
from joybridge.compare.display import Display, time_left
from joybridge.compare.grid import keep_results
from joybridge.compare.table import TABLE
from joybridge.config.errors import CheckpointError, RunLockedError
from joybridge.config.metrics import KEYS, Cells, column_name, is_builtin_metric
from joybridge.ray_cluster import grid as cluster
from joybridge.ray_cluster.grid import read_files, write_files
from joybridge.run.checkpoint import has_checkpoint
from joybridge.run.run_lock import locked
from tests.support.jobs import Ended, train_here
from tools import pack_results
from tools.paper import __main__ as paper

ROOT = Path(__file__).parents[1]
TIMESTEPS = 6_000
DEADLINE_SECONDS = 240.0  # for a run to save its first checkpoint
TIMING = {"seconds", "timesteps_per_second", "simulate", "wire", "act", "learn"}


@pytest.fixture(scope="module")
def configs(tmp_path_factory) -> Path:
    return write_configs(tmp_path_factory.mktemp("configs"))


def write_configs(folder: Path) -> Path:
    """Write two configurations, one of which fails, into a folder, and return it."""
    base = ROOT / "configs" / "beastly_rivals" / "bucket-3.yaml"
    policy = "{hidden_sizes: [32, 32], rollout_steps: 50, time_horizon: 50, minibatch_size: 100}"
    (folder / "survive.yaml").write_text(
        f"{{extends: {base}, arenas: 8, log_interval: 1500, checkpoint_interval: 1000, policy: {policy}}}"
    )
    (folder / "fail.yaml").write_text(f"{{extends: {base}, arenaz: 4}}")
    return folder


def make_job(configs: Path, runs: Path, experiment: str = "survive", seed: int = 0) -> Job:
    return Job(experiment, seed, TIMESTEPS, configs, runs)


def command_line(configs: Path, runs: Path, *more: str) -> list[str]:
    """Return the arguments of the paper's grid."""
    return [
        "run",
        "--configs",
        str(configs),
        "--runs",
        str(runs),
        "--results",
        str(runs / "results"),
        "--timesteps",
        str(TIMESTEPS),
        *more,
    ]


def start_grid(configs: Path, runs: Path, **options: Any) -> "subprocess.Popen[bytes]":
    """Start a grid of one run in the checkout."""
    arguments = command_line(configs, runs, "--experiments", "survive")
    return subprocess.Popen(
        [sys.executable, "-m", "tools.paper", *arguments], cwd=ROOT, stdout=subprocess.DEVNULL, **options
    )


def wait_for_checkpoint(process: "subprocess.Popen[bytes]", only: Job) -> None:
    """Wait until a job has saved a checkpoint, while the grid's process is running."""
    deadline = time.monotonic() + DEADLINE_SECONDS
    while not has_checkpoint(only.run):
        assert process.poll() is None, "the grid ended before its run had a checkpoint"
        assert time.monotonic() < deadline, f"no checkpoint within {DEADLINE_SECONDS:g} s"
        time.sleep(0.02)


def figures(results: Path) -> dict[str, list[Cells]]:
    """Return every cell that does not depend on time, by the name of the run."""
    return {
        str(name.run): [{column: cell for column, cell in row.items() if column not in TIMING} for row in rows]
        for name, rows in read_table(results).items()
    }


@dataclass
class Whole:
    """The results of a grid that was not interrupted."""

    results: Path
    failed: dict[Job, str]


@pytest.fixture(scope="module")
def whole(simulator, configs, tmp_path_factory) -> Whole:
    """Return the results of two processes, and of a run that is trained here because starting a third one is slow."""
    folder = tmp_path_factory.mktemp("whole")
    here = replace(make_job(configs, folder, "survive", 1), arguments=("--simulator", simulator))
    jobs = [make_job(configs, folder, "survive", 0), make_job(configs, folder, "fail", 0), here]

    def begin(chosen: Job) -> Process:
        return train_here(chosen) if chosen is here else start(chosen)

    return Whole(folder / "results", run_grid(jobs, 3, folder / "results", begin))


@pytest.fixture
def resume(simulator) -> Callable[[Job], Ended]:
    """Return what resumes a job here, at the simulator that the tests share."""
    return lambda chosen: train_here(replace(chosen, arguments=("--simulator", simulator)))


def child(process: int) -> int:
    """Return the only child of a process."""
    (number,) = Path(f"/proc/{process}/task/{process}/children").read_text().split()
    return int(number)


def has_ended(process: Path) -> bool:
    try:
        return "\nState:\tZ" in (process / "status").read_text()
    except (FileNotFoundError, ProcessLookupError):
        return True


@pytest.mark.slow
@pytest.mark.nightly
def test_one_failing_run_is_reported_and_the_others_keep_all_of_their_different_rows(whole):
    assert [(str(failed.name), reason) for failed, reason in whole.failed.items()] == [
        ("fail-s0", "error: unknown key 'arenaz'; did you mean 'arenas'? `joybridge keys` lists all keys")
    ]
    one, other = figures(whole.results).values()
    assert [int(row["timesteps"]) // 1500 for row in one] == [1, 2, 3, 4]
    assert all(float(row["episodes"]) > 0 for row in one) and one != other


@pytest.mark.slow
@pytest.mark.nightly
def test_the_trainers_of_a_killed_grid_save_and_end_and_the_grid_resumes_them(whole, configs, resume, tmp_path):
    process = start_grid(configs, tmp_path)
    only = make_job(configs, tmp_path)
    wait_for_checkpoint(process, only)
    process.kill()  # it alone, not its trainers
    process.wait()
    assert run_grid([only], 1, tmp_path / "results", resume) == {}
    assert "interrupted" in (only.run / "log.txt").read_text()
    assert figures(tmp_path / "results") == {"survive-s0": figures(whole.results)["survive-s0"]}


@pytest.mark.slow
@pytest.mark.nightly
def test_a_killed_run_is_reported_with_its_signal(configs, tmp_path):
    victim = make_job(configs, tmp_path)

    def begin(chosen: Job) -> Process:
        process = start(chosen)
        os.kill(process.pid, signal.SIGKILL)  # type: ignore[attr-defined]
        return process

    assert run_grid([victim], 1, tmp_path / "results", begin) == {victim: "killed by SIGKILL"}


@pytest.mark.slow
@pytest.mark.nightly
@pytest.mark.promise("F2")
def test_a_grid_that_is_killed_with_its_trainers_and_repeated_ends_with_the_same_results(
    whole, configs, resume, tmp_path, monkeypatch, signals
):
    process, only = start_grid(configs, tmp_path, start_new_session=True), make_job(configs, tmp_path)
    wait_for_checkpoint(process, only)
    simulator = Path(f"/proc/{child(child(process.pid))}")
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    assert not only.finished()
    deadline = time.monotonic() + DEADLINE_SECONDS
    while not has_ended(simulator):  # it watches its trainer
        assert time.monotonic() < deadline
        time.sleep(0.05)
    monkeypatch.setattr(paper, "start", resume)
    assert paper.main(command_line(configs, tmp_path, "--experiments", "survive", "--jobs", "2")) == 0
    assert figures(tmp_path / "results") == {"survive-s0": figures(whole.results)["survive-s0"]}
    assert run_grid([only], 2, tmp_path / "once more", begin=refuse) == {}
    assert figures(tmp_path / "once more") == figures(tmp_path / "results")  # kept again without running again


def refuse(finished: Job) -> Process:
    raise AssertionError(f"{finished.name} was started though it had finished")


@pytest.mark.promise("S1")
def test_a_run_that_another_process_is_training_is_refused(configs, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "PARENT_SECONDS", 0.0)
    monkeypatch.setattr(job, "PARENT_SECONDS", 0.0)
    taken = make_job(configs, tmp_path)
    sentence = f"{taken.run} is being trained by process {os.getpid()} on "
    with locked(taken.run):
        with pytest.raises(RunLockedError, match=sentence):
            cluster.RemoteRun(None, taken)
        failed = run_grid([taken], 1, tmp_path / "results")
    assert failed[taken].startswith(sentence)


class Endless:
    """A process that ends only when it is terminated."""

    def __init__(self) -> None:
        self.status: int | None = None

    def poll(self) -> int | None:
        return self.status

    def terminate(self) -> None:
        self.status = 130

    def wait(self) -> int:
        assert self.status is not None
        return self.status


def test_an_interrupt_terminates_every_running_process_and_waits_for_it(configs, tmp_path, monkeypatch):
    monkeypatch.setattr(grid, "GRACE_SECONDS", 0.0)
    processes: list[Endless] = []

    def begin(_: Job) -> Endless:
        if len(processes) == 2:
            raise KeyboardInterrupt
        processes.append(Endless())
        return processes[-1]

    with pytest.raises(KeyboardInterrupt):
        run_grid([make_job(configs, tmp_path, seed=seed) for seed in range(3)], 3, tmp_path / "results", begin)
    assert [process.status for process in processes] == [130, 130]


def test_the_time_left_follows_from_the_speed_and_is_unknown_before_the_first_measurement():
    assert time_left(9_000_000, 1000.0) == "1.0 k timesteps/s, 2 h 30 min left"
    assert time_left(9_000_000, 0.0) == "measuring"


def test_the_table_shows_what_all_runs_have_reached_and_the_time_left_leaves_failed_ones_out(configs, tmp_path):
    jobs = [make_job(configs, tmp_path, seed=seed) for seed in (0, 1)]
    for one, reward in zip(jobs, ("2.5", "3.5"), strict=True):
        one.run.mkdir(parents=True)
        (one.run / "metrics-a.csv").write_text(f"timesteps,reward\n1500,1\n3000,{reward}\n")
    display, printed = Display(jobs, finished=[]), io.StringIO()
    display.console = Console(file=printed, width=200)
    display.update([jobs[1]])
    assert display.time_left() == "measuring"
    with (jobs[1].run / "metrics-a.csv").open("a") as metrics:
        metrics.write("4000,3.5\n")
    display.update([jobs[1]])
    assert display.first == {jobs[0]: 3000, jobs[1]: 4000} and display.time_left() == "measuring"
    display.console.print(display.table())
    display.end(jobs[0], "error: it failed")
    display.end(jobs[1], None)
    heads, survive, every, _, failed, done = map(str.split, printed.getvalue().splitlines())
    assert heads == ["experiment", "finished", "running", "timesteps", "reward"]
    assert survive == ["survive", "0", "of", "2", "1", "58", "%", "3"]
    assert every == ["all", "0", "of", "2", "1", "58", "%"]
    assert failed[:5] == ["survive-s0:", "failed:", "error:", "it", "failed"]
    assert done == ["survive-s1:", "done,", "reward", "3.5", "in", "its", "last", "row"]
    assert list(display.first) == [jobs[1]]


@pytest.mark.slow
@pytest.mark.nightly
def test_a_run_that_cannot_be_resumed_exactly_begins_anew(whole, configs, tmp_path):
    plain = make_job(configs, whole.results.parent)
    shutil.copytree(plain.run, tmp_path / "survive-s0")
    left = replace(plain, runs=tmp_path, exact=False, timesteps=2 * TIMESTEPS)
    replace(left, overrides=("policy.epochs=1",)).prepare()
    assert has_checkpoint(left.run)  # of another configuration: the trainer refuses it
    replace(left, exact=True).prepare()
    assert has_checkpoint(left.run) and left.last_row()
    left.prepare()
    assert not has_checkpoint(left.run) and not left.last_row() and (left.run / "log.txt").exists()


def test_results_end_at_the_timesteps_of_the_job_and_never_replace_those_of_another_run(tmp_path):
    birds = Job("shooting_birds/bucket-11", 0, 700_000, ROOT / "configs", tmp_path / "runs")
    birds.run.mkdir(parents=True)
    metrics, name = birds.run / "metrics-hunter.csv", ResultName(birds.name, 700_000)  # of one policy: without it
    metrics.write_text("timesteps,reward\n300024,1.5\n600021,2.5\n900018,3.5\n")
    kept = {name: [{"timesteps": "300024", "reward": "1.5"}, {"timesteps": "600021", "reward": "2.5"}]}
    for _ in range(2):
        keep_results(birds, tmp_path)
        assert read_table(tmp_path) == kept
    metrics.write_text("timesteps,reward\n300024,1.5\n600021,9.5\n")
    with pytest.raises(FileExistsError, match=r"has 0.7M/shooting_birds/bucket-11-s0 of another run; move it away"):
        keep_results(birds, tmp_path)
    assert read_table(tmp_path) == kept


@pytest.mark.slow
@pytest.mark.nightly
def test_a_finished_run_is_unfinished_after_its_configuration_changes(whole, configs):
    plain = make_job(configs, whole.results.parent)
    assert plain.finished()
    other = replace(plain, overrides=("policy.epochs=1",))
    assert not other.finished()
    assert "policy.epochs was 4 and is now 1" in run_grid([other], 1, whole.results)[other]


def test_files_of_a_run_are_copied_and_old_checkpoints_are_deleted(tmp_path):
    there, here = tmp_path / "there", tmp_path / "here"
    first = {
        "metrics-a.csv": b"1",
        "log.txt": b"x",
        "checkpoints/000000000001/arrays": b"a",
        "checkpoints/000000000001/manifest": b"m",
        "checkpoints/best/arrays": b"a",
    }
    best = {"checkpoints/best/arrays": b"b"}
    second = {"metrics-a.csv": b"12", "log.txt": b"xy", "checkpoints/000000000002/arrays": b"b", **best}
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


# Tables


def result(experiment: str, seed: int, policy: str = "", **cells: str) -> dict[ResultName, list[Cells]]:
    """Return a result of one row."""
    return {ResultName(RunName(experiment, seed), 600_000, policy): [{"timesteps": "600000", **cells}]}


def test_the_bytes_of_a_table_do_not_depend_on_the_order_of_its_runs(tmp_path):
    added = [result("a/b", 1, reward="1e-05"), result("a/b", 0, "axes", hits="2.50"), result("c", 0, reward="3")]
    for folder, results in (("one", added), ("other", added[::-1] * 2)):
        for each in results:
            add_results(tmp_path / folder, each)
    assert (tmp_path / "one" / TABLE).read_bytes() == (tmp_path / "other" / TABLE).read_bytes()
    assert read_table(tmp_path / "one") == added[1] | added[0] | added[2]
    assert lzma.decompress((tmp_path / "one" / TABLE).read_bytes()).decode().splitlines() == [
        "run,experiment,seed,total_timesteps,policy,timesteps,hits,reward",
        "0.6M/a/b-s0-axes,a/b,0,600000,axes,600000,2.50,",
        "0.6M/a/b-s1,a/b,1,600000,,600000,,1e-05",
        "0.6M/c-s0,c,0,600000,,600000,,3",
    ]


def test_a_metric_of_a_game_never_takes_the_place_of_a_key():
    keys = [*KEYS, "game", "layout"]
    assert [column_name(key) for key in keys] == [f"game_{key}" for key in keys]
    assert not any(map(is_builtin_metric, KEYS))


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("experiment,seed,total_timesteps,timesteps\na,0,6,many\n", "could not convert string to float: 'many'"),
        ("experiment,seed,total_timesteps,timesteps\na,x,6,3\n", "invalid literal for int"),
        ("experiment,seed,timesteps\na,0,3\n", "invalid literal for int"),
        ("timesteps\n3\n", "invalid literal for int"),
    ],
)
def test_a_damaged_table_is_named_and_stays_as_it_is(text, what, tmp_path):
    whole = lzma.compress(text.encode())
    ends = "its end is missing, is not its end"
    for data, reason in ((whole, what), (whole[:-9], ends), (whole * 2, ends), (b"\0" * 99, "not supported")):
        (tmp_path / TABLE).write_bytes(data)
        with pytest.raises(CheckpointError, match=f"{TABLE} is no table of results .*{reason}.*; move it away"):
            add_results(tmp_path, result("c", 0))
        assert (tmp_path / TABLE).read_bytes() == data


@pytest.mark.slow
@pytest.mark.nightly
def test_finished_runs_of_a_folder_are_packed_into_the_table_of_a_study(whole, tmp_path, capsys):
    folder, study = whole.results.parent, tmp_path / "study"
    kept = read_table(whole.results)
    for _ in range(2):
        assert pack_results.main([str(folder), str(study)]) == 0
        assert {name.run: rows for name, rows in read_table(study).items()} == {
            name.run: rows for name, rows in kept.items()
        }
    shutil.copytree(folder / "survive-s0", tmp_path / "runs" / "longer-s0")
    config = tmp_path / "runs/longer-s0/config.yaml"
    config.write_text(config.read_text().replace("stop_at: 6000", "stop_at: 9000"))
    assert pack_results.main([str(tmp_path / "runs"), str(study)]) == 1
    assert "longer-s0: it has 6,000 of 9,000 timesteps; resume it first" in capsys.readouterr().err


def test_an_experiment_whose_name_contains_a_seed_is_refused(tmp_path):
    with pytest.raises(ValueError, match="'birds-s2-x': '-s2' reads as a seed"):
        Job("birds-s2-x", 0, 1, tmp_path, tmp_path)
