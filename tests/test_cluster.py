"""A Ray cluster: simulators on its nodes, which may be lost, and grids of runs."""

import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from joybridge.cli import main as trainer
from joybridge.client.client import list_games
from joybridge.client.errors import SimulatorError, SimulatorLost
from joybridge.client.simulator_source import (
    FILE,
    SimulatorSource,
    choose_simulators,
    last_simulators,
    open_simulators,
    remember,
)
from joybridge.compare import run_grid
from joybridge.contract.credentials import Credentials, ProtectedAddress
from joybridge.ray_cluster import program as ray_program
from joybridge.ray_cluster.program import Simulator, start_all
from joybridge.ray_cluster.simulators import PRIVATE, join_cluster
from joybridge.run.train import train
from joybridge.run.training import Audience
from tests.support.jobs import train_here
from tests.test_experiments import command_line, figures, make_job, write_configs
from tests.test_recovery import CONFIG, LANES, ROLLOUT, outcome

pytestmark = pytest.mark.nightly

ROOT = Path(__file__).parents[1]
NOWHERE = "127.0.0.1:1"


class Nodes:
    """A cluster on this machine: a head without cores, and two nodes with a core each."""

    def __init__(self) -> None:
        from ray.cluster_utils import Cluster

        self.cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
        self.nodes = [self.cluster.add_node(num_cpus=1, wait=False) for _ in range(2)]

    def replace(self) -> None:
        """Add a node with two cores, and kill the two others."""
        self.cluster.add_node(num_cpus=2, wait=False)
        while self.nodes:
            self.cluster.remove_node(self.nodes.pop(), allow_graceful=False)


def gone(address: str) -> bool:
    try:
        return not list_games(address)
    except SimulatorLost:
        return True


@pytest.fixture(scope="module")
def nodes() -> Iterator[Nodes]:
    with pytest.MonkeyPatch.context() as environment:
        for name, value in PRIVATE.items():
            environment.setenv(name, value)
        made = Nodes()
        yield made
        made.cluster.shutdown()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")  # of Ray
def test_a_run_whose_simulators_lose_their_nodes_ends_like_one_on_this_machine(nodes, simulator, tmp_path, caplog):
    train(CONFIG, tmp_path / "here", [simulator], resume=False)
    used: list[list[str]] = []

    def report(timesteps: int, *_: object) -> None:
        if timesteps >= LANES * ROLLOUT * 2 + LANES and nodes.nodes:
            nodes.replace()
            while not all(map(gone, used[0])):
                pass

    with open_simulators(SimulatorSource(cluster=nodes.cluster.address, count=2), 60.0, print) as start:

        def connect() -> Sequence[str]:
            used.append(list(start()))
            return used[-1]

        train(CONFIG, tmp_path / "there", connect(), resume=False, audience=Audience(report), revive=connect)
    assert outcome(tmp_path / "there") == outcome(tmp_path / "here")
    assert len(used) == 2 and len(set(used[0]) | set(used[1])) == 4
    assert "training goes on from 128 timesteps (restart 1 of 5)" in caplog.text
    assert all(map(gone, used[1]))


