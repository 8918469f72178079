"""Play the policies of a run without learning: what evaluation, recording and the tools share.

with open_play(PlaySpec(run, address, seed=1)) as play:
    for decision in play.decisions():
        ...
"""

import math
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from joybridge.client.client import Session
from joybridge.client.several_session import SeveralSession
from joybridge.client.sharded_session import ShardedSession, divide, open_session, session_spec
from joybridge.config.config import Config, play_settings
from joybridge.config.game_settings import Value, value_text
from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.tensors import Array
from joybridge.play.policy_view import PolicyView
from joybridge.policy.actor import trained_actors
from joybridge.policy.config_fit import fitting_spec
from joybridge.policy.lineup import make_lineup
from joybridge.policy.players import Players
from joybridge.policy.random_player import RandomPlayer
from joybridge.policy.stratify import balanced_options
from joybridge.policy.table import Table
from joybridge.ppo.threads import use_one_thread
from joybridge.run.folder import SPEC, play_config, run_spec
from joybridge.run.others import seat_others
from joybridge.run.run_state import load_state
from joybridge.v1 import bridge_pb2 as pb


@dataclass(frozen=True)
class Change:
    """An option, a parameter or the version of the game, or a limit of the hand, that differs from the training."""

    trained: str | Value
    played: str | Value


@dataclass(frozen=True)
class Played:
    """One decision of all arenas. Steps and acts hold an entry per behavior, rewards one per policy."""

    before: list[StepArrays]  # what the policies observed
    acts: list[ActArrays]  # what the devices got; overwritten by the next decision
    after: list[StepArrays]
    rewards: list[Array]  # [lanes], as the policy gets them
    pictures: list[Array]  # uint8 [height, width, 3] of the first arena, where it was drawn; the last: at the end


class Policies(Players):
    """The policies of a run in all lanes of a number of arenas. timesteps: how long they have trained."""

    def __init__(
        self,
        run: Path,
        config: Config,
        spec: pb.GameSpec,
        arenas: int,
        seed: int,
        *,
        deterministic: bool = False,
        checkpoint: str = "",
    ) -> None:
        """Load a checkpoint of a run; see `open_play`. Raises CheckpointError and ConfigError."""
        use_one_thread()
        state = load_state(run, checkpoint)
        self.timesteps = state.timesteps
        actors = trained_actors(config, spec, state.arrays)
        super().__init__(actors, config, spec, arenas, seed, deterministic=deterministic)


class Play:
    """The policies of a run in an open session."""

    def __init__(
        self,
        config: Config,
        changed: dict[str, Change],
        choices: Sequence[str],
        arenas: int,
        session: Session | ShardedSession | SeveralSession,
        policies: Policies,
        held: Sequence[Array],
    ) -> None:
        """Play `arenas` arenas. changed: what differs from the training. choices: see `balanced_options`.

        held: the lanes that the policies hold, a bool for each, per behavior.
        """
        self.config, self.changed, self.choices = config, changed, choices
        self.session, self._policies = session, policies
        self.players, self.timesteps = policies.players, policies.timesteps
        self.spec = session.spec
        self.arenas, self.held = arenas, held

    def heading(self, who: str = "", actions: str = "") -> str:
        """Return what plays, and what differs from its training. who: plays instead. actions: how they are chosen."""
        changed = [
            f"{key}={_text(change.played)} (trained with {_text(change.trained)})"
            for key, change in self.changed.items()
        ]
        timesteps = f"after {self.timesteps:,} timesteps" if self.timesteps else "before its first timestep"
        who = who or f"policy {timesteps}"
        return "; ".join([f"{who}{actions and f', {actions}'}", *changed])

    def view(self) -> PolicyView:
        """Return what draws the images that the policies see, and what they remember."""
        encoders = [(player.actor.behavior, player.actor.encoder) for player in self.players]
        return PolicyView(self.spec, encoders, [len(states) for states in self.remembered()])

    def remembered(self) -> list[Array]:
        """Return what each policy with memory remembers where it plays in the first arena, [agents, numbers]."""
        states = []
        for player in self.players:
            memory, state = player.actor.network.actor.memory, player.observations.memory
            if memory is not None and state is not None:
                agents = self.spec.behaviors[player.actor.behavior].agents_per_arena
                mine = self.held[player.actor.behavior][:agents]
                states.append(state[:agents][mine, : memory.state_size])  # what follows is the critic's
        return states

    def decisions(self, draw_every: int = 0, *, ticks: bool = False) -> Iterator[Played]:
        """Yield decisions without end. draw_every: draw the first arena after every so many decisions; 0: never.

        ticks: where the game can, draw it also after each tick of these decisions. A session over several choices of
        `stratify_by` cannot be drawn. Raises SimulatorError.
        """
        session, number = self.session, 0
        while True:
            number += 1
            before = session.steps
            acts = self._policies.act(before)
            pictures: list[Array] = []
            if draw_every and number % draw_every == 0:
                assert not isinstance(session, ShardedSession)
                if ticks and isinstance(session, Session):
                    after, pictures = session.step_and_draw_ticks(acts)
                else:
                    after, pictures = session.step_and_draw(acts, [0])
            else:
                after = session.step(acts)
            yield Played(before, acts, after, self._policies.store(after), pictures)


