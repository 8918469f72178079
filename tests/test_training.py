"""Training from the command line to the files of a run, and everything that may go wrong with the simulator."""

import json
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from threading import Thread

import av
import numpy as np
import pytest

import joybridge.commands.train as trainer
from joybridge.client.launch import simulator_process
from joybridge.config.metrics import read_rows
from joybridge.run.checkpoint import load_checkpoint
from joybridge.run.collect import assign
from tests.support.command_line import Done, joybridge

pytestmark = pytest.mark.slow

CONFIG = Path(__file__).parents[1] / "configs" / "shooting_birds" / "bucket-11.yaml"
DEADLINE_SECONDS = 200.0
SMALL = [
    "arenas=4",
    "policy.rollout_steps=20",
    "policy.minibatch_size=40",
    "log_interval=400",
    "checkpoint_interval=400",
]


def arguments(run: Path, *more: str, config: Path = CONFIG) -> list[str]:
    return ["train", str(config), "--run", str(run), *more]


def train(run: Path, *more: str, config: Path = CONFIG) -> Done:
    return joybridge(*arguments(run, *more, config=config))


def weights(run: Path) -> dict[str, np.ndarray]:
    return load_checkpoint(run)[0]


def assert_same(one: dict[str, np.ndarray], other: dict[str, np.ndarray]) -> None:
    assert one.keys() == other.keys()
    for name, array in one.items():
        np.testing.assert_array_equal(array, other[name], err_msg=name)


@pytest.fixture(scope="module")
def address():
    with simulator_process() as bound:
        yield bound


@pytest.fixture(scope="module")
def other():
    with simulator_process() as bound:
        yield bound


@pytest.fixture(scope="module")
def whole(address, tmp_path_factory) -> Path:
    """Return a run of 24 updates that was never interrupted."""
    run = tmp_path_factory.mktemp("whole") / "run"
    result = train(run, *SMALL, "stop_at=1900", "--simulator", address)
    assert result.status == 0, result.errors
    return run


def test_a_run_leaves_its_configuration_metrics_events_and_checkpoint(whole):
    assert {path.name for path in whole.iterdir()} == {
        "config.yaml",
        "spec.json",
        "origin.json",
        "simulators.json",
        "metrics-hunter.csv",
        "tensorboard",
        "checkpoints",
        "lock",
    }
    rows = read_rows(whole / "metrics-hunter.csv")
    assert [row["timesteps"] for row in rows] == [400, 800, 1200, 1600]
    for row in rows:
        assert all(row[activity] > 0 for activity in ("simulate", "wire", "act", "learn"))
        assert row["simulate"] + row["wire"] + row["act"] + row["learn"] <= 1.01
        assert 4.0 < row["entropy"] <= np.log(11 * 11 * 3)  # of a policy that has hardly begun
        assert row["timesteps_per_second"] > 0
    assert list((whole / "tensorboard" / "hunter").glob("events*"))
    assert load_checkpoint(whole)[1].timesteps == 1920


@pytest.mark.promise("D2")
def test_the_same_seed_gives_the_same_weights_bit_for_bit_with_a_simulator_of_its_own(whole, tmp_path):
    assert train(tmp_path / "run", *SMALL, "stop_at=1900").status == 0
    assert_same(weights(tmp_path / "run"), weights(whole))


def test_another_seed_gives_other_weights(whole, address, tmp_path):
    assert train(tmp_path / "run", *SMALL, "stop_at=1900", "seed=1", "--simulator", address).status == 0
    name = "hunter/policy/network.actor.head.weight"
    assert (weights(tmp_path / "run")[name] != weights(whole)[name]).any()


def test_groups_are_assigned_to_simulators_and_simulators_to_groups():
    assert assign(["a"], [5, 5, 5]) == [["a"], ["a"], ["a"]]
    assert assign(["a", "b"], [5, 5, 5]) == [["a"], ["b"], ["a"]]
    assert assign(["a", "b", "c"], [5, 5]) == [["a", "c"], ["b"]]
    assert assign(["a", "b", "c"], [1, 1]) == [["a"], ["b"]]  # no simulator without an arena


