"""Evaluation during training: the policies as they are now play other settings of the game, and learn nothing there.

The same episodes are played each time, so the curve shows the policies and not the luck of what is drawn.
"""

from collections.abc import Sequence
from contextlib import closing

from joybridge.client.sharded_session import session_spec
from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.config.game_settings import check_drawn, distribution_of
from joybridge.config.metrics import HELD_OUT, Row
from joybridge.policy.actor import Actor
from joybridge.policy.config_fit import fitting_spec
from joybridge.policy.episodes import Episodes, equal_shares
from joybridge.policy.players import Players
from joybridge.v1 import bridge_pb2 as pb

MAX_ARENAS = 64
OTHER_SEED = 2**63  # is flipped in the seed of the run: the games are not those of the training


class HeldOut:
    """What is played, and when."""

    def __init__(self, config: Config, spec: pb.GameSpec, address: str) -> None:
        """Take the settings; of a curriculum, those of its last lesson. spec: of the training.

        Raises ConfigError and SimulatorError.
        """
        self._due = config.evaluate_during
        if self._due is None:
            return
        last = config.in_last_lesson()
        self._config = last.model_copy(
            update={
                "options": last.options | self._due.options,
                "parameters": last.parameters | self._due.parameters,
            }
        )
        # A run that stops early, to go on later, is not at its end: a curve is that of a run that never stopped.
        self._end = config.total_timesteps if self._due.every else config.end
        self._measured = 0  # timesteps
        self._address = address
        # Parameters are checked by themselves, so that an error names the key that they are under.
        self._spec = fitting_spec(address, self._config.model_copy(update={"parameters": {}}))
        values = {name: distribution_of(value) for name, value in self._due.parameters.items()}
        check_drawn(values, self._spec, "evaluate_during.parameters")
        if len(spec.behaviors) != len(self._spec.behaviors):
            raise ConfigError(
                "evaluate_during.options: they change which behaviors there are; choose options that change the game "
                "alone"
            )
        for trained, played in zip(spec.behaviors, self._spec.behaviors, strict=True):
            if trained != played:
                raise ConfigError(
                    f"evaluate_during.options: they change sensors, device or metrics of {trained.name}, so its policy "
                    "cannot play there; choose options that change the game alone"
                )

    def rows(self, actors: Sequence[Actor], before: int, timesteps: int) -> list[Row]:
        """Return columns for the row of each policy after some timesteps, none if it is not time by `every`.

        before: the timesteps of the row before. Both count as the multiples of `log_interval` that made them due.
        Raises SimulatorError.
        """
        every, interval = self._due and self._due.every, self._config.log_interval if self._due else 1
        if not every or before // interval * interval // every == timesteps // interval * interval // every:
            return [{} for _ in actors]
        return self._measure(actors, timesteps)

    def last_rows(self, actors: Sequence[Actor], timesteps: int) -> list[Row]:
        """Return columns for the last row of each policy; none before the end, and if these policies are measured.

        timesteps: after which all updates are made. Raises SimulatorError.
        """
        if self._due is None or timesteps < self._end or timesteps == self._measured:
            return []
        return self._measure(actors, timesteps)

    def _measure(self, actors: Sequence[Actor], timesteps: int) -> list[Row]:
        self._measured = timesteps
        return [
            {f"{HELD_OUT}{name}": value for name, value in table.summarize().items()} for table in self._play(actors)
        ]

    def _play(self, actors: Sequence[Actor]) -> list[Episodes]:
        """Return the episodes of each policy."""
        config, spec, due = self._config, self._spec, self._due
        assert due is not None
        arenas, seed = min(due.episodes, spec.max_arenas, MAX_ARENAS), config.seed ^ OTHER_SEED
        players = Players(actors, config, spec, arenas, seed, deterministic=due.deterministic)
        tables = [Episodes(player.lanes, player.actor.metrics) for player in players.players]
        shares = equal_shares(due.episodes, arenas)
        with closing(session_spec(config, arenas, seed).open(self._address)) as session:
            players.begin(session.steps)
            while not all(table.has(shares) for table in tables):
                steps = session.step(players.act(session.steps))
                for actor, table, rewards in zip(actors, tables, players.store(steps), strict=True):
                    table.add(steps[actor.behavior], rewards)
        for table in tables:
            table.keep(shares)
        return tables