@dataclass(frozen=True)
class PlaySpec:
    """Which policies play, where and how."""

    run: Path
    address: str  # of the simulator
    seed: int  # of the games and the samples
    deterministic: bool = False  # take the most probable actions
    overrides: Sequence[str] = ()  # "key=value" each: options and parameters of the game that differ from the training
    checkpoint: str = ""  # "best", its timesteps, or "" for the newest
    random: bool = False  # act at random instead of as the policy does
    others: Sequence[str] = ()  # who hold all seats but one of each arena, in turn, see `load_other`
    only_game: str = ""  # which of several games is played; "": the first


@contextmanager
def open_play(plays: PlaySpec, *, episodes: int = 0, arenas_limit: int = 64) -> Iterator[Play]:
    """Load a checkpoint of a run and open a session at a simulator; the session is closed on leaving.

    episodes: 0 plays one arena under the options of the run. Otherwise arenas for this number of episodes at once, at
    most `arenas_limit` per choice of the option `stratify_by`; arenas of the same choice are side by side.

    Raises SimulatorError, CheckpointError and ConfigError.
    """
    run, seed, address = plays.run, plays.seed, plays.address
    trained, config = play_config(run, ()), play_config(run, plays.overrides)
    lineup = make_lineup(address, config) if config.games or plays.only_game else None
    if lineup:
        game = plays.only_game or next(iter(config.games))
        trained, config = trained.of_game(game), config.of_game(game)
        address = lineup.games[game].simulator or address
    spec = lineup.spec_of(game) if lineup else fitting_spec(address, config)
    options = balanced_options(config, spec) if episodes else {"": config.options}
    arenas = len(options) * max(1, min(math.ceil(episodes / len(options)), spec.max_arenas, arenas_limit))
    policies = Policies(run, config, spec, arenas, seed, deterministic=plays.deterministic, checkpoint=plays.checkpoint)
    parts = divide(session_spec(config, arenas, seed), len(options), [*options.values()])
    session: Session | ShardedSession | SeveralSession = open_session([address] * len(parts), parts)
    if lineup and not isinstance(session, SeveralSession):
        session = SeveralSession([session], [arenas], [lineup.translation(game, alone=True)], spec)
    with closing(session):
        table = Table(spec, arenas, seed)
        if plays.others:
            table = seat_others(plays.others, config.game, spec, arenas, seed)
            for arena, dealt in enumerate(table.seats.dealt.tolist()):
                table.seats.begin(arena, np.roll(dealt, arena))
            policies.seat(table)
        held = [table.seats.holders(behavior) == 0 for behavior in range(len(spec.behaviors))]
        if plays.random:
            policies.players = [
                RandomPlayer(player.actor, spec.behaviors[player.behavior].device, player.lanes, seed)
                for player in policies.players
            ]
        policies.begin(session.steps)
        changed = changed_settings(trained, config, lineup.specs[game] if lineup else spec)
        if (run / SPEC).exists() and (was := run_spec(run).version) != spec.version:
            changed["version"] = Change(was, spec.version)
        yield Play(config, changed, list(options), arenas, session, policies, held)


def changed_settings(trained: Config, played: Config, spec: pb.GameSpec) -> dict[str, Change]:
    """Return what differs between two configurations of a game, by key, as in "parameters.size" and "hand.delay"."""
    defaults: dict[str, str | Value] = {f"options.{option.name}": option.default_choice for option in spec.options}
    defaults |= {f"parameters.{parameter.name}": parameter.default_value for parameter in spec.parameters}
    before, now = defaults | play_settings(trained), defaults | play_settings(played)
    return {key: Change(before[key], now[key]) for key in now if before[key] != now[key]}


def _text(value: str | Value) -> str:
    return value if isinstance(value, str) else value_text(value)
