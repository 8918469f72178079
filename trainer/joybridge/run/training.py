"""A run that goes on: its sessions, its policies, its metrics and its lessons."""

import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

from joybridge.client.fault_log import FAULTS
from joybridge.client.sharded_session import single_sessions
from joybridge.config.config import Config
from joybridge.config.errors import ConfigError, DivergedError
from joybridge.config.game_settings import drawn
from joybridge.config.metrics import HELD_OUT, Row, training_columns
from joybridge.demonstrations.cloning import demonstrate
from joybridge.policy.actor import make_actors
from joybridge.policy.config_fit import fitting_spec
from joybridge.policy.lineup import arenas_by_game, kinds_of, make_lineup
from joybridge.policy.policy import Policy
from joybridge.policy.stratify import balanced_options
from joybridge.run.advice import Adviser
from joybridge.run.collect import Group, group_bounds, open_groups
from joybridge.run.curriculum import Curriculum
from joybridge.run.folder import keep_config, keep_spec
from joybridge.run.held_out import HeldOut
from joybridge.run.league import League
from joybridge.run.lengths import intervals_too_short, too_few_updates
from joybridge.run.logger import Logger
from joybridge.run.origin import keep_origin
from joybridge.run.profiler import Profiler
from joybridge.run.progress import held_out_text, row_text
from joybridge.run.run_state import RunState, capture, take_weights
from joybridge.run.waits import LEFT_SHARE, Slow, Waits
from joybridge.v1 import bridge_pb2 as pb

Report = Callable[[int, Row, Row | None], None]  # (timesteps, live figures, new row of the first policy or None)


def _ignore(timesteps: int, live: Row, row: Row | None) -> None:
    """Take figures that nobody looks at."""


class Audience(NamedTuple):
    """Who follows a run: figures go to `report`, remarks, a line each, to `say`."""

    report: Report = _ignore
    say: Callable[[str], None] = print


