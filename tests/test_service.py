"""Every promise of bridge.proto, over real sockets between real processes."""

import re
import signal
import socket
import stat
import subprocess
import sys
import time
from importlib import metadata

import grpc
import numpy as np
import pytest
from grpc import StatusCode
from grpc_health.v1 import health_pb2, health_pb2_grpc
from grpc_reflection.v1alpha.proto_reflection_descriptor_database import ProtoReflectionDescriptorDatabase

from joybridge.contract.address import READY
from joybridge.contract.codec import Codec, Format, pack
from joybridge.contract.spec import check_spec
from joybridge.contract.versions import REVISION
from joybridge.games import BUILT_IN
from joybridge.simulator.catalog import CatalogError, load_games
from joybridge.v1 import bridge_pb2 as pb
from joybridge.v1 import bridge_pb2_grpc as rpc
from tests.support.games import FAULTS, PICTURE, PLACES
from tests.support.measured import measured
from tests.support.servers import ROOT, end, games, refuses_to_start, server
from tests.support.wire import SAVE, SECONDS, Player, Stream, act, describe, record, refused, reset, rows, start

OWN = ["hybrid", "duel", "ends", "raises", "faulty", "batch"]
PAPER = ["beastly_rivals", "beastly_rivals_full", "shooting_birds"]  # built-in games that draw and save themselves
LISTED = [*BUILT_IN, *OWN]
GOOD = ["hybrid", "duel", "ends", *BUILT_IN]
LARGEST_SEED = 2**64 - 1


@pytest.fixture(scope="module")
def simulator():
    """Yield the address of a server process that is measured if the tests are."""
    command = [*measured("joybridge.simulator"), "serve", "--address", "127.0.0.1:0", "--with-parent", *games(*PLACES)]
    with subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        yield process.stdout.readline().removeprefix(READY).strip()
        process.terminate()


def floats(*values):
    return pack(np.array(values, np.float32))


def integers(*values):
    return pack(np.array(values, np.int32))


def hybrid(axes=((0.0, 1.0), (0.0, 1.0)), choices=((0, 0), (0, 0)), draw=()):
    """Return an Act for two arenas of `hybrid`."""
    return act(pb.BehaviorAct(axes=floats(*axes), choices=integers(*choices)), draw=draw)


def press(lanes=2, draw=()):
    """Return an Act for a game with a single button."""
    return act(pb.BehaviorAct(choices=integers(*[[1]] * lanes)), draw=draw)


# ------------------------------------------------------------------------------------------------- the unary calls


def test_the_games_are_listed_and_described_as_they_say(simulator):
    with grpc.insecure_channel(simulator) as channel:
        stub = rpc.SimulatorServiceStub(channel)
        games = stub.ListGames(pb.ListGamesRequest(), timeout=SECONDS).games
        assert [game.name for game in games] == LISTED
        for game in games:
            spec = stub.DescribeGame(pb.DescribeGameRequest(game=game.name), timeout=SECONDS).spec
            check_spec(spec)
            assert (spec.name, spec.description) == (game.name, game.description) and spec.description


def unary_refusal(address, method, request):
    with grpc.insecure_channel(address) as channel, pytest.raises(grpc.RpcError) as caught:
        getattr(rpc.SimulatorServiceStub(channel), method)(request, timeout=SECONDS)
    return caught.value.code(), caught.value.details()


def test_an_unknown_game_is_not_found_by_its_name(simulator):
    for game in ("chess", "", "Hybrid", "hybrid ", "tests.support.games:Hybrid"):
        next_move = "name one of your own as MODULE:CLASS, in `serve` and `train` after --game"
        text = f"no game named {game!r}; this server has {', '.join(LISTED)}; {next_move}"
        wanted = (StatusCode.NOT_FOUND, text)
        assert unary_refusal(simulator, "DescribeGame", pb.DescribeGameRequest(game=game)) == wanted
        assert refused(simulator, start(game)) == wanted


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"colour": "red"}, "hybrid: unknown option 'colour', expected one of size, masks"),
        ({"size": "huge"}, "hybrid: option 'size' got 'huge', expected one of small, large"),
        ({"size": ""}, "hybrid: option 'size' got '', expected one of small, large"),
        ({"": "small"}, "hybrid: unknown option '', expected one of size, masks"),
    ],
)
def test_an_unknown_option_or_choice_is_refused_by_its_name(simulator, options, text):
    request = pb.DescribeGameRequest(game="hybrid", options=options)
    assert unary_refusal(simulator, "DescribeGame", request) == (StatusCode.INVALID_ARGUMENT, text)
    assert refused(simulator, start("hybrid", options=options)) == (StatusCode.INVALID_ARGUMENT, text)


