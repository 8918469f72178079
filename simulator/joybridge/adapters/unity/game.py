"""Players of Unity ML-Agents as a game: `joybridge serve --unity BUILD` and `joybridge serve --unity-port 5004`.

A player has the same number of areas as any other, and each area is an arena; its agents are the arena's lanes.
"""

from collections.abc import Mapping
from typing import Any, ClassVar

from joybridge.adapters.unity.forms import BehaviorForm
from joybridge.adapters.unity.lanes import Lanes
from joybridge.adapters.unity.player_agents import PlayerAgents
from joybridge.adapters.unity.settings import UnitySettings
from joybridge.adapters.unity.sources import Builds, Ports
from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.simulator.batched_game import BatchedGame
from joybridge.v1 import bridge_pb2 as pb


class UnityGame(BatchedGame):
    """Some arenas, which several players play. `adapt` creates the subclass for a build or a port."""

    source: ClassVar[Builds | Ports]
    settings: ClassVar[UnitySettings]
    forms: ClassVar[list[BehaviorForm]]
    made: ClassVar[pb.GameSpec]

    @classmethod
    def describe(cls, options: Mapping[str, str]) -> pb.GameSpec:
        """Return the spec that was made from what a player has shown."""
        return cls.made

    def __init__(
        self, options: Mapping[str, str], parameters: Mapping[str, float], arenas: int, first_arena: int, seed: int
    ) -> None:
        """Take the players of these arenas and begin. Raises GameError."""
        self._parameters = {one.name: one.default_value for one in self.settings.parameters} | dict(parameters)
        self._first_arena = first_arena
        areas = self.settings.areas
        self._numbers = range(first_arena // areas, (first_arena + arenas - 1) // areas + 1)
        self._lanes = {form.name: Lanes(form, arenas) for form in self.forms}
        self._agents: list[PlayerAgents] = []
        self._play_with(self.source.open(self._numbers, seed), unused=not parameters)

    def reset(self, seed: int | None, parameters: Mapping[str, float]) -> None:
        """Begin new episodes; with a seed, in players that begin with it."""
        self._parameters.update(parameters)
        players = [agents.player for agents in self._agents]
        if seed is None:
            self._begin()
        else:
            self._play_with(self.source.reseed(players, self._numbers, seed), unused=False)

    def observe(self) -> list[StepArrays]:
        """Return the current observations, with zero rewards and no episode ends."""
        return self._step

    def step(self, acts: list[ActArrays]) -> list[StepArrays]:
        """Advance every player by one decision of its agents."""
        by_name = dict(zip(self._lanes, acts, strict=True))
        for agents in self._agents:
            agents.player.send(agents.actions(by_name))
        for lanes in self._lanes.values():
            lanes.begin()
        for agents in self._agents:
            agents.take(agents.player.receive(), self._lanes)
        return [lanes.step() for lanes in self._lanes.values()]

    def close(self) -> None:
        """Give the players back."""
        self.source.release([agents.player for agents in self._agents])
        self._agents = []

    def _play_with(self, players: list[Any], *, unused: bool) -> None:
        areas = self.settings.areas
        self._agents = [
            PlayerAgents(player, self.forms, areas, number * areas - self._first_arena)
            for number, player in zip(self._numbers, players, strict=True)
        ]
        try:
            self._begin(unused=unused)
        except BaseException:
            self.close()
            raise

    def _begin(self, *, unused: bool = False) -> None:
        """Begin new episodes in all players. unused: also where they have begun already and nothing was played."""
        begun = [unused and agents.player.unused for agents in self._agents]
        for agents, first in zip(self._agents, begun, strict=True):
            if not first:
                agents.player.ask_reset(self._parameters)
        for lanes in self._lanes.values():
            lanes.clear()
        for agents, first in zip(self._agents, begun, strict=True):
            agents.begin(first or agents.player.receive(), self._lanes)
            agents.player.unused = None
        self._step = [lanes.step() for lanes in self._lanes.values()]
