"""The server in TypeScript: built from nothing, held to the contract, trained, and ended, as a process of its own.

Its name keeps it out of `make test`: tools/check_typescript.py runs it.
"""

import json
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import grpc
import numpy as np
import pytest

from joybridge.client.client import Session
from joybridge.config.metrics import read_rows
from joybridge.contract.codec import ActArrays
from joybridge.v1 import bridge_pb2 as pb
from tests.support.chromium import PROGRAM, chromium
from tests.support.wire import Stream, refused, start

ROOT = Path(__file__).parents[1]
SOURCE = ROOT / "proto" / "examples" / "typescript"
CONFIG = ROOT / "configs" / "meteors" / "hybrid.yaml"


def run(*command: str, folder: Path = ROOT) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=600, check=False)


@pytest.fixture(scope="module")
def built(tmp_path_factory) -> Path:
    """Return a folder with the server, built there as its README says."""
    proto = tmp_path_factory.mktemp("typescript") / "proto"
    folder = proto / "examples" / "typescript"
    shutil.copytree(SOURCE, folder, ignore=shutil.ignore_patterns("node_modules", "dist", "types"))
    shutil.copytree(SOURCE.parent / "javascript", folder.parent / "javascript")
    contract = Path("joybridge") / "v1" / "bridge.proto"
    (proto / contract).parent.mkdir(parents=True)
    shutil.copy(SOURCE.parents[1] / contract, proto / contract)
    for command in (("npm", "ci"), ("npm", "run", "build")):
        done = run(*command, folder=folder)
        assert done.returncode == 0, done.stdout + done.stderr
    return folder


@contextmanager
def serving(folder: Path, *more: str) -> Iterator[tuple[subprocess.Popen[str], str]]:
    """Run the server and yield its process and its address."""
    command = ["node", "dist/main.js", "--address", "127.0.0.1:0", *more]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            assert re.fullmatch(r"joybridge simulator listening on 127\.0\.0\.1:\d+\n", line), process.communicate()
            yield process, line.split()[-1]
        finally:
            process.kill()


@pytest.fixture(scope="module")
def address(built) -> Iterator[str]:
    with serving(built) as (_, bound):
        yield bound


def test_it_keeps_every_rule_of_the_contract(address):
    done = run(sys.executable, "-m", "joybridge", "check", address, "--json")
    report = json.loads(done.stdout.splitlines()[-1])
    assert done.returncode == report["failed"] == 0, done.stdout
    assert {result["game"] for result in report["results"]} == {"server", "meteors"}
    passed = {result["check"] for result in report["results"] if result["outcome"] == "passed"}
    assert passed >= {  # some that apply only to a game that has what they are about
        "masked_choice_is_refused",
        "axis_above_high_is_refused",
        "metrics_have_a_row_per_ended_lane",
        "pictures_are_in_the_order_of_draw",
        "parameter_omitted_by_reset_keeps_its_value",
        "started_has_the_spec_of_describe_for_every_choice",
        "ended_lanes_match_the_flags",
        "arena_does_not_depend_on_the_number_of_arenas",
        "save_is_refused_without_snapshots",
    }


def test_with_a_token_every_other_call_is_refused(built, tmp_path):
    token = tmp_path / "token"
    token.write_text("0123456789abcdef\n")
    token.chmod(0o600)
    with serving(built, "--token-file", str(token)) as (_, bound):
        done = run(
            sys.executable,
            "-m",
            "joybridge",
            "check",
            bound,
            "--token-file",
            str(token),
            "--family",
            "security",
            "--family",
            "games",
            "--family",
            "health_and_reflection",
            "--json",
        )
    report = json.loads(done.stdout.splitlines()[-1])
    assert done.returncode == report["failed"] == report["not_applicable"] == 0, done.stdout
    # gRPC for Node.js unpacks compressed messages; its limit bounds what comes out.
    warned = [result["check"] for result in report["results"] if result["outcome"] == "warning"]
    assert warned == ["compressed_messages_are_refused"]