def test_options_change_the_spec_and_defaults_may_be_spelled_out(simulator):
    small, large = describe(simulator, "hybrid"), describe(simulator, "hybrid", size="large")
    assert describe(simulator, "hybrid", size="small", masks="on") == small
    assert [list(spec.behaviors[0].sensors[2].shape) for spec in (small, large)] == [[2, 2], [2, 5]]
    assert describe(simulator, "shooting_birds", locomotion="grid").behaviors[0].device.branches[0].name == "cell"


@pytest.mark.parametrize("game", GOOD)
def test_a_session_starts_with_the_spec_that_was_described(simulator, game):
    with Player(simulator, game) as player:
        assert player.spec == describe(simulator, game)


@pytest.mark.parametrize("fault", ["spec without sensors", "describe fails"])
def test_a_game_that_cannot_be_described_is_an_internal_error(simulator, fault):
    options = {"fault": fault, "armed": "yes"}
    for code, text in (
        unary_refusal(simulator, "DescribeGame", pb.DescribeGameRequest(game="faulty", options=options)),
        refused(simulator, start("faulty", options=options)),
    ):
        assert code == StatusCode.INTERNAL
        assert text.startswith("faulty failed in describe: ") and FAULTS[fault] in text


# ------------------------------------------------------------------------------------- the order of a session


def test_the_first_step_of_a_session_pays_nothing_and_ends_nothing(simulator):
    for game in GOOD:
        with Player(simulator, game, 3) as player:
            for message, kind in zip(player.step.behaviors, player.spec.behaviors, strict=True):
                step = Codec(kind, 3).unpack_step(message)
                assert not step.rewards.any() and not step.terminated.any() and not step.truncated.any()
                assert not message.HasField("ended")


@pytest.mark.parametrize("request_", [hybrid(), reset(), reset(seed=1), SAVE], ids=["act", "reset", "seeded", "save"])
def test_nothing_comes_before_start(simulator, request_):
    code, text = refused(simulator, request_)
    assert code == StatusCode.FAILED_PRECONDITION
    assert text == f"{request_.WhichOneof('request')} came before start; open a new stream and begin with start"


def test_start_comes_once(simulator):
    code, text = refused(simulator, start("hybrid"), hybrid(), start("hybrid"))
    assert code == StatusCode.FAILED_PRECONDITION
    assert text == "start came a second time; open a new stream and begin with start"


def test_an_empty_request_is_refused_at_any_time(simulator):
    wanted = (
        StatusCode.INVALID_ARGUMENT,
        "an empty PlayRequest, or a request that this server does not know; send start, act, reset or save",
    )
    assert refused(simulator, pb.PlayRequest()) == wanted
    assert refused(simulator, start("hybrid"), b"") == wanted


def test_unknown_fields_are_ignored(simulator):
    later = b"\xf8\x07\x01"  # field 127, a varint
    with Stream(simulator) as plain, Stream(simulator) as extended:
        for request in (start("hybrid"), hybrid(), reset(seed=3)):
            expected, answer = plain.ask(request), extended.ask(request.SerializeToString() + later)
            for step in (expected.step, answer.step):
                step.ClearField("simulate_seconds")
            assert answer == expected


def test_every_response_states_the_version_of_the_server(simulator):
    wanted = pb.Version(product=f"joybridge {metadata.version('joybridge')}", revision=REVISION)
    with grpc.insecure_channel(simulator) as channel, Stream(simulator) as stream:
        stub = rpc.SimulatorServiceStub(channel)
        assert stub.ListGames(pb.ListGamesRequest(), timeout=SECONDS).version == wanted
        assert stub.DescribeGame(pb.DescribeGameRequest(game="hybrid"), timeout=SECONDS).version == wanted
        assert stream.ask(start("hybrid")).started.version == wanted


def test_a_client_that_needs_a_newer_revision_is_refused_with_both_versions_and_the_fix(simulator):
    newer = pb.Version(product="joybridge 9.1", revision=REVISION + 1)
    text = (
        f"the client (joybridge 9.1) needs contract revision {REVISION + 1}, "
        f"the simulator (joybridge {metadata.version('joybridge')}) has revision {REVISION}; "
        "update the simulator, or use a client of its version"
    )
    wanted = StatusCode.FAILED_PRECONDITION, text
    assert unary_refusal(simulator, "ListGames", pb.ListGamesRequest(version=newer)) == wanted
    assert unary_refusal(simulator, "DescribeGame", pb.DescribeGameRequest(game="hybrid", version=newer)) == wanted
    assert refused(simulator, start("hybrid", version=newer)) == wanted


