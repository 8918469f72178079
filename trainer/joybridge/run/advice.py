"""What a person would notice in the rollouts of a run: inputs or rewards of odd sizes, and a policy that stops acting.

Everything is read from full rollouts, just before the update. So it costs nothing while the games are played.
"""

import math
from collections.abc import Iterator

import numpy as np

from joybridge.config.metrics import Row
from joybridge.contract.codec import ActArrays
from joybridge.contract.limits import element_count
from joybridge.contract.tensors import Array
from joybridge.layouts.conditions import ConditionsOfGames
from joybridge.layouts.targets import covers
from joybridge.policy.policy import Policy
from joybridge.v1 import bridge_pb2 as pb

LARGE_INPUT = 10.0  # larger inputs slow learning down; about 1 is best
LARGE_REWARD = 1000.0  # likewise, for the reward of one decision
LARGE_KL = 1.0  # of an update, a mean over decisions; about 0.01 to 0.05 is usual
MORE_ENTROPY = 1.0  # nats, at least, beside twice as much as at first; training makes most policies more certain
RANDOM = 0.99  # of the largest entropy that is possible; a policy that is less certain chooses at random
RANDOM_UPDATES = 10  # after which, and after SAME_DECISIONS, a policy should have found something to prefer
RARE = 0.01  # share of decisions; a button that is pressed less often is about to be forgotten
RARE_DECISIONS = 2000  # of a rollout, from which on its shares say something
PAID = 3  # rewards of an episode, from which on it is no chance that one decision takes back their sum
TAKEN_BACK = 3  # different sums of which that has happened; a punishment is always as large
LOSSES = 0.25  # at least, of the rewards below 0, take back all where a score falls back
SAME_DECISIONS = 20_000  # after so many equal choices a policy hardly tries the others any more


