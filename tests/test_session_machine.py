"""Sessions under any order of requests: the server is never wrong about where a session stands."""

from typing import Any

import numpy as np
import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)

from joybridge.contract.codec import ActArrays, Codec, pack_act
from joybridge.games import BUILT_IN
from joybridge.simulator.catalog import load_game
from joybridge.simulator.session import Refusal, Session
from joybridge.v1 import bridge_pb2 as pb
from tests.support.wire import SAVE, act, record, reset, start

SEQUENCES = 1000
NAME = "shooting_birds"  # axes, branches and snapshots
GAMES = {NAME: load_game(BUILT_IN[NAME])}


class Machine(RuleBasedStateMachine):
    """A session and what the contract says of it; all that is answered is answered alike by a second session."""

    def __init__(self):
        super().__init__()
        self.begin()
        self.snapshot: Any = None
        self.request = start(NAME)

    @initialize()
    def begin(self):
        self.session, self.twin = Session(GAMES), Session(GAMES)
        self.playing = self.ended = False
        self.step: Any = None

    def ask(self, request, wanted=None) -> Any:
        """Send a request to both; wanted: the reason for which it must be refused."""
        answers: list[Any] = []
        for session in (self.session, self.twin):
            try:
                answers.append(session.answer(request))
            except Refusal as refusal:
                answers.append(refusal.reason)
        if wanted is not None:
            assert answers == [wanted, wanted]
            self.close()
            return None
        one, other = answers
        assert isinstance(one, pb.PlayResponse), one
        step = one.started.step if one.HasField("started") else one.step
        if one.HasField("snapshot"):
            assert one.snapshot == other.snapshot
        else:
            assert record(step) == record(other.started.step if one.HasField("started") else other.step)
            self.step = step
        return one

    def close(self):
        self.session.close()
        self.twin.close()
        self.begin()

    @precondition(lambda self: not self.playing)
    @rule(arenas=st.integers(1, 4), seed=st.integers(0, 2**64 - 1), first=st.integers(0, 5))
    def start(self, arenas, seed, first):
        self.request = start(NAME, arenas, seed, first_arena=first)
        self.ask(self.request)
        self.playing, self.arenas = True, arenas

    @precondition(lambda self: not self.playing and self.snapshot is not None)
    @rule()
    def continue_from_a_snapshot(self):
        request, snapshot, step = self.snapshot
        copy = pb.PlayRequest()
        copy.CopyFrom(request)
        copy.start.snapshot.CopyFrom(snapshot)
        self.ask(copy)
        self.request, self.playing, self.arenas = request, True, request.start.arenas
        for one, other in zip(self.step.behaviors, step.behaviors, strict=True):
            assert one.observations == other.observations

    @precondition(lambda self: not self.playing)
    @rule(kind=st.sampled_from(["act", "reset", "save", "nothing", "no arenas", "too many", "game"]))
    def begin_wrongly(self, kind):
        wrong = {
            "act": (act(), pb.REASON_WRONG_ORDER),
            "reset": (reset(), pb.REASON_WRONG_ORDER),
            "save": (SAVE, pb.REASON_WRONG_ORDER),
            "nothing": (pb.PlayRequest(), pb.REASON_UNKNOWN_REQUEST),
            "no arenas": (start(NAME, 0), pb.REASON_NO_ARENAS),
            "too many": (start(NAME, 2**31), pb.REASON_TOO_MANY_ARENAS),
            "game": (start("chess"), pb.REASON_UNKNOWN_GAME),
        }
        self.ask(*wrong[kind])

    @precondition(lambda self: self.playing)
    @rule(seed=st.integers(0, 2**32))
    def act(self, seed):
        self.ask(self.chosen(np.random.default_rng(seed)))

    @precondition(lambda self: self.playing)
    @rule(fault=st.sampled_from(["nan", "outside", "choice", "rows", "behaviors", "draw"]))
    def act_wrongly(self, fault):
        request = self.chosen(np.random.default_rng(0))
        behavior = request.act.behaviors[0]
        reasons = {
            "nan": pb.REASON_NOT_FINITE,
            "outside": pb.REASON_ACTION_OUT_OF_RANGE,
            "choice": pb.REASON_ACTION_OUT_OF_RANGE,
            "rows": pb.REASON_WRONG_TENSOR,
            "behaviors": pb.REASON_WRONG_BEHAVIORS,
            "draw": pb.REASON_WRONG_DRAW,
        }
        axes = np.frombuffer(behavior.axes.data, "<f4").copy()
        choices = np.frombuffer(behavior.choices.data, "<i4").copy()
        axes[0] = {"nan": np.nan, "outside": 1e9}.get(fault, axes[0])
        choices[0] = 1000 if fault == "choice" else choices[0]
        behavior.axes.data, behavior.choices.data = axes.tobytes(), choices.tobytes()
        if fault == "rows":
            behavior.axes.data = behavior.axes.data[:-4]
        if fault == "behaviors":
            request.act.behaviors.add()
        if fault == "draw":
            request.act.draw.append(self.arenas)
        self.ask(request, reasons[fault])

    @precondition(lambda self: self.playing)
    @rule(seed=st.none() | st.integers(0, 2**64 - 1))
    def reset(self, seed):
        self.ask(reset(**({} if seed is None else {"seed": seed})))

    @precondition(lambda self: self.playing)
    @rule()
    def save(self):
        self.snapshot = (self.request, self.ask(SAVE).snapshot, self.step)

    @precondition(lambda self: self.playing)
    @rule(kind=st.sampled_from(["start", "nothing"]))
    def interrupt(self, kind):
        wrong = {
            "start": (start(NAME), pb.REASON_WRONG_ORDER),
            "nothing": (pb.PlayRequest(), pb.REASON_UNKNOWN_REQUEST),
        }
        self.ask(*wrong[kind])

    @precondition(lambda self: self.playing)
    @rule()
    def leave(self):
        self.close()

    @invariant()
    def what_is_answered_fits_the_session(self):
        if self.playing and self.step is not None:
            assert all(len(one.terminated.data) == self.arenas for one in self.step.behaviors)

    def chosen(self, random):
        (behavior,), (message,) = self.session.spec.behaviors, self.step.behaviors
        device, step = behavior.device, Codec(behavior, self.arenas).unpack_step(message)
        axes = [random.uniform(axis.low, axis.high, self.arenas) for axis in device.axes]
        masks = step.masks or [np.ones((self.arenas, len(branch.choices)), bool) for branch in device.branches]
        choices = [(random.random(mask.shape) * mask).argmax(1) for mask in masks]
        return act(pack_act(ActArrays(np.array(axes, np.float32).T.copy(), np.array(choices, np.int32).T.copy())))


@pytest.mark.nightly
@pytest.mark.promise("P2")
def test_a_thousand_sequences_of_requests_are_answered_or_refused_as_the_contract_says():
    run_state_machine_as_test(Machine, settings=settings(max_examples=SEQUENCES, stateful_step_count=15))