def test_a_client_that_states_no_revision_or_the_same_is_served(simulator):
    for version in (None, pb.Version(), pb.Version(product="grpcurl"), pb.Version(revision=REVISION)):
        with Stream(simulator) as stream:
            assert stream.ask(start("hybrid", version=version)).HasField("started")


def test_bytes_that_are_no_message_are_refused(simulator):
    for data in (b"\xff", b"\x0a\x7f", b"\x0b" * 200, b"\x0a\x03\x0a\x01\xff"):
        assert refused(simulator, data)[0] == StatusCode.INVALID_ARGUMENT
        code, text = refused(simulator, start("hybrid"), data)
        assert code == StatusCode.INVALID_ARGUMENT and text.startswith("not a PlayRequest: ")


def test_a_client_that_has_finished_ends_its_session_without_an_error(simulator):
    with Stream(simulator) as stream:
        stream.ask(start("hybrid"))
        stream.requests.put(None)
        assert list(stream.responses) == []
        assert stream.responses.code() == StatusCode.OK


# --------------------------------------------------------------------------------------------------- the start


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ({"parameters": {"wind": 1.0}}, "hybrid: unknown parameter 'wind', expected one of drift"),
        ({"parameters": {"drift": 2.5}}, "hybrid: parameter 'drift' got 2.5, expected 0..2"),
        ({"parameters": {"drift": -1e-9}}, "hybrid: parameter 'drift' got -1e-09, expected 0..2"),
        ({"parameters": {"drift": np.nan}}, "hybrid: parameter 'drift' got nan, expected 0..2"),
        ({"parameters": {"drift": np.inf}}, "hybrid: parameter 'drift' got inf, expected 0..2"),
        ({"arenas": 0}, "hybrid: arenas is 0, expected 1..1024"),
    ],
)
def test_a_start_with_a_wrong_value_is_refused(simulator, fields, text):
    assert refused(simulator, start("hybrid", **fields)) == (StatusCode.INVALID_ARGUMENT, text)


@pytest.mark.parametrize("arenas", [1025, 2**32 - 1])
def test_more_arenas_than_the_spec_allows_are_too_many(simulator, arenas):
    wanted = StatusCode.RESOURCE_EXHAUSTED, f"hybrid: arenas is {arenas}, expected 1..1024"
    assert refused(simulator, start("hybrid", arenas)) == wanted


@pytest.mark.parametrize("game", GOOD)
def test_as_many_arenas_as_the_spec_allows_can_be_played(simulator, game):
    most = describe(simulator, game).max_arenas
    with Player(simulator, game, most) as player:
        (first, *_), (kind, *_) = player.step.behaviors, player.spec.behaviors
        assert list(first.terminated.shape) == [most * kind.agents_per_arena]


# -------------------------------------------------------------------------------------------------------- acts


@pytest.mark.parametrize(
    ("request_", "text"),
    [
        (act(), "act.behaviors has 0 entries, expected 1"),
        (act(*hybrid().act.behaviors, *hybrid().act.behaviors), "act.behaviors has 2 entries, expected 1"),
        (act(pb.BehaviorAct()), "player.axes: dtype is DTYPE_UNSPECIFIED, expected DTYPE_FLOAT32"),
        (hybrid(axes=[[0, 1]]), "player.axes: shape is [1, 2], expected [2, 2]"),
        (hybrid(axes=[[0, 1], [1.5, 1]]), "player.axes: axis 'x' got 1.5 in lane 1, expected -1..1"),
        (hybrid(axes=[[0, 0.25], [0, 1]]), "player.axes: axis 'force' got 0.25 in lane 0, expected 0.5..2"),
        (hybrid(axes=[[0, 1], [np.nan, 1]]), "player.axes: value nan at [1, 0], expected finite numbers"),
        (hybrid(axes=[[0, 1], [0, np.inf]]), "player.axes: value inf at [1, 1], expected finite numbers"),
        (hybrid(choices=[[0, 0], [3, 0]]), "player.choices: branch 'gear' got 3 in lane 1, expected 0..2"),
        (hybrid(choices=[[-1, 0], [0, 0]]), "player.choices: branch 'gear' got -1 in lane 0, expected 0..2"),
        (
            hybrid(choices=[[1, 0], [2, 0]]),
            "player.choices: branch 'gear' got 'high' in lane 1, which its mask forbids in this step",
        ),
    ],
)
def test_an_act_that_breaks_the_spec_or_a_mask_is_refused(simulator, request_, text):
    assert refused(simulator, start("hybrid"), hybrid(), request_) == (StatusCode.INVALID_ARGUMENT, text)