@dataclass
class Training:
    """What a run consists of while it goes on."""

    config: Config
    policies: Sequence[Policy]
    groups: Sequence[Group]
    loggers: Sequence[Logger]  # one for each policy
    curriculum: Curriculum
    league: League | None  # None where the learner holds all seats
    held_out: HeldOut
    audience: Audience

    def __post_init__(self) -> None:
        """Nothing is played yet. Raises ConfigError."""
        self.timesteps, self.profiler = 0, Profiler()
        self.stretches, self.stretch = rollout_stretches(self.policies)
        behaviors = self.groups[0].session.spec.behaviors
        self._advisers = [Adviser(policy, behaviors[policy.actor.behavior]) for policy in self.policies]
        self._metric, self._sign = best_metric(self.config, self.policies[0])
        self._score: float | None = None  # of the rows since the last state
        self._logged = 0  # timesteps
        self._waits = Waits([session for group in self.groups for session in single_sessions(group.session)])
        self._slow = ""  # the simulator that was last said to be slow

    def begin(self, state: RunState) -> None:
        """Begin, or continue from a state. Raises CheckpointError."""
        self.timesteps = self._logged = state.timesteps
        self._limit_hands()
        if state.arrays:
            state.restore(self.policies, self.loggers, self.groups, self.league)
            if state.snapshots is None:
                self.audience.say(
                    f"{self.groups[0].session.spec.name} has no snapshots, so new episodes begin: the run learns on, "
                    "but not to the same bits as one that never stopped"
                )
        elif self.config.weights_from:
            trained = take_weights(self.policies, Path(self.config.weights_from), self.config.games)
            self.audience.say(f"begins with the policies of {self.config.weights_from} after {trained:,} timesteps")
        if self.league:
            self.renew_opponents()
            for group, opponents in zip(self.groups, self.league.groups, strict=True):
                group.opponents = opponents
                if state.snapshots is None:
                    opponents.begin(group.session.steps)
                opponents.see(group.session.steps)
        if state.snapshots is None:
            for policy in self.policies:
                policy.begin([group.steps for group in self.groups])
        self.audience.report(self.timesteps, self.profiler.live(), None)
        self._say_lesson()

    @property
    def progress(self) -> float:
        """The fraction of the run that is done."""
        return self.timesteps / self.config.total_timesteps

    def count(self) -> None:
        """Count a decision of every lane of the first policy, but not of lanes that opponents hold."""
        policy = self.policies[0]
        held = [group.played[policy.actor.behavior].sum() for group in self.groups if group.played is not None]
        decisions = int(sum(held)) if held else policy.lanes
        self.timesteps += decisions
        self.profiler.timesteps += decisions
        self.curriculum.watch()

    def renew_opponents(self) -> None:
        """After an update: draw opponents again, among them the policies as they are now, if it is time."""
        if self.league:
            actors = [policy.actor for policy in self.policies]
            self.league.renew(self.timesteps, self.policies[0].updates, actors)

    def log(self) -> None:
        """Write a row of metrics for each policy if it is time; else report live figures if it is time for them."""
        interval = self.config.log_interval
        if self.timesteps // interval == self._logged // interval:
            if self.profiler.due():
                self.audience.report(self.timesteps, self.profiler.live(), None)
            return
        before, self._logged = self._logged, self.timesteps
        times, lesson = self.profiler.summarize(), self.curriculum.row()
        lesson |= self.league.row() if self.league else {}
        held_out = self.held_out.rows([policy.actor for policy in self.policies], before, self.timesteps)
        rows = [
            logger.write(self.timesteps, lesson | policy.episodes.summarize() | more, times)
            for policy, logger, more in zip(self.policies, self.loggers, held_out, strict=True)
        ]
        self.audience.report(self.timesteps, rows[0], rows[0])
        for policy, row in zip(self.policies[1:], rows[1:], strict=True):
            self.audience.say(f"{'':>11}  {policy.actor.name}: {row_text(row)}")
        self._judge(rows[0])

    def finish(self) -> None:
        """After the last update: measure held-out settings for the last row of metrics, if that is not done yet."""
        rows = self.held_out.last_rows([policy.actor for policy in self.policies], self.timesteps)
        for policy, logger, row in zip(self.policies, self.loggers, rows, strict=False):
            logger.complete(row)
            self.audience.say(f"{'':>11}  {policy.actor.name}: {held_out_text(row)}, at the end")
        if rows:
            self._judge(rows[0])

    def _judge(self, row: Row) -> None:
        """Take the metric that marks the best checkpoint from a row of the first policy, if it has it."""
        if self._metric in row:
            self._score = self._sign * row[self._metric]

    def advise(self, policy: Policy) -> None:
        """Say what is odd about a full rollout."""
        for remark in self._advisers[self.policies.index(policy)].look():
            self.audience.say(remark)

    def keep(self, policy: Policy, statistics: Row) -> None:
        """Count the statistics of an update in the next row of metrics, and say what is odd about them."""
        index = self.policies.index(policy)
        self.loggers[index].mean.add(statistics)
        for remark in self._advisers[index].look_at_update(statistics):
            self.audience.say(remark)

    def end_lesson(self) -> None:
        """Begin the next lesson in all sessions if the present one is over."""
        if self.curriculum.advance(self.progress):
            self._say_lesson()
            for group in self.groups:
                group.session.distribute(self.curriculum.distributions)
            self._limit_hands()

    def _limit_hands(self) -> None:
        for group in self.groups:
            for hand in group.hands:
                hand.limit(self.curriculum.hand)

    def capture(self) -> RunState:
        """Return the state between two cycles, and report live figures."""
        state = capture(self.timesteps, self.policies, self.loggers, self.groups, self.curriculum, self.league)
        self.audience.report(self.timesteps, self.profiler.live(), None)
        score, self._score = self._score, None
        return replace(state, score=score, slow=self._look_at_waits())

    def _look_at_waits(self) -> Slow | None:
        """Name a slow simulator, once; return it if another one should play its arenas from here on."""
        slow = None if self.config.games else self._waits.look()  # games differ in what they take
        if slow is None:
            return None
        if slow.address != self._slow:
            self._slow = slow.address
            self.audience.say(slow.text)
        return slow if slow.far and slow.share >= LEFT_SHARE and self.timesteps < self.config.end else None

    def _say_lesson(self) -> None:
        if heading := self.curriculum.heading():
            self.audience.say(heading)


