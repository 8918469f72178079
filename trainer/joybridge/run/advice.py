"""What a person would notice in the rollouts of a run: inputs or rewards of odd sizes, and a policy that stops acting.

Everything is read from full rollouts, just before the update. So it costs nothing while the games are played.
"""

from collections.abc import Iterator

import numpy as np

from joybridge.contract.codec import ActArrays
from joybridge.contract.limits import element_count
from joybridge.layouts.targets import covers
from joybridge.policy.policy import Policy
from joybridge.v1 import bridge_pb2 as pb

FAR = 10.0  # larger inputs slow learning down; about 1 is best
HUGE = 1000.0  # likewise, for the reward of one decision
SAME_DECISIONS = 20_000  # after so many equal choices a policy hardly tries the others any more


class Adviser:
    """Looks at the rollouts of one policy. Nothing is said twice."""

    def __init__(self, policy: Policy, behavior: pb.Behavior) -> None:
        """Look at a policy of a behavior."""
        self._policy, self._behavior = policy, behavior
        self._sensors, self._rewards = True, True  # may still be warned of
        layout = policy.actor.layout
        branches = [branch for part in (*layout.continuous, *layout.discrete) for branch in covers(part)[1]]
        self._same = dict.fromkeys(branches, (-1, 0))  # branch -> its last choice, how often

    def look(self) -> Iterator[str]:
        """Yield what is remarkable about the full rollout."""
        name = self._policy.actor.name
        if self._sensors:
            self._sensors = False
            for sensor, peak in self._far_sensors():
                yield (
                    f"{name}: sensor {sensor!r} reaches {peak:g}; policies learn best from numbers of about -1 to 1: "
                    "scale it in the game, or set policy.scale_observations=running"
                )
        peak = float(np.abs(self._policy.rollout.rewards).max())
        if self._rewards and peak > HUGE and not self._policy.config.scale_rewards:
            self._rewards = False
            yield (
                f"{name}: a decision is rewarded with up to ±{peak:g}; policies learn best from rewards of about -1 to "
                "1: set smaller weights in policy.reward_weights, or policy.scale_rewards=true"
            )
        for what, decisions in self._same_choices():
            yield (
                f"{name}: {what} in {decisions:,} decisions; if this is not the best play, give what punishes other "
                "choices a smaller weight in policy.reward_weights, or raise policy.entropy_coef"
            )

    def _far_sensors(self) -> Iterator[tuple[str, float]]:
        """Yield the sensors with numbers beyond FAR, and the largest size of one."""
        encoder, begin = self._policy.actor.encoder, -self._policy.actor.encoder.size  # of the newest frame
        for sensor in encoder.numbers:
            end = begin + element_count(sensor)
            numbers = self._policy.rollout.observations[:, :, begin : end or None]
            peak = max(float(numbers.max()), -float(numbers.min()))
            if peak > FAR:
                yield sensor.name, peak
            begin = end

    def _same_choices(self) -> Iterator[tuple[str, int]]:
        """Yield what was chosen in the last SAME_DECISIONS decisions without exception."""
        rollout, device = self._policy.rollout, self._behavior.device
        decided = rollout.decided()
        count = int(decided.sum())
        if not self._same or not count:
            return
        act = ActArrays(
            np.zeros((count, len(device.axes)), np.float32), np.zeros((count, len(device.branches)), np.int32)
        )
        self._policy.actor.layout.write(rollout.continuous[decided], rollout.discrete[decided], act)
        for branch, (before, decisions) in list(self._same.items()):
            choice = int(act.choices[0, branch])
            if (act.choices[:, branch] != choice).any():
                self._same[branch] = (-1, 0)
                continue
            decisions = count + (decisions if choice == before else 0)
            self._same[branch] = (choice, decisions)
            if decisions >= SAME_DECISIONS:
                del self._same[branch]
                yield _in_words(device.branches[branch], choice), decisions


def _in_words(branch: pb.Branch, choice: int) -> str:
    if len(branch.choices) == 2:  # a button
        return f"{branch.name!r} was {'always' if choice else 'never'} pressed"
    return f"{branch.name!r} was always {branch.choices[choice]!r}"
