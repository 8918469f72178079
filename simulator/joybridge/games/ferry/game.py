"""Ferry: a helmsman steers a boat through gates, and two lookouts sound the horn when a ship is on their side.

Two behaviors that are trained at the same time: one agent with an axis, and two agents with a button.
"""

from collections.abc import Mapping

import numpy as np

from joybridge.contract.tensors import Array
from joybridge.simulator import Action, Game, TimeStep, axis, behavior, button, sensor, spec, transition, truncation
from joybridge.v1 import bridge_pb2 as pb

DECISIONS = 60  # per episode
GATE_DECISIONS = 12  # until the next gate
SHIP_CHANCE = 0.3  # that there is a ship on a side, per decision
SPEED = 0.25  # of the boat across the river per decision at full rudder; the river reaches from -1 to 1
WIDTH, HEIGHT = 320, 240
SIDES = ("port", "starboard")


class Ferry(Game):
    """One river with one boat."""

    name = "ferry"
    description = "Steer through the gates and sound the horn at ships: two behaviors, three agents."
    version = "1"
    in_event_loop = True

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec: a helmsman and two lookouts."""
        helmsman = behavior(
            "helmsman",
            description="rewarded for being near the middle of the next gate, at most 1 per decision",
            sensors=[
                sensor("boat", [1], -1, 1, "across the river"),
                sensor("gate", [2], -1, 1, "position across the river, fraction of the way to it that is done"),
            ],
            axes=[axis("rudder")],
        )
        lookout = behavior(
            "lookout",
            description="reward 1 for sounding the horn if and only if there is a ship, else -1",
            sensors=[sensor("ship", [1], 0, 1, "1 if there is one on this lookout's side")],
            branches=[button("horn")],
            agents=len(SIDES),
        )
        return spec(cls, [helmsman, lookout], max_episode_decisions=DECISIONS, picture=(WIDTH, HEIGHT))

    def reset(self) -> list[TimeStep]:
        """Begin an episode in the middle of the river."""
        self.decisions, self.boat, self.gate = 0, 0.0, float(self.rng.uniform(-0.9, 0.9))
        self.ships = np.zeros(len(SIDES), bool)
        self.horns = np.zeros(len(SIDES), bool)
        return [transition(observation) for observation in self._observe()]

    def step(self, action: list[Action]) -> list[TimeStep]:
        """Steer the boat and sound the horns, then move on to the next ships and gate."""
        helm, *lookouts = action
        self.boat = min(1.0, max(-1.0, self.boat + SPEED * helm["rudder"]))
        self.horns = np.array([lookout["horn"] == 1 for lookout in lookouts])
        paid = [1.0 - min(1.0, abs(self.boat - self.gate)), *np.where(self.horns == self.ships, 1.0, -1.0)]
        self.ships = self.rng.random(len(SIDES)) < SHIP_CHANCE
        self.decisions += 1
        if self.decisions % GATE_DECISIONS == 0:
            self.gate = float(self.rng.uniform(-0.9, 0.9))
        build = transition if self.decisions < DECISIONS else truncation
        return [build(seen, {"reward": float(reward)}) for seen, reward in zip(self._observe(), paid, strict=True)]

    def _observe(self) -> list[dict[str, list[float]]]:
        near = (self.decisions % GATE_DECISIONS) / GATE_DECISIONS
        helmsman = {"boat": [self.boat], "gate": [self.gate, near]}
        return [helmsman, *({"ship": [float(ship)]} for ship in self.ships)]

    def draw(self) -> Array:
        """Return a picture: the river from above, the gate ahead, ships and horns at the edges."""
        import pygame  # imported here because only pictures need it

        canvas = pygame.Surface((WIDTH, HEIGHT))
        canvas.fill((38, 110, 160))
        for bank in (0, WIDTH - 24):
            pygame.draw.rect(canvas, (74, 128, 66), (bank, 0, 24, HEIGHT))

        def across(place: float) -> float:
            return WIDTH / 2 + place * (WIDTH / 2 - 50)

        gate_y = 20 + 150 * (self.decisions % GATE_DECISIONS) / GATE_DECISIONS
        for side in (-28, 28):
            pygame.draw.circle(canvas, (226, 60, 48), (across(self.gate) + side, gate_y), 7)
        x, y = across(self.boat), HEIGHT - 50
        pygame.draw.polygon(
            canvas, (245, 240, 225), [(x, y - 22), (x + 11, y), (x + 8, y + 18), (x - 8, y + 18), (x - 11, y)]
        )
        for side, (ship, horn) in enumerate(zip(self.ships, self.horns, strict=True)):
            edge = 12 if side == 0 else WIDTH - 12
            if ship:
                pygame.draw.rect(canvas, (60, 46, 40), (edge - 10, 110, 20, 34), border_radius=6)
            if horn:
                for radius in (10, 16):
                    pygame.draw.circle(canvas, (255, 230, 120), (x + (-18 if side == 0 else 18), y), radius, width=2)
        return np.ascontiguousarray(pygame.surfarray.array3d(canvas).swapaxes(0, 1))
