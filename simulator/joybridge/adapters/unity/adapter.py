"""What a player shows becomes the spec of a game."""

from pathlib import Path
from typing import Any

from joybridge.adapters.settings import AdapterError
from joybridge.adapters.unity.actions import ActionRecords
from joybridge.adapters.unity.forms import BehaviorForm
from joybridge.adapters.unity.game import UnityGame
from joybridge.adapters.unity.player import UnityPlayer
from joybridge.adapters.unity.settings import UnitySettings, read_unity_settings
from joybridge.adapters.unity.sources import Builds, Ports
from joybridge.mlagents import communicator_pb2 as ml
from joybridge.simulator import spec
from joybridge.simulator.batched_game import BatchedGame

LOOK_STEPS = 16  # that a player of a build is watched for agents that come later
WAIT_STEPS = 1000  # the same for behaviors that the settings name


def adapt_build(text: str) -> type[BatchedGame]:
    """Return the game of "BUILD KEY=VALUE …". Raises AdapterError and GameError."""
    settings = read_unity_settings(text, players=16)
    source = Builds(settings)
    (player,) = source.open([0], settings.seed)
    try:
        return _adapt(text, settings, source, Look(player, settings, LOOK_STEPS), Path(settings.place).stem)
    finally:
        source.release([player])


def adapt_port(text: str) -> type[BatchedGame]:
    """Return the game of "PORT KEY=VALUE …". Raises AdapterError and GameError."""
    settings = read_unity_settings(text)
    source = Ports(settings)
    (player,) = source.open([0], settings.seed)
    try:
        return _adapt(text, settings, source, Look(player, settings, 0), "unity")
    finally:
        source.release([player])


def _adapt(text: str, settings: UnitySettings, source: Builds | Ports, look: "Look", name: str) -> type[BatchedGame]:
    forms = look.forms()
    members = {
        "name": settings.name or name,
        "description": f"{text}, a player of Unity ML-Agents.",
        "source": source,
        "settings": settings,
        "forms": forms,
    }
    game: Any = type("AdaptedGame", (UnityGame,), members)
    game.made = spec(
        game,
        [form.behavior() for form in forms],
        parameters=settings.parameters,
        max_arenas=settings.areas * settings.players,
    )
    return game  # type: ignore[no-any-return]


class Look:
    """The first look at a player: its behaviors, and how many agents each has at once."""

    def __init__(self, player: UnityPlayer, settings: UnitySettings, steps: int) -> None:
        """Reset the player, and play at least so many steps of zeros. Raises GameError."""
        self.player, self.settings = player, settings
        self.first: dict[str, ml.Agent] = {}  # of each behavior
        self._present: dict[str, set[int]] = {}
        self._most: dict[str, int] = {}
        player.ask_reset({one.name: one.default_value for one in settings.parameters})
        step = player.receive()
        actions = self._see(step)
        played = 0
        while played < steps or (settings.agents.keys() - self.first.keys() and played < WAIT_STEPS):
            player.send(ml.TrainerStep(actions=actions))
            actions = self._see(player.receive())
            played += 1
        if not played:
            player.unused = step

    def forms(self) -> list[BehaviorForm]:
        """Return the forms of all behaviors, by name. Raises AdapterError."""
        for name in self.settings.agents:
            if name not in self.first:
                seen = ", ".join(map(repr, self.first)) or "none"
                raise AdapterError(f"no agent of behavior {name!r} has come in {WAIT_STEPS} steps; it has {seen}")
        if not self.first:
            raise AdapterError(
                "the player shows no agent that asks for a decision; name its behaviors with agents=BEHAVIOR:COUNT if "
                "they come later"
            )
        return [self._form(name, agent) for name, agent in sorted(self.first.items())]

    def _form(self, name: str, agent: ml.Agent) -> BehaviorForm:
        if name not in self.player.announced:
            raise AdapterError(f"behavior {name!r} has agents, but the player has not announced its actions; update it")
        agents = self.settings.agents.get(name) or -(-self._most[name] // self.settings.areas)
        return BehaviorForm(self.player.announced[name], agent, agents, self.settings.metrics)

    def _see(self, step: ml.PlayerStep) -> dict[str, bytes]:
        """Count the agents of a step; return actions for them: zeros."""
        actions = {}
        for name, data in step.agents.items():
            agents = ml.AgentList.FromString(data).agents
            present = self._present.setdefault(name, set())
            asking = [one for one in agents if not one.done]
            present.difference_update(one.id for one in agents if one.done)
            present.update(one.id for one in asking)
            self._most[name] = max(self._most.get(name, 0), len(present))
            if asking:
                self.first.setdefault(name, asking[0])
            if name in self.player.announced:
                actions[name] = ActionRecords(self.player.announced[name].action_spec).rest(len(asking))
        return actions