def test_a_mask_holds_for_one_step_only(simulator):
    with Stream(simulator) as stream:
        stream.ask(start("hybrid"))
        stream.ask(hybrid(choices=[[1, 0], [0, 0]]))  # a gear up, and then one more
        stream.ask(hybrid(choices=[[2, 0], [0, 0]]))


def test_without_masks_every_choice_is_allowed(simulator):
    with Stream(simulator) as stream:
        first = stream.ask(start("hybrid", options={"masks": "off"})).started.step
        assert not first.behaviors[0].masks
        assert not stream.ask(hybrid(choices=[[2, 0], [2, 1]])).step.behaviors[0].masks


def duel(paces, verdict):
    return act(pb.BehaviorAct(axes=floats(*[[p] for p in paces])), pb.BehaviorAct(choices=integers([verdict])))


def test_lanes_take_turns_and_hear_of_rewards_when_they_decide_or_end(simulator):
    with Stream(simulator) as stream:
        started = stream.ask(start("duel", arenas=1)).started
        kinds, step, deciders, earned = started.spec.behaviors, started.step, [], []
        for clock in range(10):
            parts = [Codec(kind, 1).unpack_step(message) for message, kind in zip(step.behaviors, kinds, strict=True)]
            flags = [
                flag
                for part in parts
                for flag in (np.ones(len(part.rewards), bool) if part.deciding is None else part.deciding)
            ]
            deciders.append(flags.index(True))
            assert sum(flags) == 1
            step = stream.ask(duel([0.75, 0.25], 1)).step
            runners = Codec(kinds[0], 1).unpack_step(step.behaviors[0])
            earned.append(runners.rewards[:, 0].tolist())
            assert runners.truncated.all() == (clock == 9) and not runners.terminated.any()
    assert deciders == [0, 1, 2, 0, 1, 2, 0, 1, 2, 0]
    # A move pays its pace and costs the other runner 0.5.
    assert [first for first, _ in earned] == [0, 0, 0.25, 0, 0, 0.25, 0, 0, 0.25, 0.75]
    assert [second for _, second in earned] == [-0.5, 0, 0, -0.25, 0, 0, -0.25, 0, 0, -0.25]


def test_what_lanes_that_wait_ask_for_changes_nothing(simulator):
    def transcript(junk):
        with Stream(simulator) as stream:
            stream.ask(start("duel", arenas=1))
            for clock in range(12):
                mover = clock % 10 % 3
                paces = [0.5 if runner == mover else junk for runner in range(2)]
                yield record(stream.ask(duel(paces, 1 if mover == 2 else junk)).step)

    assert list(transcript(0)) == list(transcript(77)) == list(transcript(-(2**31)))


def test_an_episode_ends_terminated_or_truncated_and_the_next_one_begins_in_the_same_step(simulator):
    with Stream(simulator) as stream:
        kind = stream.ask(start("ends")).started.spec.behaviors[0]
        steps = [Codec(kind, 2).unpack_step(stream.ask(press()).step.behaviors[0]) for _ in range(4)]
    assert [step.terminated.tolist() for step in steps] == [[False] * 2, [True] * 2, [False] * 2, [False] * 2]
    assert [step.truncated.tolist() for step in steps] == [[False] * 2, [False] * 2, [False] * 2, [True] * 2]
    assert [step.observations[0][0].tolist() for step in steps] == [[1, 1], [2, 0], [2, 1], [3, 0]]
    assert [step.final_observations and step.final_observations[0][0].tolist() for step in steps] == [
        None, [1, 2], None, [2, 2],
    ]  # fmt: skip


# ---------------------------------------------------------------------------------------------------- pictures


def test_pictures_come_in_the_order_in_which_they_are_asked_for(simulator):
    width, height = PICTURE
    with Stream(simulator) as stream:
        stream.ask(start("hybrid", parameters={"drift": 0.0}))
        request = hybrid(axes=[[0, 0.5]] * 2, choices=[[0, 1], [1, 0]], draw=[1, 0, 1])
        picture_format = Format(pb.DTYPE_UINT8, (height, width, 3), "picture")
        pictures = [picture_format.unpack(picture) for picture in stream.ask(request).step.pictures]
        assert [picture[0, 0].tolist() for picture in pictures] == [[1, 0, 1], [1, 1, 0], [1, 0, 1]]
        assert not stream.ask(hybrid()).step.pictures


