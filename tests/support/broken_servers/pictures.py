"""Servers that break rules of pictures and snapshots."""

import numpy as np

from tests.support.broken_servers.gauntlet import DRAWS, Gauntlet
from tests.support.broken_servers.serving import Honest, broken


@broken("pictures_have_the_size_of_the_spec")
class PicturesOnTheirSide(Honest):
    def later(self, step):
        for picture in step.pictures:
            picture.shape[:2] = reversed(picture.shape[:2])


@broken("pictures_of_ticks_have_the_size_of_the_spec")
class PicturesOfTooManyTicks(Honest):
    def later(self, step):
        step.tick_pictures.extend(2 * list(step.tick_pictures))


@broken("pictures_of_ticks_have_the_size_of_the_spec")
class TicksInGray(Honest):
    def later(self, step):
        for picture in step.tick_pictures:
            picture.shape[2], picture.data = 1, picture.data[::3]


@broken("drawing_does_not_change_the_episode")
class TicksAreReal(Gauntlet):
    def step(self, acts):
        if self.drawn_by_tick is not None:
            self.draws(self.drawn_by_tick)
        return super().step(acts)


@broken("pictures_are_in_the_order_of_draw")
class PicturesInOrderOfArenas(Honest):
    def request(self, request):
        if request.HasField("act"):
            request.act.draw[:] = sorted(request.act.draw)
        return request


@broken("unknown_arena_in_draw_is_refused")
class DrawsAnyArena(Honest):
    def request(self, request):
        if request.HasField("act"):
            request.act.draw[:] = [arena % 2 for arena in request.act.draw]
        return request


@broken("drawing_does_not_change_the_episode")
class DrawingDraws(Gauntlet):
    def draw(self, arena):
        picture = super().draw(arena)
        self.draws(arena)
        return picture


@broken("session_continues_from_a_snapshot", "snapshot_includes_seed_and_parameters_of_reset")
class SnapshotForgets(Gauntlet):
    def restore(self, state):
        super().restore(state)
        self.counts[:, DRAWS] = 0


@broken("snapshot_includes_seed_and_parameters_of_reset")
class SnapshotForgetsTheSeed(Gauntlet):
    def restore(self, state):
        seed = self.seed
        super().restore(state)
        self.seed = seed


@broken("snapshot_includes_seed_and_parameters_of_reset")
class SnapshotForgetsParameters(Gauntlet):
    def restore(self, state):
        drift = self.drift
        super().restore(state)
        self.drift = drift


@broken("values_of_a_snapshot_are_checked")
class RestoresAnything(Gauntlet):
    def check(self, state):
        pass


@broken("snapshot_with_another_seed_is_refused")
class SnapshotOfAnySeed(Honest):
    def request(self, request):
        if request.start.HasField("snapshot"):
            request.start.seed = 1
        return request


@broken("snapshot_is_not_larger_than_the_spec_says")
class LargeSnapshots(Gauntlet):
    def save(self):
        return {**super().save(), "padding": np.zeros(1000, np.uint8)}
