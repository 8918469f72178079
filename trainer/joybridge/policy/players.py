"""All who play in some arenas, with the limits of their hands: the cycle of acting and storing, but for training."""

from collections.abc import Sequence

from joybridge.config.config import Config
from joybridge.contract.codec import ActArrays, StepArrays, lane_count
from joybridge.contract.tensors import Array
from joybridge.layouts import make_acts
from joybridge.policy.actor import Actor
from joybridge.policy.hand import make_hands
from joybridge.policy.player import PolicyPlayer
from joybridge.policy.table import Table
from joybridge.v1 import bridge_pb2 as pb


class Players:
    """Actors in all lanes of some arenas, or others in some seats. Steps and acts hold an entry per behavior."""

    def __init__(
        self,
        actors: Sequence[Actor],
        config: Config,
        spec: pb.GameSpec,
        arenas: int,
        seed: int,
        *,
        deterministic: bool = False,
    ) -> None:
        """Seat the actors. config: sets the limits of the hands. `seed` fixes samples and noise."""
        self.players = [
            PolicyPlayer(actor, lane_count(spec.behaviors[actor.behavior], arenas), seed, deterministic=deterministic)
            for actor in actors
        ]
        self._hands = make_hands(config, spec, 0, arenas, seed)
        self._others: Table | None = None
        self._acts = make_acts(spec, arenas)

    def seat(self, others: Table) -> None:
        """Let others hold the seats of all holders that have joined them. Call this before the first decision."""
        self._others = others

    def begin(self, steps: Sequence[StepArrays]) -> None:
        """Take the first steps of a session."""
        if self._others:
            self._others.begin(steps)
        for player in self.players:
            player.begin(steps[player.actor.behavior])

    def act(self, steps: Sequence[StepArrays]) -> list[ActArrays]:
        """Return what the devices get for the present steps; overwritten by the next call."""
        for player in self.players:
            behavior = player.actor.behavior
            player.act(steps[behavior], self._acts[behavior])
        for player in self.players:
            player.note(steps[player.actor.behavior], self._acts[player.actor.behavior])
        if self._others:
            self._others.act(steps, self._acts)
        for hand, step, act in zip(self._hands, steps, self._acts, strict=False):  # there may be no hands
            hand.apply(step, act)
        return self._acts

    def store(self, steps: Sequence[StepArrays]) -> list[Array]:
        """Take the steps that followed the acts; return the rewards [lanes] of each policy."""
        rewards = [player.store(steps[player.actor.behavior]) for player in self.players]
        if self._others:
            self._others.sit(steps)
        for hand, step in zip(self._hands, steps, strict=False):
            hand.store(step)
        return rewards