def test_as_many_pictures_as_the_contract_allows_and_no_more(simulator):
    with Stream(simulator) as stream:
        stream.ask(start("hybrid"))
        assert len(stream.ask(hybrid(draw=[0, 1] * 32)).step.pictures) == 64
        code, text = stream.refusal(hybrid(draw=[0] * 65))
    assert code == StatusCode.INVALID_ARGUMENT
    assert text == "act.draw asks for 65 pictures up to arena 0, expected at most 64 of arenas 0..1"


@pytest.mark.parametrize("arena", [2, 2**32 - 1])
def test_an_arena_that_a_session_does_not_have_cannot_be_drawn(simulator, arena):
    code, text = refused(simulator, start("hybrid"), hybrid(draw=[0, arena]))
    assert code == StatusCode.INVALID_ARGUMENT
    assert text == f"act.draw asks for 2 pictures up to arena {arena}, expected at most 64 of arenas 0..1"


def test_a_game_without_a_picture_cannot_be_drawn(simulator):
    code, text = refused(simulator, start("ends"), press(draw=[0]))
    assert code == StatusCode.FAILED_PRECONDITION and text == "ends cannot be drawn; leave act.draw empty"


@pytest.mark.parametrize("game", PAPER)
def test_the_games_of_the_paper_draw_what_their_spec_says(simulator, game):
    with Player(simulator, game, 2) as player:
        size = player.spec.picture.height, player.spec.picture.width, 3
        pictures = player.ask(act(*player.acts(), draw=[1, 0])).pictures
        one, other = (Format(pb.DTYPE_UINT8, size, "picture").unpack(picture) for picture in pictures)
        assert (one != other).any() and len(np.unique(one)) > 8


# ------------------------------------------------------------------------------------- seeds, resets, first_arena


@pytest.mark.parametrize("game", GOOD)
def test_the_same_seed_plays_the_same_game_beside_other_sessions(simulator, game):
    with Player(simulator, game, 3) as alone:
        wanted = alone.play(25)
    with Player(simulator, game, 3) as player, Player(simulator, game, 3, seed=9) as other:
        came = []
        for _ in range(25):
            came += player.play(1)
            other.play(1)
            with Player(simulator, "hybrid", 1) as passing:
                passing.play(1)
    assert came == wanted and len(set(wanted)) > 1


@pytest.mark.parametrize("game", ["hybrid", "duel", *PAPER])
def test_every_bit_of_a_seed_counts(simulator, game):
    def first(seed):
        with Player(simulator, game, seed=seed) as player:
            return record(player.step)

    seeds = [0, 1, 2**31, 2**32, 2**53, 2**53 + 1, 2**63, LARGEST_SEED - 1, LARGEST_SEED]
    assert len({first(seed) for seed in seeds}) == len(seeds)
    assert first(LARGEST_SEED) == first(LARGEST_SEED)


@pytest.mark.parametrize("game", GOOD)
def test_sessions_that_share_a_seed_play_what_one_large_session_would(simulator, game):
    def play(arenas, first_arena):
        with Player(simulator, game, arenas, seed=LARGEST_SEED, first_arena=first_arena) as player:
            yield list(rows(player.step, player.spec, arenas))
            for _ in range(25):
                yield list(rows(player.ask(act(*player.acts())), player.spec, arenas))

    large, left, right = list(play(5, 0)), list(play(2, 0)), list(play(3, 2))
    assert [one + other for one, other in zip(left, right, strict=True)] == large


@pytest.mark.parametrize("game", ["hybrid", "duel", *PAPER])
def test_arenas_differ_up_to_the_last_number(simulator, game):
    last = 2**32 - 1
    with Player(simulator, game, 3, first_arena=last) as player:
        assert len(set(rows(player.step, player.spec, 3))) == 3
        third = list(rows(player.step, player.spec, 3))[:1]
    with Player(simulator, game, 1, first_arena=last) as player:
        assert list(rows(player.step, player.spec, 1)) == third