class Adviser:
    """Looks at the rollouts of one policy. Nothing is said twice."""

    def __init__(self, policy: Policy, behavior: pb.Behavior) -> None:
        """Look at a policy of a behavior."""
        self._policy, self._behavior = policy, behavior
        self._sensors, self._rewards, self._kl = True, True, True  # may still be warned of
        self._entropy: float | None = None  # of the first update; infinite once it is said that it rises
        space = policy.rollout.space
        self._largest = np.inf if space.continuous else sum(map(math.log, space.branches))  # entropy
        self._random: int | None = 0  # updates at RANDOM of it so far; None: there was one below, or it is said
        self._unpaid: int | None = 0  # decisions without any reward so far; None: there was one, or it is said
        lanes = policy.rollout.rewards.shape[1]
        self._sums = np.zeros(lanes)  # of rewards in each episode
        self._paid = np.zeros(lanes, int)  # how many there were since the sum was 0
        self._taken_back: set[float] | None = set()  # sums that one decision took back; None once it is said
        self._losses = 0.0  # a share of the rewards below 0, less those that took back all
        layout = policy.actor.layout
        branches = [branch for part in (*layout.continuous, *layout.discrete) for branch in covers(part)[1]]
        self._same = dict.fromkeys(branches, (-1, 0))  # branch -> its last choice, how often
        buttons = [branch for branch in branches if len(behavior.device.branches[branch].choices) == 2]
        self._pressed = dict.fromkeys(buttons, 0.0)  # button -> its share of presses in the last rollout

    def look(self) -> Iterator[str]:
        """Yield what is remarkable about the full rollout."""
        name = self._policy.actor.name
        if self._sensors:
            self._sensors = False
            network = self._policy.actor.network
            if network.encoders and network.critic is None and not self._policy.config.shared_encoder:
                yield (
                    f"{name}: shared_encoder=false does nothing, because actor and critic share one body; set "
                    "shared_body=false as well, or leave shared_encoder out"
                )
            for sensor, peak in self._far_sensors():
                picture = sensor.dtype == pb.DTYPE_UINT8 and len(sensor.shape) > 1
                yield (
                    f"{name}: sensor {sensor.name!r} reaches {peak:g}; policies learn best from numbers of about -1 to "
                    "1: scale it in the game, or set policy."
                    f"{'image_encoder=simple, if it is a picture' if picture else 'scale_observations=running'}"
                )
        peak = float(np.abs(self._policy.rollout.rewards).max())
        if self._rewards and peak > LARGE_REWARD and not self._policy.config.scale_rewards:
            self._rewards = False
            yield (
                f"{name}: a decision is rewarded with up to ±{peak:g}; policies learn best from rewards of about -1 to "
                "1: set smaller weights in policy.reward_weights, or policy.scale_rewards=true"
            )
        choices = self._choices()
        if self._unpaid is not None:
            self._unpaid = self._unpaid + len(choices) if peak == 0.0 else None
        if self._unpaid is not None and self._unpaid >= SAME_DECISIONS:
            yield (
                f"{name}: none of {self._unpaid:,} decisions was rewarded, so nothing can be learned yet; look "
                "with `joybridge play` whether the game pays, begin with demonstrations (`joybridge clone`), or reward "
                "what leads there"
            )
            self._unpaid = None
        if self._taken_back is not None and len(taken := self._note_taken_back(self._taken_back)) >= TAKEN_BACK:
            sums = ", ".join(f"{each:g}" for each in sorted(taken)[:TAKEN_BACK])
            self._taken_back = None
            yield (
                f"{name}: one decision took back all that several before it had paid ({sums}, …), as where a game "
                "starts over and its score falls to 0: let the episode end there, for a pygame program by done=TEXT, "
                "or by a hook's done if a key skips the screen with this text"
            )
        for button, before, now in self._forgotten(choices):
            yield (
                f"{name}: {button!r} is pressed in {now:.1%} of the decisions, after {before:.1%}: it may be forgotten "
                "because presses that miss are punished; let the punishment grow (policy.penalty_ramp), or give it a "
                f"smaller weight in {self._weights()}, or raise policy.entropy_coef"
            )
        for what, decisions in self._same_choices(choices):
            yield (
                f"{name}: {what} in {decisions:,} decisions; if this is not the best play, let what punishes other "
                "choices grow (policy.penalty_ramp), or give it a smaller weight in "
                f"{self._weights()}, or raise policy.entropy_coef"
            )

    def look_at_update(self, statistics: Row) -> Iterator[str]:
        """Yield what is remarkable about the statistics of an update; there are none where nothing was decided."""
        if not statistics:
            return
        if self._kl and (kl := statistics.get("approx_kl", 0.0)) > LARGE_KL:
            self._kl = False
            yield (
                f"{self._policy.actor.name}: an update has an approx_kl of {kl:.3g}, where 0.01 to 0.05 is usual: the "
                "policy may have lost what it knew, as a clone whose actions are almost certain; lower "
                "policy.learning_rate or policy.epochs, and choose policy.target_kl=0.03"
            )
        entropy = statistics.get("entropy", -np.inf)
        self._entropy = max(entropy, 0.0) if self._entropy is None else self._entropy
        if entropy > self._entropy + max(MORE_ENTROPY, self._entropy):
            yield (
                f"{self._policy.actor.name}: the entropy has risen from {self._entropy:.2g} to {entropy:.2g}: "
                "the policy becomes less certain, and one that began as a clone loses what it knew; lower "
                "policy.entropy_coef or policy.learning_rate, or go on with the demonstrations beside PPO (--demos)"
            )
            self._entropy = np.inf

        yield from self._at_random(entropy)

    def _at_random(self, entropy: float) -> Iterator[str]:
        """Yield that a policy of choices alone has not begun to prefer any, once."""
        if self._random is None:
            return
        self._random = self._random + 1 if entropy >= RANDOM * self._largest else None
        decisions = (self._random or 0) * self._policy.rollout.rewards.size
        if self._random is not None and self._random >= RANDOM_UPDATES and decisions >= SAME_DECISIONS:
            self._random = None
            yield (
                f"{self._policy.actor.name}: after {decisions:,} decisions the entropy is still the largest that is "
                f"possible ({entropy:.3g} of {self._largest:.3g}), so nothing pays more than the rest yet. "
                "If it stays: begin with demonstrations (`joybridge clone`), reward what leads there, let it decide "
                "less often (options.decision_interval), or allow it fewer keys: docs/pygame-programs.md, "
                "If it does not learn"
            )

    def _note_taken_back(self, taken: set[float]) -> set[float]:
        """Note the sums of what several decisions of an episode had paid and one, not the last, has taken back.

        Return them, or none while most losses are others: in a game that punishes, a few are as large by chance.
        """
        rollout = self._policy.rollout
        live = rollout.decided()  # other rows are those of earlier rollouts
        ends = (rollout.terminated | rollout.truncated) & live
        for rewards, ended in zip(np.where(live, rollout.rewards, 0.0), ends, strict=True):
            lost = (rewards < 0) & ~ended
            back = (self._paid >= PAID) & lost & np.isclose(self._sums, -rewards)
            self._losses += LOSSES * lost.sum() - back.sum()
            taken |= {round(each, 3) for each in self._sums[back].tolist()}
            self._sums = np.where(ended, 0.0, self._sums + rewards)
            self._paid = np.where(np.isclose(self._sums, 0.0), 0, self._paid + (rewards > 0))
        return taken if self._losses <= 0.0 else set()

    def _weights(self) -> str:
        """Return where a kind of reward gets its weight."""
        channels = [channel.name for channel in self._behavior.channels]
        if len(channels) > 1:
            return f"policy.reward_weights ({', '.join(channels)})"
        several = isinstance(self._policy.conditions and self._policy.conditions[0], ConditionsOfGames)
        key = "games.NAME.reward_weights" if several else "policy.reward_weights"
        return f"{key}, for which the game has to pay it in a reward channel of its own"

    def _far_sensors(self) -> Iterator[tuple[pb.Sensor, float]]:
        """Yield the sensors with numbers beyond LARGE_INPUT, and the largest size of one."""
        encoder, begin = self._policy.actor.encoder, -self._policy.actor.encoder.size  # of the newest frame
        for sensor in encoder.numbers:
            end = begin + element_count(sensor)
            numbers = self._policy.rollout.observations[:, :, begin : end or None]
            peak = max(float(numbers.max()), -float(numbers.min()))
            if peak > LARGE_INPUT:
                yield sensor, peak
            begin = end

    def _choices(self) -> Array:
        """Return the choices of the device in the full rollout, [decisions, branches]."""
        rollout, device = self._policy.rollout, self._behavior.device
        decided = rollout.decided()
        count = int(decided.sum())
        act = ActArrays(
            np.zeros((count, len(device.axes)), np.float32), np.zeros((count, len(device.branches)), np.int32)
        )
        if count:
            self._policy.actor.layout.write(rollout.continuous[decided], rollout.discrete[decided], act)
        return act.choices

    def _forgotten(self, choices: Array) -> Iterator[tuple[str, float, float]]:
        """Yield the buttons whose share of presses falls below RARE, and this share before and now; once each."""
        if len(choices) < RARE_DECISIONS:
            return
        for button, before in list(self._pressed.items()):
            now = float(choices[:, button].mean())
            self._pressed[button] = now
            if now < RARE <= before:
                del self._pressed[button]
                yield self._behavior.device.branches[button].name, before, now

    def _same_choices(self, choices: Array) -> Iterator[tuple[str, int]]:
        """Yield what was chosen in the last SAME_DECISIONS decisions without exception."""
        device, count = self._behavior.device, len(choices)
        if not count:
            return
        for branch, (before, decisions) in list(self._same.items()):
            choice = int(choices[0, branch])
            if (choices[:, branch] != choice).any():
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