def test_it_does_not_listen_to_other_machines_without_tls_and_a_token(built):
    done = run("node", "dist/main.js", "--address", "0.0.0.0:0", folder=built)
    assert done.returncode == 2
    assert "which needs --tls-cert, --tls-key and --token-file; give them, or listen on 127.0.0.1" in done.stderr


@pytest.mark.parametrize("name", ["__proto__", "constructor", "toString", "🚀" * 5000, "\ufffe"])
def test_names_that_mean_something_to_javascript_or_are_hard_to_tell_are_refused_like_any_other(name, address):
    for fields, text in (({"options": {name: "x"}}, "unknown option"), ({"parameters": {name: 1.0}}, "unknown param")):
        code, details = refused(address, start("meteors", **fields))
        assert code == grpc.StatusCode.INVALID_ARGUMENT
        assert text in details and name[:9] in details
    assert refused(address, start(name))[0] == grpc.StatusCode.NOT_FOUND


def test_a_client_that_needs_a_newer_revision_is_refused_with_both_versions_and_the_fix(address):
    code, details = refused(address, start("meteors", version=pb.Version(product="joybridge 9.1", revision=3)))
    assert code == grpc.StatusCode.FAILED_PRECONDITION
    assert details == (
        "the client (joybridge 9.1) needs contract revision 3, the simulator (meteors 0.1.0) has revision 2; "
        "update the simulator, or use a client of its version"
    )


@pytest.mark.parametrize("sky", ["calm", "windy"])
def test_a_town_that_is_defended_stands_until_the_time_is_up_and_another_falls(sky, address):
    with Session(address, "meteors", arenas=2, seed=3, options={"sky": sky}) as session:
        ends: list[list[tuple[bool, float, float, float]]] = [[], []]
        for _ in range(200):
            (step,) = session.steps
            gun, meteor, _ = step.observations
            assert step.masks is not None
            aim = meteor[:, 0] + 0.04 * meteor[:, 2] - gun[:, 0]
            steer = np.clip(aim / 0.15, -1, 1)
            shoot = step.masks[0][:, 1] & (np.abs(aim) < 0.2) & [True, False]  # arena 1 holds its fire
            (step,) = session.step([ActArrays(steer[:, None].astype("<f4"), shoot[:, None].astype("<i4"))])
            for row, lane in enumerate(step.ended):
                assert step.final_observations is not None and step.metrics is not None
                houses = step.final_observations[2][row, 0]
                accuracy, left = step.metrics[row].tolist()
                ends[lane].append((bool(step.truncated[lane]), float(houses), accuracy, left))
    ((cut, houses, accuracy, left),) = ends[0]
    assert cut and houses == 1 and left == 3 and accuracy > 0.9
    assert len(ends[1]) == 3
    assert set(ends[1]) == {(False, 0.0, 0.0, 0.0)}


@pytest.fixture(scope="module")
def trained(address, tmp_path_factory) -> Path:
    """Return a run that has learned the game."""
    folder = tmp_path_factory.mktemp("trained") / "run"
    command = [sys.executable, "-m", "joybridge", "train", str(CONFIG), "--simulator", address, "--run", str(folder)]
    done = run(*command, "seed=0", "stop_at=80000")
    assert done.returncode == 0, done.stderr
    return folder


@pytest.fixture(scope="module")
def policy(trained, address) -> str:
    """Return the exported policy of that run."""
    file = str(trained / "policy.json")
    done = run(sys.executable, "-m", "joybridge", "export", str(trained), file, "--simulator", address)
    assert done.returncode == 0, done.stderr
    return file


def test_a_policy_learns_the_game(trained):
    rewards = [row["reward"] for row in read_rows(trained / "metrics-gunner.csv")]
    assert rewards[0] < 0  # most of the town is lost and most shots miss
    assert rewards[-1] > 10


