"""Demonstrations as they are learned from: whole episodes, decision by decision. Needs no torch.

A file may hold many lanes and many episodes. What a lane did after its last finished episode is left out: a program
that was killed, or a person who left, did not play that episode to its end.
"""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from joybridge.client.recording import Recording, RecordingError, load_recording
from joybridge.contract.codec import ActArrays, Codec, StepArrays, lane_count
from joybridge.contract.spec import SpecError, check_spec
from joybridge.contract.tensors import Array, TensorError
from joybridge.v1 import bridge_pb2 as pb


class RecordedEpisodes(NamedTuple):
    """A session from Start or a Reset to the next one: decision t leads from step t to step t + 1."""

    steps: list[list[StepArrays]]  # one more than decisions, each with an entry per behavior
    acts: list[list[ActArrays]]
    held: list[list[list[int]] | None]  # the lanes of each behavior whose decisions are demonstrated; None: all

    def ends(self, behavior: int) -> Array:
        """Return the last decision of a finished episode of each lane of a behavior, -1 without one, [lanes]."""
        last = np.full(len(self.steps[0][behavior].terminated), -1)
        for number, step in enumerate(self.steps[1:]):
            last[step[behavior].ended] = number
        return last

    def begun(self, behavior: int) -> Array:
        """Return which lanes of a behavior decide after their last finished episode, bool [lanes]."""
        ends = self.ends(behavior)
        late = np.zeros(len(ends), bool)
        for number in range(len(self.acts)):
            late |= self._decides(number, behavior) & (number > ends)
        return late

    def demonstrated(self, number: int, behavior: int) -> Array:
        """Return which lanes of a behavior are demonstrated in a decision, bool [lanes]."""
        decides, held = self._decides(number, behavior), self.held[number]
        if held is not None:
            own = np.zeros(len(decides), bool)
            own[held[behavior]] = True
            decides &= own
        return decides

    def _decides(self, number: int, behavior: int) -> Array:
        """Return which lanes of a behavior decide, bool [lanes]."""
        step = self.steps[number][behavior]
        return step.decides.copy()


class Demonstration(NamedTuple):
    """One file."""

    path: Path
    spec: pb.GameSpec
    stretches: list[RecordedEpisodes]
    cut: int  # bytes of a record at the end that was not written to its end
    missing: int = 0  # steps that the file says it has
    kind: int = 0  # which of several games it shows

    def episodes(self, behavior: int) -> tuple[int, int]:
        """Return how many episodes of a behavior are finished, and in how many more a decision was made."""
        finished = sum(len(step[behavior].ended) for part in self.stretches for step in part.steps[1:])
        begun = sum(int(part.begun(behavior).sum()) for part in self.stretches)
        return finished, begun

    def remark(self) -> str:
        """Return what is left out of it, "" if nothing is."""
        begun = max(self.episodes(index)[1] for index in range(len(self.spec.behaviors)))
        parts = [f"{begun} unfinished episode{'s' if begun > 1 else ''}"] if begun else []
        if self.cut:
            parts.append(f"the last {self.cut} bytes, which were not written to their end")
        if self.missing:
            parts.append(f"{self.missing:,} steps, which are not in the file, though it counts them")
        return f"{self.path}: left out: {' and '.join(parts)}" if parts else ""


def load_recorded(path: Path, spec: pb.GameSpec | None) -> Demonstration:
    """Return what a file of Joybridge holds.

    spec: that of the game; None: any. Raises RecordingError unless it was recorded in a game with this spec.
    """
    recording = load_recording(path)
    recorded = recording.spec
    if recorded is None:
        raise RecordingError(f"{path} holds a fault, expected a demonstration; only `joybridge replay` reads it")
    try:
        check_spec(recorded)
        _check_alike(path, recorded, spec or recorded)
        stretches = list(_stretches(recording, recorded))
        _align_rewards(stretches, recorded, spec or recorded)
        return Demonstration(path, recorded, stretches, recording.cut)
    except (SpecError, TensorError, ValueError, IndexError, TypeError) as error:
        raise RecordingError(f"{path} breaks the contract ({error}); record it again") from error