@pytest.mark.parametrize("seed", [0, LARGEST_SEED])
@pytest.mark.parametrize("game", GOOD)
def test_a_reset_with_a_seed_plays_what_a_new_session_would(simulator, game, seed):
    with Player(simulator, game, 3, seed=seed) as new:
        wanted = [record(new.step), *new.play(12)]
    with Player(simulator, game, 3) as player:
        player.play(17)
        for _ in range(2):
            player.random = [np.random.default_rng([7, arena]) for arena in range(3)]
            assert [record(player.ask(reset(seed=seed))), *player.play(12)] == wanted


@pytest.mark.parametrize("game", ["hybrid", "duel", *PAPER])
def test_a_reset_without_a_seed_goes_on_with_the_random_streams(simulator, game):
    def firsts():
        with Player(simulator, game, 3) as player:
            return [record(player.step), *(record(player.ask(reset())) for _ in range(3))]

    assert len(set(firsts())) == 4
    assert firsts() == firsts()


@pytest.mark.parametrize("game", GOOD)
def test_a_reset_pays_nothing_and_ends_nothing(simulator, game):
    with Player(simulator, game, 2) as player:
        player.play(3)
        for message, kind in zip(player.ask(reset()).behaviors, player.spec.behaviors, strict=True):
            step = Codec(kind, 2).unpack_step(message)
            assert not step.rewards.any() and not message.HasField("ended")
        player.play(3)


@pytest.mark.parametrize(("game", "name", "value"), [("hybrid", "drift", 0.0), ("shooting_birds", "bird_speed", 4.0)])
def test_parameters_may_change_at_a_reset_and_keep_their_values_otherwise(simulator, game, name, value):
    def play(reset_with=None, **start_with):
        with Player(simulator, game, 2, **start_with) as player:
            if reset_with is not None:
                player.play(3)
                player.random = [np.random.default_rng([7, arena]) for arena in range(2)]
                player.ask(reset(seed=1, parameters=reset_with))
            return player.play(60)

    usual, changed = play(), play(parameters={name: value})
    assert changed != usual
    assert play(reset_with={name: value}) == changed
    assert play(reset_with={}) == usual
    assert play(reset_with={}, parameters={name: value}) == changed


def test_a_reset_with_a_wrong_parameter_is_refused(simulator):
    for parameters, text in (
        ({"wind": 1.0}, "hybrid: unknown parameter 'wind', expected one of drift"),
        ({"drift": np.nan}, "hybrid: parameter 'drift' got nan, expected 0..2"),
    ):
        came = refused(simulator, start("hybrid"), reset(parameters=parameters))
        assert came == (StatusCode.INVALID_ARGUMENT, text)


# ------------------------------------------------------------------------------------------- games that fail


def test_a_game_that_fails_ends_its_session_and_no_other(simulator):
    with Player(simulator, "hybrid", 3) as undisturbed:
        wanted = undisturbed.play(8)
    with Player(simulator, "hybrid", 3) as player, Stream(simulator) as failing:
        came = player.play(4)
        failing.ask(start("raises"))
        failing.ask(press())
        failing.ask(press())
        code, text = failing.refusal(press())
        came += player.play(4)
    assert code == StatusCode.INTERNAL
    assert text == (
        "raises failed in step 3: arena 0: ZeroDivisionError: division by zero; the traceback is in the server's log"
    )
    assert came == wanted


@pytest.mark.parametrize("fault", sorted(set(FAULTS) - {"spec without sensors", "describe fails"}))
def test_no_mistake_of_a_game_travels_as_data_or_blames_the_client(simulator, fault):
    at_start = fault in ("end at reset", "start fails")
    request = start("faulty", options={"fault": fault, "armed": "yes"})
    code, text = refused(simulator, *([request] if at_start else [request, press(draw=[0])]))
    assert code == StatusCode.INTERNAL
    assert text.startswith(f"faulty failed in step {0 if at_start else 1}: arena 0: ")
    assert FAULTS[fault] in text and text.endswith("; the traceback is in the server's log")


@pytest.mark.parametrize(
    ("fault", "text"), [("exit", "SystemExit: 5"), ("doubles", "TensorError: an array of float64 cannot be sent")]
)
def test_no_mistake_of_a_batched_game_brings_the_server_down_or_blames_the_client(simulator, fault, text):
    code, came = refused(simulator, start("batch", options={"fault": fault}), press())
    assert code == StatusCode.INTERNAL and came.startswith(f"batch failed in step 1: {text}")