@pytest.mark.promise("D1")
def test_arenas_spread_over_three_simulators_play_and_learn_the_same(whole, address, other, tmp_path):
    several = ["--simulator", address, "--simulator", other, "--simulator", other]
    result = train(tmp_path / "run", *SMALL, "stop_at=1900", *several)
    assert result.status == 0, result.errors
    for name, array in weights(whole).items():
        if not name.startswith("simulator/"):
            np.testing.assert_array_equal(array, weights(tmp_path / "run")[name], err_msg=name)


@pytest.mark.promise("C3")
def test_a_stopped_run_resumes_to_the_same_bits(whole, address, other, tmp_path):
    run = tmp_path / "run"
    assert train(run, *SMALL, "stop_at=700", "--simulator", address).status == 0
    again = train(run, *SMALL, "stop_at=1900", "--simulator", address)
    assert again.status == 1
    assert "name another folder with --run, or continue it with joybridge train --resume" in again.errors
    both = ["--simulator", address, "--simulator", other]  # one for each group, where there was one for both
    assert train(run, *SMALL, "stop_at=1900", "--resume", *both).status == 0
    assert_same(weights(run), weights(whole))
    figures = [
        {k: v for k, v in r.items() if k in ("timesteps", "value", "entropy", "policy_loss")}
        for path in (run, whole)
        for r in read_rows(path / "metrics-hunter.csv")
    ]
    assert len(figures) == 8
    assert figures[:4] == figures[4:]


def wait_for_rows(run: Path, count: int = 1) -> None:
    deadline = time.monotonic() + DEADLINE_SECONDS
    while len(read_rows(run / "metrics-hunter.csv")) < count:
        assert time.monotonic() < deadline
        time.sleep(0.02)


@contextmanager
def trainer_with_a_row(run: Path, *command: str) -> Iterator[tuple[subprocess.Popen[str], Path]]:
    """Run a trainer that starts its simulator until it has written a row; yield it and that simulator in /proc."""
    rows = len(read_rows(run / "metrics-hunter.csv"))
    with subprocess.Popen(
        [sys.executable, "-m", "joybridge", *command], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            wait_for_rows(run, rows + 1)
            (child,) = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
            yield process, Path(f"/proc/{child}")
        finally:
            process.kill()


def resume_and_compare(run: Path, tmp_path: Path, address: str, *more: str, config: Path = CONFIG) -> None:
    """Resume a run that was cut off; it must end like one that was not."""
    done = load_checkpoint(run)[1].timesteps
    settings = [*SMALL, *more, f"stop_at={done + 300}", "--simulator", address]
    assert train(run, *settings, "--resume", config=config).status == 0
    assert train(tmp_path / "straight", *settings, config=config).status == 0
    assert_same(weights(run), weights(tmp_path / "straight"))


def test_a_simulator_killed_in_the_middle_gives_an_error_a_checkpoint_and_an_exact_resumption(address, tmp_path):
    run = tmp_path / "run"
    with subprocess.Popen(
        [sys.executable, "-m", "joybridge.simulator", "serve", "--address", "127.0.0.1:0"],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    ) as server:
        assert server.stdout is not None
        own = server.stdout.readline().split()[-1]

        def kill() -> None:
            try:
                wait_for_rows(run)
            finally:
                server.kill()

        killer = Thread(target=kill)
        killer.start()
        result = train(run, *SMALL, "--simulator", own, "--wait", "1")
        killer.join()
    assert result.status == 1
    assert f"no simulator at {own} after 1 s" in result.errors
    assert re.search(r"saved at [\d,]+ timesteps; continue with: joybridge train .* --resume", result.errors)
    resume_and_compare(run, tmp_path, address)


@pytest.mark.promise("F5")
def test_an_interrupted_run_saves_ends_its_simulator_and_resumes_exactly_as_often_as_one_likes(address, tmp_path):
    run = tmp_path / "run"
    command = arguments(run, *SMALL)
    for number in (signal.SIGINT, signal.SIGTERM):
        with trainer_with_a_row(run, *command) as (process, simulator):
            process.send_signal(number)
            _, errors = process.communicate(timeout=DEADLINE_SECONDS)
        assert process.returncode == 130
        assert "Traceback" not in errors
        assert not simulator.exists()
        command = errors.partition("continue with: joybridge ")[2].splitlines()[0].split()
        assert "--resume" in command
    assert joybridge(*command, "stop_at=20").status == 0
    resume_and_compare(run, tmp_path, address)


def test_a_killed_run_that_sees_images_resumes_to_the_same_bits(address, tmp_path):
    run, config = tmp_path / "run", CONFIG.with_name("screen.yaml")
    stacks = [
        "policy.frame_stack=3",
        "policy.shared_encoder=false",
        "policy.shared_body=false",
        "options.fovea_size=24",
    ]
    with trainer_with_a_row(run, *arguments(run, *SMALL, *stacks, config=config)) as (process, _):
        wait_for_rows(run, 2)  # so that there is a checkpoint, that of the first row
        process.kill()
    arrays = load_checkpoint(run)[0]
    pictures = [array for array in arrays.values() if array.dtype == np.uint8 and array.shape[1:] == (3, 24, 24, 1)]
    assert len(pictures) == 2 and all(array.std() > 0 for array in pictures)  # of both images, and not black
    resume_and_compare(run, tmp_path, address, *stacks, config=config)


@pytest.mark.promise("L4")
def test_a_simulator_that_is_not_up_yet_is_waited_for(tmp_path, monkeypatch):
    address = f"unix:{tmp_path}/simulator.sock"
    servers: list[subprocess.Popen[bytes]] = []

    def serve(text: str) -> None:
        if not servers and re.fullmatch(rf"waiting for a simulator at {address}, 1\d\d s more: there is no .*", text):
            command = [sys.executable, "-m", "joybridge.simulator", "serve", "--address", address]
            servers.append(subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))

    monkeypatch.setattr(trainer, "say", serve)
    result = train(tmp_path / "run", *SMALL, "stop_at=160", "--simulator", address)
    (server,) = servers
    server.terminate()
    server.wait()
    assert result.status == 0, result.errors


