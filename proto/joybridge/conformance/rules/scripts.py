"""Scripts: players of the game's author act in place of the client in the lanes that it says."""

from collections.abc import Callable

import numpy as np

from joybridge.conformance.client import Stream
from joybridge.conformance.expectations import expect, skip_unless
from joybridge.conformance.invalid_acts import changed, read
from joybridge.conformance.recording import act_request, step_bytes, valid_act
from joybridge.conformance.registry import check, table
from joybridge.conformance.subject import SHORT, Subject
from joybridge.contract.codec import pack
from joybridge.contract.tensors import Array
from joybridge.v1 import bridge_pb2 as pb


@check("SCRIPTS")
def actions_of_lanes_that_a_script_plays_are_ignored(subject: Subject) -> None:
    """The rows of lanes that a script plays must be well-formed; their values are ignored, and masks do not count."""
    _with_scripts(subject)
    for number in range(1, 1 + max(len(behavior.scripts) for behavior in subject.spec.behaviors)):
        usual, wild = (_play(subject, number, wild=wild) for wild in (False, True))
        expect(usual == wild, f"different steps after other actions of lanes of script {number}", "the same bytes")


@check("BehaviorAct")
def scripts_of_0_leave_all_lanes_to_the_client(subject: Subject) -> None:
    """A lane for which BehaviorAct.scripts is 0 does what its rows say."""
    behaviors, recording = _with_scripts(subject), subject.short_session
    requests = [*recording.requests]
    for moment in range(1, len(requests)):
        requests[moment] = act_request(requests[moment].act)
        for index in behaviors:
            requests[moment].act.behaviors[index].scripts.CopyFrom(pack(_of_all_lanes(subject, index, 0)))
    got = [step_bytes(step) for step in subject.expect_steps(requests)]
    expect(got == recording.step_bytes, "different steps with scripts of 0 in all lanes", "the same bytes")


@table(
    [
        ("script_after_the_last_is_refused", "BehaviorAct", "A script is 0, or counted from 1 to their number.", 1),
        ("negative_script_is_refused", "BehaviorAct", "A script is 0, or counted from 1 on.", None),
    ]
)
def _number_is_refused(subject: Subject, beyond: int | None) -> None:
    for index in _with_scripts(subject):
        prefix, act, lane = subject.acting(index)
        scripts = _of_all_lanes(subject, index, 0)
        scripts[lane] = -1 if beyond is None else len(subject.spec.behaviors[index].scripts) + beyond
        subject.expect_refused(*prefix, changed(act, index, "scripts", scripts), words=["script"])


@table(
    [
        (
            "scripts_with_an_extra_lane_are_refused",
            "BehaviorAct",
            "BehaviorAct.scripts is INT32 [lanes].",
            lambda scripts: np.append(scripts, np.int32(0)),
        ),
        (
            "scripts_of_another_dtype_are_refused",
            "BehaviorAct",
            "BehaviorAct.scripts is INT32 [lanes].",
            lambda scripts: scripts.astype(np.float32),
        ),
    ]
)
def _tensor_is_refused(subject: Subject, change: Callable[[Array], Array]) -> None:
    for index in _with_scripts(subject):
        prefix, act, _ = subject.acting(index)
        scripts = change(_of_all_lanes(subject, index, 0))
        subject.expect_refused(*prefix, changed(act, index, "scripts", scripts), words=["script"])


def _with_scripts(subject: Subject) -> list[int]:
    """Return the indices of the behaviors with scripts. Raises NotApplicable if there are none."""
    behaviors = [index for index, behavior in enumerate(subject.spec.behaviors) if behavior.scripts]
    skip_unless(behaviors, "no behavior has scripts")
    return behaviors


def _of_all_lanes(subject: Subject, behavior: int, number: int) -> Array:
    return np.full(subject.arenas * subject.spec.behaviors[behavior].agents_per_arena, number, np.int32)


def _play(subject: Subject, number: int, *, wild: bool) -> list[bytes]:
    """Return the steps of a short session in which a script plays every second lane of all behaviors that have it.

    wild: the rows of these lanes are at the ends of axes and branches, whatever the masks allow.
    """
    with Stream(subject.client) as stream:
        player = subject.player(stream)
        recording = player.recording
        for _ in range(SHORT):
            if recording.end:
                break
            act = valid_act(recording.views(len(recording.steps) - 1), player.generators)
            for index, behavior in enumerate(subject.spec.behaviors):
                if number <= len(behavior.scripts):
                    scripts = _of_all_lanes(subject, index, number)
                    scripts[1::2] = 0
                    act.behaviors[index].scripts.CopyFrom(pack(scripts))
                    if wild:
                        _make_wild(act.behaviors[index], behavior.device, scripts > 0)
            player.send(act_request(act))
        expect(not recording.end, f"{recording.end} in a session with scripts", "a Step in response to each Act")
        return recording.step_bytes


def _make_wild(act: pb.BehaviorAct, device: pb.Device, lanes: Array) -> None:
    if device.axes:
        axes = read(act.axes)
        axes[lanes] = [axis.high for axis in device.axes]
        act.axes.CopyFrom(pack(axes))
    if device.branches:
        choices = read(act.choices)
        choices[lanes] = [len(branch.choices) - 1 for branch in device.branches]
        act.choices.CopyFrom(pack(choices))