def _stretches(recording: Recording, spec: pb.GameSpec) -> Iterator[RecordedEpisodes]:
    codecs = [Codec(behavior, recording.start.arenas, len(spec.parameters)) for behavior in spec.behaviors]
    stretch: RecordedEpisodes | None = None
    for exchange in recording.exchanges:
        if exchange.step is None:  # the request was not answered
            break
        steps = [codec.unpack_step(one) for codec, one in zip(codecs, exchange.step.behaviors, strict=True)]
        if stretch is None or not exchange.request.HasField("act"):
            if stretch is not None:
                yield stretch
            stretch = RecordedEpisodes([steps], [], [])
            continue
        messages, before = exchange.request.act.behaviors, stretch.steps[-1]
        acts = [codec.unpack_act(act, last) for codec, act, last in zip(codecs, messages, before, strict=True)]
        _check_held(exchange.held, spec, recording.start.arenas)
        stretch.steps.append(steps)
        stretch.acts.append(acts)
        stretch.held.append(exchange.held)
    if stretch is not None:
        yield stretch


def _align_rewards(stretches: Sequence[RecordedEpisodes], recorded: pb.GameSpec, spec: pb.GameSpec) -> None:
    """Give what was earned the reward channels of a spec, by name: what was not recorded is 0, others are left out.

    Cloning does not look at rewards, so a game may pay others than when it was recorded.
    """
    for index, (before, now) in enumerate(zip(recorded.behaviors, spec.behaviors, strict=True)):
        paid, wanted = ([channel.name for channel in one.channels] for one in (before, now))
        if paid == wanted:
            continue
        for step in (steps[index] for stretch in stretches for steps in stretch.steps):
            none = np.zeros(len(step.rewards), np.float32)
            columns = [step.rewards[:, paid.index(name)] if name in paid else none for name in wanted]
            step.rewards = np.stack(columns, axis=1)


def _check_held(held: list[list[int]] | None, spec: pb.GameSpec, arenas: int) -> None:
    """Raise ValueError unless all lanes are lanes of their behavior."""
    if held is None:
        return
    for behavior, lanes in zip(spec.behaviors, held, strict=True):
        if not all(0 <= lane < lane_count(behavior, arenas) for lane in lanes):
            raise ValueError(f"lanes {lanes} of {behavior.name}, which has {lane_count(behavior, arenas)}")


def _check_alike(path: Path, recorded: pb.GameSpec, spec: pb.GameSpec) -> None:
    """Raise RecordingError unless sensors and devices are the same in two specs."""
    if recorded.name != spec.name:
        raise RecordingError(f"{path} is a demonstration of {recorded.name}, expected {spec.name}; name another folder")
    theirs, ours = ([behavior.name for behavior in one.behaviors] for one in (recorded, spec))
    if theirs != ours:
        raise RecordingError(f"{path}: {spec.name} had the behaviors {', '.join(theirs)}, now {', '.join(ours)}")
    for behavior, now in zip(recorded.behaviors, spec.behaviors, strict=True):
        for part, before, after in (
            ("sensors", _sensors(behavior), _sensors(now)),
            ("axes", _axes(behavior), _axes(now)),
            ("branches", _branches(behavior), _branches(now)),
        ):
            if before != after:
                raise RecordingError(
                    f"{path} was recorded with other {part} of {now.name}: {', '.join(before)}, now {', '.join(after)}"
                    "; train with the options of the recording, or record again"
                )


def _sensors(behavior: pb.Behavior) -> Sequence[str]:
    return [f"{one.name} {'×'.join(map(str, one.shape))} {pb.Dtype.Name(one.dtype)}" for one in behavior.sensors]


def _axes(behavior: pb.Behavior) -> Sequence[str]:
    return [f"{axis.name} {axis.low:g}..{axis.high:g}" for axis in behavior.device.axes] or ["none"]


def _branches(behavior: pb.Behavior) -> Sequence[str]:
    return [f"{branch.name} ({'/'.join(branch.choices)})" for branch in behavior.device.branches] or ["none"]