def test_games_without_a_fault_play_on(simulator):
    with Stream(simulator) as stream:
        stream.ask(start("faulty", options={"armed": "yes"}))
        assert len(stream.ask(press(draw=[0])).step.pictures) == 1
    with Stream(simulator) as stream:
        stream.ask(start("batch"))
        assert len(stream.ask(press()).step.behaviors) == 1


@pytest.mark.parametrize(
    ("place", "text"),
    [
        ("nowhere", "game 'nowhere' cannot be imported"),
        ("nowhere:Game", "game 'nowhere:Game' cannot be imported"),
        ("tests.support.games:Chess", "game 'tests.support.games:Chess' cannot be imported"),
        ("", "game '' cannot be imported"),
        ("tests.support.games:PICTURE", "is not a subclass of joybridge.simulator.Game or BatchedGame"),
        ("tests.support.games:Unnamed", "game 'tests.support.games:Unnamed' cannot be described: AttributeError"),
        (
            "tests.support.games:BrokenChoice",
            "spec that violates the contract: broken_choice.player: agents_per_arena is 0",
        ),
    ],
)
def test_a_game_that_cannot_be_served_is_refused_before_the_server_starts(place, text):
    with pytest.raises(CatalogError) as caught:
        load_games([place])
    assert text in str(caught.value)


def test_two_games_cannot_have_one_name():
    with pytest.raises(CatalogError, match="there is already a game named 'hybrid'; rename this one"):
        load_games(["tests.support.games:Hybrid", "tests.support.games:Namesake"])


# -------------------------------------------------------------------------------------------- size and limits


def test_a_message_larger_than_any_game_needs_is_refused(simulator):
    with Stream(simulator) as stream:
        code, text = stream.refusal(start("x" * 50_000_000))
    assert code == StatusCode.RESOURCE_EXHAUSTED and "larger than max" in text
    with Player(simulator, "ends") as player:
        player.play(1)


def test_long_names_are_refused_with_their_own_status_in_few_words(simulator):
    for name in ("x" * 1_000_000, "ü" * 100_000, "🦆" * 100_000, "\x00\n%" * 100_000):
        for code, text in (
            refused(simulator, start(name)),
            refused(simulator, start("hybrid", options={name: name})),
            refused(simulator, start("hybrid", parameters={name: 1.0})),
            refused(simulator, start("shooting_birds", snapshot=pb.Snapshot(parts={name: b""}))),
        ):
            assert code in (StatusCode.NOT_FOUND, StatusCode.INVALID_ARGUMENT)
            assert repr(name)[:100] in text and len(text) < 700


# ------------------------------------------------------------------------------------------------- companions


def test_health_is_served_for_the_server_and_the_service(simulator):
    with grpc.insecure_channel(simulator) as channel:
        stub = health_pb2_grpc.HealthStub(channel)
        for name in ("", "joybridge.v1.SimulatorService"):
            answer = stub.Check(health_pb2.HealthCheckRequest(service=name), timeout=SECONDS)
            assert answer.status == health_pb2.HealthCheckResponse.SERVING
        with pytest.raises(grpc.RpcError) as caught:
            stub.Check(health_pb2.HealthCheckRequest(service="chess"), timeout=SECONDS)
        assert caught.value.code() == StatusCode.NOT_FOUND


def test_reflection_tells_the_whole_contract(simulator):
    with grpc.insecure_channel(simulator) as channel:
        database = ProtoReflectionDescriptorDatabase(channel)
        assert set(database.get_services()) == {
            "joybridge.v1.SimulatorService", "grpc.health.v1.Health", "grpc.reflection.v1alpha.ServerReflection",
        }  # fmt: skip
        file = database.FindFileContainingSymbol("joybridge.v1.SimulatorService")
        assert file.SerializeToString() == pb.DESCRIPTOR.serialized_pb


# -------------------------------------------------------------------------------------- processes and addresses


def test_port_0_is_a_free_port_that_is_told(simulator):
    host, port = simulator.rsplit(":", 1)
    assert host == "127.0.0.1" and int(port) > 0
    with socket.create_connection((host, int(port)), SECONDS):
        pass


