"""Files of earlier versions, in tests/data/VERSION with the commit that wrote them: they are read, or refused by name.

A version that gives up a format replaces nothing there: the test then wants the sentence that names the format.
The contract of each version lies there, too: a session needs nothing that is newer.
"""

import json
import shutil
from contextlib import suppress
from pathlib import Path

import grpc
import numpy as np
import pytest
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from joybridge.client.client import Session, describe
from joybridge.client.recording import RecordingError
from joybridge.client.stream import SERVICE
from joybridge.config.config import load_config
from joybridge.config.metrics import read_rows
from joybridge.demonstrations.files import load_demonstration
from joybridge.layouts import make_acts
from joybridge.layouts.random_acts import obey_masks, press_at_random
from tests.support.command_line import joybridge
from tests.support.exported_runs import RUNTIME, load_runtime
from tests.support.servers import answering_methods
from tests.support.wire import SECONDS

VERSIONS = sorted(path for path in (Path(__file__).parent / "data").glob("[0-9]*") if path.is_dir())


def test_there_are_versions_and_each_names_its_commit():
    assert VERSIONS
    assert all(len((folder / "COMMIT").read_text().strip()) == 40 for folder in VERSIONS)


@pytest.mark.parametrize("folder", VERSIONS, ids=lambda folder: folder.name)
@pytest.mark.promise("C4")
def test_a_run_plays_as_it_did_or_its_format_is_named(folder, simulator, tmp_path):
    shutil.copytree(folder / "run", tmp_path / "run")
    assert load_config(tmp_path / "run/config.yaml").game == "archer"
    assert read_rows(tmp_path / "run/metrics-archer.csv")[-1]["timesteps"] == 480
    done = joybridge(
        "evaluate", str(tmp_path / "run"), "--episodes", "4", "--seed", "3", "--json", "--simulator", simulator
    )
    if done.status:
        assert "use the version of joybridge that wrote it" in done.errors
    else:
        means = json.loads(done.output.splitlines()[-1])["archer"]["means"]
        wanted = json.loads((folder / "evaluation.json").read_text())["archer"]["means"]
        assert means == pytest.approx(wanted)


@pytest.mark.parametrize("folder", VERSIONS, ids=lambda folder: folder.name)
@pytest.mark.promise("C4")
def test_a_demonstration_is_read_or_its_format_is_named(folder, simulator):
    try:
        demonstration = load_demonstration(folder / "archer-0001.demo", describe(simulator, "archer", {}))
    except RecordingError as error:
        if "use the version of its time" not in str(error):
            raise
    else:
        assert demonstration.episodes(0)[0] >= 4


@pytest.mark.parametrize("folder", VERSIONS, ids=lambda folder: folder.name)
@pytest.mark.promise("C4")
def test_a_policy_is_played_or_its_format_is_named(folder):
    try:
        policy = load_runtime(RUNTIME).Policy(folder / "policy.json")
    except ValueError as error:
        if "write it with `joybridge export RUN policy.json`" not in str(error):
            raise
    else:
        sensors = {one["name"]: np.zeros((1, *one["shape"])) for one in policy.sensors}
        axes, choices, _ = policy.act(sensors, policy.begin(1), np.random.default_rng(0))
        assert np.isfinite(axes).all() and choices.shape == (1, len(policy.branches))


@pytest.mark.parametrize("folder", VERSIONS, ids=lambda folder: folder.name)
@pytest.mark.promise("P5")
def test_a_session_is_the_same_if_neither_side_hears_what_is_newer_than_a_version(folder, simulator):
    """Between trainer and simulator, each message loses the fields that the version does not know."""
    pool = descriptor_pool.DescriptorPool()
    for file in descriptor_pb2.FileDescriptorSet.FromString((folder / "bridge.binpb").read_bytes()).file:
        pool.Add(file)
    newer = []

    def reduce(kind, data):
        message = message_factory.GetMessageClass(pool.FindMessageTypeByName(f"joybridge.v1.{kind}")).FromString(data)
        before = message.ByteSize()
        message.DiscardUnknownFields()
        newer.append(before - message.ByteSize())
        return message.SerializeToString()

    with grpc.insecure_channel(simulator) as channel:
        play = channel.stream_stream(f"/{SERVICE}/Play")

        def describe_game(data, context):
            call = channel.unary_unary(f"/{SERVICE}/DescribeGame")
            return reduce("DescribeGameResponse", call(reduce("DescribeGameRequest", data), timeout=SECONDS))

        def requests_of(trainer):
            with suppress(grpc.RpcError):  # it has left
                for data in trainer:
                    yield reduce("PlayRequest", data)

        def pass_on(trainer, context):
            for response in play(requests_of(trainer), timeout=SECONDS):
                yield reduce("PlayResponse", response)

        with answering_methods(DescribeGame=describe_game, Play=pass_on) as earlier:
            assert play_noughts(earlier) == play_noughts(simulator)
    assert sum(newer) > 0 or folder is not VERSIONS[0]  # noughts has scripts, which are newer than the first


def play_noughts(address):
    """Return the bytes of twenty decisions in two arenas."""
    random, played = np.random.default_rng(3), []
    with Session(address, "noughts", arenas=2, seed=3, transport="grpc") as session:
        acts = make_acts(session.spec, 2)
        for _ in range(20):
            for behavior, chosen, step in zip(session.spec.behaviors, acts, session.steps, strict=True):
                press_at_random(behavior.device, chosen, random)
                obey_masks(chosen, step, random)
            for step in session.step(acts):
                played += [array.tobytes() for array in (*step.observations, step.rewards, step.terminated)]
    return played