@pytest.mark.slow
def test_a_grid_on_the_cluster_resumes_a_run_to_the_same_results_and_reports_failures(nodes, simulator, tmp_path):
    configs = write_configs(tmp_path)
    whole, half = make_job(configs, tmp_path / "whole"), make_job(configs, tmp_path / "runs")
    here = ("--simulator", simulator)
    run_grid([replace(whole, arguments=here)], 1, tmp_path / "results", train_here)
    assert train_here(replace(half, timesteps=half.timesteps // 2, arguments=here)).status == 0
    more = ("--experiments", "fail", "survive", "--backend", "ray", "--address", nodes.cluster.address)
    result = subprocess.run(
        [sys.executable, "-m", "tools.paper", *command_line(configs, half.runs, *more)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 1
    assert "survive-s0: done" in result.stdout
    assert "failed: fail-s0: unknown key 'arenaz'; did you mean 'arenas'?" in result.stderr
    assert figures(half.runs / "results") == figures(tmp_path / "results")


# Without a cluster


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            ["--ray", NOWHERE, "--simulator", NOWHERE],
            "--ray starts simulators, --simulator names running ones; give one",
        ),
        (["--simulators", "2"], "--simulators says how many a Ray cluster starts; name the cluster with --ray"),
        (["--ray", NOWHERE, "--simulators", "0"], "argument --simulators: got '0', expected an integer of at least 1"),
    ],
)
def test_options_that_contradict_each_other_are_refused(options, message, capsys):
    with pytest.raises(SystemExit):
        trainer(["train", "archer/hybrid", *options])
    assert message in capsys.readouterr().err


def test_more_simulators_than_arenas_are_refused(capsys, tmp_path, signals):
    assert trainer(["train", "archer/hybrid", "--run", str(tmp_path), "--ray", NOWHERE, "--simulators", "33"]) == 1
    assert "error: --simulators got 33, but the run has 32 arenas to divide" in capsys.readouterr().err


def test_a_cluster_that_is_not_there_is_named(capsys, tmp_path, signals):
    assert trainer(["train", "archer/hybrid", "--run", str(tmp_path), "--ray", NOWHERE]) == 1
    assert f"error: no Ray cluster at {NOWHERE}: nothing listens there; start it with" in capsys.readouterr().err
    with pytest.raises(SystemExit, match="no Ray cluster at auto: expected HOST:PORT of its head"):
        join_cluster("auto")


@pytest.fixture
def host(monkeypatch) -> None:
    """Let Ray say that this is the node 127.0.0.1."""
    monkeypatch.setitem(sys.modules, "ray.util", SimpleNamespace(get_node_ip_address=lambda: "127.0.0.1"))


def test_a_node_with_another_version_or_without_the_package_is_named(host, monkeypatch):
    repair = r"install it there with `pip install 'joybridge\[simulator,cluster\]==0.0.9'`"
    found = f"node 127.0.0.1: joybridge {version('joybridge')} is installed, but the trainer has 0.0.9; {repair}"
    with pytest.raises(RuntimeError, match=found):
        Simulator().start("0.0.9", [])
    monkeypatch.setattr(ray_program, "version", Mock(side_effect=PackageNotFoundError))
    with pytest.raises(RuntimeError, match=f"node 127.0.0.1: joybridge is not installed; {repair}"):
        Simulator().start("0.0.9", [])


def test_a_simulator_on_a_node_demands_its_token_over_tls_and_leaves_no_key(host, monkeypatch, tmp_path):
    if shutil.which("openssl") is None:
        pytest.skip("openssl makes the certificate")
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    started = Simulator()
    address, certificate, token = started.start(version("joybridge"), [])
    with started.running:
        credentials = Credentials(certificate.encode(), token)
        assert "archer" in list_games(ProtectedAddress(address, credentials))
        with pytest.raises(SimulatorError, match="this server requires a token"):
            list_games(ProtectedAddress(address, replace(credentials, token="")))
        with pytest.raises(SimulatorLost):
            list_games(address)
        assert list(tmp_path.iterdir()) == []


def test_a_node_without_openssl_says_so(host, monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(RuntimeError, match="the program openssl, which makes certificates, is missing"):
        Simulator().start(version("joybridge"), [])


def test_a_cluster_with_too_few_cores_is_waited_for_and_named(capsys):
    ray = SimpleNamespace(
        wait=lambda started, **_: (started[:1], started[1:]),
        get=list,
        exceptions=SimpleNamespace(RayError=OSError),
        available_resources=dict,
        cluster_resources=lambda: {"CPU": 1.0},
    )
    message = "1 of 3 simulators started within 60 s: 0 of 1 cores of the cluster are free, and a simulator needs one;"
    with pytest.raises(SystemExit, match=message):
        start_all(ray, [Mock(), Mock(), Mock()], [], 60.0)
    assert "waiting up to 60 s for 2 of 3 simulators: 0 of 1 cores" in capsys.readouterr().err


def test_a_run_remembers_games_but_no_cluster_and_the_cluster_gets_its_games(tmp_path):
    remember(tmp_path, SimulatorSource(games=("a:B",), cluster=NOWHERE, count=2), print)
    assert last_simulators(tmp_path).simulators == SimulatorSource(games=("a:B",))
    (tmp_path / FILE).write_text(f'{{"games": ["a:B"], "cluster": "{NOWHERE}", "count": 2}}')
    assert last_simulators(tmp_path).simulators == SimulatorSource(games=("a:B",))
    wanted = SimulatorSource(cluster=NOWHERE, count=2)
    assert wanted.arguments() == ["--ray", NOWHERE, "--simulators", "2"]
    chosen = choose_simulators(wanted, last_simulators(tmp_path), CONFIG, print, trust=True)
    assert chosen == replace(wanted, games=("a:B",))