def test_a_port_in_use_is_an_error_that_says_so(simulator):
    text = refuses_to_start("--address", simulator)
    assert text == f"error: cannot listen on {simulator}: it is in use or not an address of this machine"


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT], ids=["SIGTERM", "SIGINT"])
def test_a_signal_ends_health_then_sessions_then_the_server(number):
    with server("--address", "127.0.0.1:0", *games("tests.support.games:Ends"), stderr=subprocess.PIPE) as process:
        with (
            grpc.insecure_channel(process.address) as channel,
            Stream(process.address) as playing,
            Stream(process.address) as waiting,
        ):
            playing.ask(start("ends"))
            playing.ask(press())
            assert waiting.ask(start("shooting_birds")).started.spec.name == "shooting_birds"
            watch = health_pb2_grpc.HealthStub(channel).Watch(
                health_pb2.HealthCheckRequest(service="joybridge.v1.SimulatorService"), timeout=SECONDS
            )
            assert next(watch).status == health_pb2.HealthCheckResponse.SERVING
            process.send_signal(number)
            assert next(watch).status == health_pb2.HealthCheckResponse.NOT_SERVING
            watch.cancel()
            assert playing.end() == waiting.end() == (StatusCode.UNAVAILABLE, "the simulator is shutting down")
        status, text = end(process)
    assert status == 0
    assert "shutting down: 2 open sessions end with UNAVAILABLE" in text and "Traceback" not in text


def test_a_unix_socket_carries_the_same_bytes_and_can_be_used_again_after_a_crash(simulator, tmp_path_factory):
    path = tmp_path_factory.mktemp("s") / "s"  # short: the path of a socket has about a hundred characters at most
    address = f"unix:{path}"
    with server("--address", address, *games(*PLACES), umask=0) as process:
        assert process.address == address
        assert stat.S_IMODE(path.stat().st_mode) == 0o600  # for its owner alone
        for game in GOOD:
            with Player(address, game) as one, Player(simulator, game) as other:
                assert one.play(12) == other.play(12)
        assert (
            refuses_to_start("--address", address) == f"error: cannot listen on {address}: another server listens there"
        )
        with Player(address, "ends") as player:
            player.play(1)
    assert path.exists()  # the server was killed
    with server("--address", address) as process:
        assert describe(address, "shooting_birds").name == "shooting_birds"
        process.terminate()
        assert end(process)[0] == 0
    assert not path.exists()


CLIENT = """
import sys
from tests.support.wire import Stream, start
stream = Stream(sys.argv[1])
stream.ask(start("shooting_birds"))
print("playing", flush=True)
sys.stdin.read()
"""


def test_sessions_are_limited_and_one_that_ends_makes_room_however_it_ends():
    arguments = ["--address", "127.0.0.1:0", "--sessions", "2", "--with-parent"]
    with server(*arguments, stdin=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        address = process.address
        client = [sys.executable, "-c", CLIENT, address]
        with Player(address, "shooting_birds") as first:
            with subprocess.Popen(client, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as child:
                assert child.stdout is not None and child.stdout.readline() == "playing\n"
                assert_full(address)
                assert describe(address, "shooting_birds").name == "shooting_birds"  # only sessions are limited
                child.kill()
            with room(address) as second:
                first.play(1)
                assert_full(address)
                second.close()
                with room(address):
                    first.play(1)
            with room(address) as third:
                third.refusal(pb.PlayRequest())
                with room(address):
                    first.play(1)
            assert process.stdin is not None
            process.stdin.close()  # as if its parent had died
            assert first.stream.end() == (StatusCode.UNAVAILABLE, "the simulator is shutting down")
        process.stdin = None
        assert end(process)[0] == 0


def assert_full(address):
    code, text = refused(address, start("shooting_birds"))
    assert code == StatusCode.RESOURCE_EXHAUSTED
    idle, advice = r"2 sessions are open already, one of them idle for \d+ s", "start the server with --sessions"
    assert re.fullmatch(f"{idle}; close one or {advice}", text)


def room(address) -> Stream:
    """Return a started session as soon as the server has noticed that another one has gone."""
    deadline = time.monotonic() + SECONDS
    while True:
        stream = Stream(address)
        try:
            stream.ask(start("shooting_birds"))
        except grpc.RpcError as error:
            stream.close()
            if error.code() != StatusCode.RESOURCE_EXHAUSTED or time.monotonic() > deadline:
                raise
            time.sleep(0.01)
        else:
            return stream


def test_a_parent_is_watched_through_a_pipe_and_nothing_else():
    text = refuses_to_start("--address", "127.0.0.1:0", "--with-parent", stdin=subprocess.DEVNULL)
    assert text == "error: --with-parent watches standard input, which must be a pipe or a terminal"


def test_a_game_that_cannot_be_served_keeps_the_server_from_starting():
    text = refuses_to_start("--address", "127.0.0.1:0", "--game", "tests.support.games:Chess")
    assert text.startswith("error: game 'tests.support.games:Chess' cannot be imported (")
