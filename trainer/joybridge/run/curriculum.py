"""The lessons of a run: which parameters and which hand are played now, and when the next lesson begins."""

from collections import deque
from collections.abc import Mapping, Sequence

import numpy as np

from joybridge.config.config import Config, HandConfig
from joybridge.config.game_settings import Value, distribution_of, fixed, value_text
from joybridge.config.metrics import Row
from joybridge.config.parameter_keys import Until
from joybridge.contract.tensors import Array
from joybridge.policy.policy import Policy
from joybridge.v1 import bridge_pb2 as pb


class Curriculum:
    """The present lesson of a run, and what decides on the next one. Without lessons, parameters stay as they are.

    Only episodes that began in the present lesson count. It ends between two cycles, so a resumed run goes on alike.
    """

    def __init__(self, config: Config, spec: pb.GameSpec, policies: Sequence[Policy]) -> None:
        """Begin with the first lesson, in new episodes."""
        self.lessons, self._policies = config.curriculum, {policy.actor.name: policy for policy in policies}
        self._hands = config.hands
        varied = {name for lesson in self.lessons for name in lesson.parameters}
        defaults = {one.name: one.default_value for one in spec.parameters if one.name in varied}
        self._outside: dict[str, Value] = {**defaults, **config.parameters}
        self.parameters = {name: value for name, value in fixed(config.parameters).items() if name not in varied}
        self._number = 0
        self._values: deque[float] = deque()  # of the last episodes that count
        self._seen = 0  # episodes of the judged policy
        self._fresh = np.zeros(0, bool)  # [lanes] of the judged policy: whether its episode began in this lesson
        self._judge(fresh=True)

    def begin(self) -> None:
        """Count the episodes of all lanes from now on: new ones begin everywhere."""
        self._fresh[:] = True

    @property
    def distributions(self) -> dict[str, pb.Distribution]:
        """Return how parameters are drawn now; those outside of `parameters` that have one value are a choice of it."""
        chosen = self._outside | (self.lessons[self._number].parameters if self.lessons else {})
        varied = {name: value for name, value in chosen.items() if name not in self.parameters}
        return {name: distribution_of(value) for name, value in varied.items()}

    @property
    def hand(self) -> HandConfig:
        """The limits of the hand now."""
        return self._hands[self._number]

    def watch(self) -> None:
        """Count the episodes that have ended in the last step. Call it after each, before they are summed up."""
        if self._until is None:
            return
        episodes = self._policy.episodes
        new = episodes.count - self._seen
        self._seen = episodes.count
        for row in episodes.finished[len(episodes.finished) - new :]:
            lane = int(row[0])
            if self._fresh[lane] and self._column:
                self._values.append(float(row[self._column]))
            self._fresh[lane] = True

    def advance(self, progress: float) -> bool:
        """Begin the next lesson if the present one is over, after a fraction of the run; return whether it was."""
        if self._until is None or not _over(self._until, list(self._values) if self._column else [progress]):
            return False
        self._number += 1
        self._judge(fresh=False)
        return True

    def heading(self) -> str:
        """Return which lesson it is and what is played in it, "" without lessons."""
        if not self.lessons:
            return ""
        lesson = self.lessons[self._number]
        name = f" ({lesson.name})" if lesson.name else ""
        played = {name: value_text(value) for name, value in lesson.parameters.items()}
        played |= {f"hand.{name}": value for name, value in lesson.hand.items()}
        values = ", ".join(f"{name}={value}" for name, value in played.items())
        return f"lesson {self._number + 1} of {len(self.lessons)}{name}: {values}"

    def row(self) -> Row:
        """Return the column of metrics that has the number of the lesson, none without lessons."""
        return {"lesson": self._number + 1} if self.lessons else {}

    def state(self) -> dict[str, Array]:
        """Return everything for a checkpoint, nothing without lessons."""
        if not self.lessons:
            return {}
        return {"number": np.array(self._number), "values": np.array(self._values), "fresh": self._fresh.copy()}

    def load(self, state: Mapping[str, Array]) -> None:
        """Take back what `state` returned."""
        self._number = int(state["number"])
        self._judge(fresh=True)
        self._values.extend(state["values"].tolist())
        self._fresh[:] = state["fresh"]

    def _judge(self, *, fresh: bool) -> None:
        """Begin to judge the present lesson. fresh: whether the episodes that run now began in it."""
        self._until = until = self.lessons[self._number].until if self.lessons else None
        first = next(iter(self._policies.values()))
        self._policy = policy = self._policies[until.policy] if until and until.policy else first
        metric = until.metric if until else "progress"
        columns = ["lane", "reward", "length", *policy.episodes.metrics]
        self._column = 0 if metric == "progress" else columns.index(metric)  # of the finished episodes; 0: none of them
        self._values = deque(maxlen=until.episodes if until else 0)
        self._fresh = np.full(policy.lanes, fresh)
        self._seen = policy.episodes.count


def _over(until: Until, values: Sequence[float]) -> bool:
    """Return whether a lesson is over, given the values of its last episodes, or the progress alone."""
    if until.metric != "progress" and len(values) < until.episodes:
        return False
    mean = float(np.mean(values))
    return mean > until.above if until.above is not None else mean < (until.below or 0.0)