@contextmanager
def open_training(
    config: Config, run: Path, addresses: Sequence[str], state: RunState, audience: Audience, *, record_faults: bool
) -> Iterator[Training]:
    """Open sessions that continue a run from a state; they are closed on leaving. See `train` for errors."""
    spec = fitting_spec(addresses[0], config)
    lineup = make_lineup(addresses[0], config) if config.games else None
    kinds = kinds_of(arenas_by_game(config)) if lineup else None
    remarks = [*(lineup.lines() if lineup else ()), *intervals_too_short(config), *too_few_updates(config)]
    for line in () if state.timesteps else remarks:
        audience.say(line)
    balanced_options(config, spec)  # here and below: an error where it is needed would come too late
    try:
        policies = [
            Policy(
                actor,
                spec.behaviors[actor.behavior],
                group_bounds(config),
                drawn_parameters(config, spec),
                lineup,
                kinds,
            )
            for actor in make_actors(config, spec, config.accelerator)
        ]
    except MemoryError as error:
        raise ConfigError(f"a rollout does not fit into memory: {error}; choose fewer policy.rollout_steps") from error
    rollout_stretches(policies)
    for remark in demonstrate(policies, config, run, spec, lineup, resumed=state.timesteps > 0):
        audience.say(remark)
    best_metric(config, policies[0])
    league = League(config, spec, group_bounds(config)) if config.opponents.shares else None
    keep_config(config, run)
    keep_spec(spec, run)
    keep_origin(run)
    curriculum = Curriculum(config, spec, policies)
    state.restore_lesson(curriculum)
    with ExitStack() as opened:
        groups = open_groups(
            config, addresses, state.session_snapshots(), curriculum.parameters, curriculum.distributions
        )
        for group in groups:
            opened.callback(group.session.close)
        if record_faults:
            opened.enter_context(recording(groups, run / FAULTS))
        loggers = [
            opened.enter_context(closing(Logger(run, policy.actor.name, state.timesteps, config)))
            for policy in policies
        ]
        held_out = HeldOut(config, spec, addresses[0])
        training = Training(config, policies, groups, loggers, curriculum, league, held_out, audience)
        training.begin(state)
        yield training


@contextmanager
def recording(groups: Sequence[Group], folder: Path) -> Iterator[None]:
    """Record the faults of all sessions in the block, and what led to an update that diverged."""
    sessions = [session for group in groups for session in single_sessions(group.session)]
    for session in sessions:
        session.record_faults(folder)
    try:
        yield
    except DivergedError as error:
        for session in sessions:
            session.write_fault(str(error))
        raise


def best_metric(config: Config, policy: Policy) -> tuple[str, int]:
    """Return the metric that marks the best checkpoint, and 1 if its highest value does, -1 if its lowest.

    It is one of the rows of `policy`. Raises ConfigError.
    """
    metric = config.best_metric.removeprefix("-")
    known = policy.episodes.columns
    if config.evaluate_during:
        known = [*known, *(f"{HELD_OUT}{name}" for name in known)]
    entropies = [f"entropy_{name}" for name in policy.actor.gaussians]
    if metric not in (*known, *training_columns(), *policy.learner.statistics, *entropies):
        raise ConfigError(f"best_metric: there is no metric {metric!r}; {policy.actor.name} has {', '.join(known)}")
    return metric, -1 if config.best_metric.startswith("-") else 1


def drawn_parameters(config: Config, spec: pb.GameSpec) -> dict[int, str]:
    """Return the parameters that are drawn at each episode, in any lesson, by their place in the spec."""
    names = {name for lesson in config.curriculum for name in lesson.parameters} | drawn(config.parameters).keys()
    return {index: one.name for index, one in enumerate(spec.parameters) if one.name in names}


def rollout_stretches(policies: Sequence[Policy]) -> tuple[int, int]:
    """Return of how many stretches a cycle consists, and the decisions of a stretch.

    All rollouts are empty again after every cycle, and a rollout gets full only at the end of a stretch. Raises
    ConfigError if the rollouts are never empty together.
    """
    lengths = [policy.config.rollout_steps for policy in policies]
    cycle = max(lengths)
    for policy, length in zip(policies, lengths, strict=True):
        if cycle % length:
            raise ConfigError(
                f"policies.{policy.actor.name}.rollout_steps is {length}, which does not divide the longest, {cycle}"
            )
    stretch = math.gcd(*lengths)
    return cycle // stretch, stretch