def test_an_exported_policy_plays_without_a_trainer_and_without_grpc(built, policy, tmp_path):
    shutil.copytree(built.parent, tmp_path / "examples", ignore=shutil.ignore_patterns("node_modules"))
    command = ["node", "dist/main.js", "--policy", policy, "--episodes", "20"]
    first, second, other = (
        run(*command, "--seed", seed, folder=tmp_path / "examples" / "typescript") for seed in ("1", "1", "2")
    )
    assert first.returncode == 0, first.stderr
    assert first.stdout.startswith("20 episodes, mean and 95 % confidence\n  reward ")
    assert float(first.stdout.splitlines()[1].split()[1]) > 10
    assert first.stdout == second.stdout != other.stdout


def test_a_policy_of_another_game_is_refused(built, policy, tmp_path):
    document = json.loads(Path(policy).read_text()) | {"game": "paddle"}
    (tmp_path / "policy.json").write_text(json.dumps(document))
    done = run("node", "dist/main.js", "--policy", str(tmp_path / "policy.json"), folder=built)
    assert done.returncode == 2
    assert done.stderr == "error: the policy plays paddle, expected meteors; export a run of meteors\n"


@pytest.mark.skipif(PROGRAM is None, reason="needs Chromium: apt-get install chromium")
def test_the_page_plays_the_policy_in_a_browser(built, policy, tmp_path):
    for given in ((), ("--", policy)):
        done = run("npm", "run", "page", *given, folder=built)
        assert done.returncode == 0, done.stdout + done.stderr
        shutil.copy(built / "dist" / "meteors.html", tmp_path / f"{len(given)}.html")
    with chromium(tmp_path / "profile") as browser:
        tab = browser.tab()
        tab.go((tmp_path / "0.html").as_uri())
        tab.wait("document.querySelector('#prompt')?.textContent.startsWith('Choose a policy.json')")
        tab.choose("#file", str(tmp_path / "0.html"))
        tab.wait("document.querySelector('#prompt').textContent.startsWith('this is no joybridge.policy')")
        for page, file in (("0.html", policy), ("2.html", None)):
            tab.go((tmp_path / page).as_uri())
            tab.wait(f"location.pathname.endsWith('{page}') && document.querySelector('#speed')")
            if file:
                tab.choose("#file", file)
            tab.value("document.querySelector('#speed').value = '20'")
            tab.wait("document.querySelector('#nights').textContent === '1'")
            assert float(tab.text("#mean")) > 0
        document = Path(policy).read_text()
        sensor = json.loads(document)["sensors"][0]["name"]
        (tmp_path / "blind.json").write_text(document.replace(f'"{sensor}"', '"unseen"'))  # the first decision fails
        tab.choose("#file", str(tmp_path / "blind.json"))
        tab.wait("!document.querySelector('#prompt').hidden && document.querySelector('#pause').disabled")
        assert tab.errors == []


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_in_order(number, built):
    with serving(built) as (process, bound), Stream(bound) as stream:
        stream.ask(start("meteors"))
        process.send_signal(number)
        assert stream.end() == (grpc.StatusCode.UNAVAILABLE, "the server is shutting down")
        assert process.wait(60) == 0
        assert process.communicate() == ("", "")


def test_more_sessions_than_it_takes_are_refused_until_one_ends(built):
    with serving(built, "--sessions", "1") as (_, bound):
        for _ in range(3):
            with Stream(bound) as stream:
                stream.ask(start("meteors"))
                code, text = refused(bound, start("meteors"))
                assert (code, text.split(";")[0]) == (grpc.StatusCode.RESOURCE_EXHAUSTED, "1 sessions are open already")
                stream.requests.put(None)
                assert list(stream.responses) == []


def test_an_address_that_is_taken_is_an_error_in_one_sentence(built, address):
    done = run("node", "dist/main.js", "--address", address, folder=built)
    assert done.returncode == 2
    assert f"error: cannot listen on {address}: " in done.stderr