def test_resuming_with_another_configuration_or_number_of_simulators_is_refused(address, tmp_path):
    run = tmp_path / "run"
    assert train(run, *SMALL, "stop_at=100", "--simulator", address).status == 0
    changed = train(run, *SMALL, "seed=4", "--resume", "--simulator", address)
    assert "seed was 0 and is now 4" in changed.errors
    three = train(run, *SMALL, "stop_at=400", "--resume", *["--simulator", address] * 3)
    assert (
        "the checkpoint holds 2 sessions, but 2 groups at 3 simulators make 3; resume with 2 simulators" in three.errors
    )


def test_evaluation_balances_levels_and_prints_json_last(whole, address):
    result = joybridge("evaluate", str(whole), "--episodes", "7", "--json", "--simulator", address)
    assert result.status == 0, result.errors
    report = json.loads(result.output.splitlines()[-1])["hunter"]
    assert report["episodes"] == 7
    assert sorted(report["by_choice"]) == list("0123456")
    assert report["means"]["length"] == 2000
    assert report["means"]["reward"] == pytest.approx(np.mean(list(report["by_choice"].values())))
    assert -1000 < report["means"]["reward"] < 20  # hardly trained


def test_a_recording_is_a_video_of_the_length_asked_for(whole, address, tmp_path):
    video = tmp_path / "folder" / "play.mp4"
    assert joybridge("record", str(whole), str(video), "--seconds", "2", "--simulator", address).status == 0
    with av.open(str(video)) as file:
        assert file.streams.video[0].average_rate == 25
        frames = [frame.to_ndarray(format="rgb24") for frame in file.decode(video=0)]
    assert len(frames) == 50
    assert frames[0].shape == (400, 640, 3)
    assert frames[0].std() > 10
    assert (frames[0] != frames[-1]).mean() > 0.01


def test_multiagent_trains_two_policies_with_their_own_rollouts_on_the_same_lanes(address, tmp_path):
    run = tmp_path / "run"
    config = CONFIG.with_name("multiagent.yaml")
    small = ["arenas=4", "policy.rollout_steps=20", "policies.axes.rollout_steps=40", "log_interval=800"]
    result = train(run, *small, "stop_at=1600", "--simulator", address, config=config)
    assert result.status == 0, result.errors
    arrays = weights(run)
    assert int(arrays["axes/policy/updates"]) * 2 == int(arrays["buttons/policy/updates"]) == 20
    rows = {name: read_rows(run / f"metrics-{name}.csv") for name in ("axes", "buttons")}
    assert [row["timesteps"] for row in rows["axes"]] == [row["timesteps"] for row in rows["buttons"]]
    assert arrays["axes/policy/observations"].shape == (4, 3 * 42)
    assert arrays["buttons/policy/observations"].shape == (4, 3 * 44)
