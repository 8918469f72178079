"""Who plays at random: beside the score of chance, that of a policy means something."""

from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.tensors import Array
from joybridge.layouts.random_acts import obey_masks, press_at_random
from joybridge.policy.actor import Actor
from joybridge.policy.player import PolicyPlayer
from joybridge.v1 import bridge_pb2 as pb


class RandomPlayer(PolicyPlayer):
    """Acts at random in the place of a policy, whatever its layout, and gets the rewards that this would get."""

    def __init__(self, actor: Actor, device: pb.Device, lanes: int, seed: int) -> None:
        """Begin in so many lanes. `seed` fixes the actions."""
        super().__init__(actor, lanes, seed, deterministic=False)
        self.device = device

    def act(self, step: StepArrays, act: ActArrays, held: Array | None = None) -> None:
        """Write random axes and allowed choices for the whole device into `act`, in some lanes or in all."""
        chosen = ActArrays(act.axes.copy(), act.choices.copy())
        press_at_random(self.device, chosen, self.rng)
        obey_masks(chosen, step, self.rng)
        where = slice(None) if held is None else held
        act.axes[where], act.choices[where] = chosen.axes[where], chosen.choices[where]
