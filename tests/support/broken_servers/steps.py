"""Servers that break rules of observations, rewards, masks and ends."""

import numpy as np

from joybridge.contract.codec import pack
from tests.support.broken_servers.gauntlet import LONGEST, Gauntlet
from tests.support.broken_servers.serving import Honest, broken, change, floats, read


@broken("observations_match_the_sensors")
class WrongShape(Honest):
    def later(self, step):
        change(step.behaviors[0].observations[0], floats(step.behaviors[0].observations[0]).reshape(-1))


@broken("observations_are_in_bounds")
class OutOfBounds(Honest):
    def later(self, step):
        change(step.behaviors[0].observations[0], floats(step.behaviors[0].observations[0]) + 19)


@broken("rewards_are_finite")
class RewardIsNotANumber(Honest):
    def later(self, step):
        change(step.behaviors[2].rewards, floats(step.behaviors[2].rewards) * np.float32(np.nan))


@broken("rewards_of_skipped_lanes_are_zero")
class PaysWhoWaits(Honest):
    def later(self, step):
        change(step.behaviors[1].rewards, floats(step.behaviors[1].rewards) + 1)


@broken("no_lane_is_terminated_and_truncated")
class BothEnds(Honest):
    def later(self, step):
        for part in step.behaviors:
            part.truncated.data = bytes(a | b for a, b in zip(part.truncated.data, part.terminated.data, strict=True))
            part.terminated.CopyFrom(part.truncated)


@broken("final_observations_have_a_row_per_ended_lane")
class NoFinalObservation(Honest):
    def later(self, step):
        for part in step.behaviors:
            if part.HasField("ended"):
                part.ended.ClearField("final_observations")


@broken("ended_lanes_match_the_flags")
class EndsInAnotherOrder(Honest):
    def later(self, step):
        for part in step.behaviors:
            if part.HasField("ended"):
                change(part.ended.lanes, np.frombuffer(part.ended.lanes.data, "<i4")[::-1] + 1)


@broken("interrupted_has_a_flag_per_ended_lane")
class InterruptsWhatIsNotTruncated(Honest):
    def later(self, step):
        for part in step.behaviors:
            if part.HasField("ended"):
                part.ended.interrupted.CopyFrom(pack(np.ones(len(of_ended_lanes(part)), bool)))


@broken("interrupted_has_a_flag_per_ended_lane")
class FailsWithinTheKit(Honest):
    def later(self, step):
        for part in step.behaviors:
            if part.HasField("ended"):
                truncated = np.frombuffer(part.truncated.data, bool)[of_ended_lanes(part)]
                part.ended.interrupted.CopyFrom(pack(truncated))


@broken("metrics_have_a_row_per_ended_lane")
class NoMetrics(Honest):
    def later(self, step):
        for part in step.behaviors:
            part.ended.ClearField("metrics") if part.HasField("ended") else None


@broken("episodes_are_not_longer_than_max_episode_decisions")
class EpisodesTooLong(Gauntlet):
    longest = LONGEST + 1


@broken("episodes_are_not_longer_than_max_episode_decisions")
class EpisodesTooLongForThoseWhoIdle(EpisodesTooLong):
    """Random actions end an episode early: only who never presses the button plays for long."""

    def step(self, acts):
        self.place[acts[0].choices[:, 1] == 1] = 9.0
        return super().step(acts)


def of_ended_lanes(part):
    """Return the rows of the ended lanes of a BehaviorStep."""
    return np.frombuffer(part.ended.lanes.data, "<i4")


@broken("final_observations_belong_to_the_old_episode")
class ObservesAfterTheReset(Honest):
    def later(self, step):
        for part in step.behaviors:
            for final, new in zip(part.ended.final_observations, part.observations, strict=False):
                change(final, read(new)[of_ended_lanes(part)])


@broken("final_observations_belong_to_the_old_episode")
class ObservesBeforeTheReset(Honest):
    def later(self, step):
        for part in step.behaviors:
            for final, new in zip(part.ended.final_observations, part.observations, strict=False):
                values = read(new)
                values[of_ended_lanes(part)] = read(final)
                change(new, values)


@broken(warned={"metrics_belong_to_the_old_episode"})
class MetricsOfTheNewEpisode(Honest):
    def later(self, step):
        for part in step.behaviors:
            if part.ended.HasField("metrics"):
                change(part.ended.metrics, np.zeros_like(read(part.ended.metrics)))


@broken("every_choice_plays_by_the_rules")
class NotANumberInLargeOnly(Gauntlet):
    def part(self, index, happened):
        part = super().part(index, happened)
        if self.cells == 5:
            part.rewards[:] = np.nan
        return part


@broken("every_choice_plays_by_the_rules")
class RandomInLargeOnly(Gauntlet):
    def draws(self, arena):
        return np.random.default_rng().normal(size=2) if self.cells == 5 else super().draws(arena)


@broken("first_masks_are_valid", "masks_are_valid")
class AllowsNothing(Honest):
    def every(self, step):
        mask = step.behaviors[0].masks[1]
        mask.data = bytes(len(mask.data))
