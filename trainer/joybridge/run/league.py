"""Who plays beside the learner, drawn again for each match: its past policies, those of others, and scripts.

In every match one seat, drawn at random, is the learner's; each other one goes to a holder that is drawn by the shares
in the configuration. Holder 0 is the learner; others have a number for life.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from joybridge.config.arrays import select
from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.config.metrics import Row
from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.contract.tensors import Array
from joybridge.policy.actor import Actor, make_actors
from joybridge.policy.seats import Result
from joybridge.policy.table import Guest, Table
from joybridge.run.others import load_other, run_of
from joybridge.run.pool import LEAGUE, load_pooled, pooled, sampling_weights, thinned
from joybridge.v1 import bridge_pb2 as pb

LEARNER, PAST = "learner", "past"  # kinds of holders in the key `opponents.shares`; others have names of their own
LEARNERS = 0  # the number of the learner
ROSTERS = 2**59  # the second word of the key of who of the pool plays
DRAWS = 2**60  # plus the number of an arena: the second word of the key of who plays its matches
MEMORY = 100  # matches over which results are remembered: older ones fade, because the learner changes


class Opponents:
    """The opponents in one group of arenas. The learner sees lanes that others hold as lanes that wait.

    seen: the last steps as the learner sees them. played: the lanes that it held in the last decision, a bool for each,
    per behavior.
    """

    def __init__(self, league: "League", table: Table, first_arena: int) -> None:
        """Begin without players. first_arena: of the group."""
        self._league, self.table, self._first = league, table, first_arena
        self.seen: list[StepArrays] = []
        self.played: list[Array] = []

    def begin(self, steps: Sequence[StepArrays]) -> None:
        """Begin matches in all arenas with the first steps of a session."""
        for arena in range(self.table.arenas):
            self.table.seats.begin(arena, self._league.draw(self._first + arena))
        self.table.begin(steps)

    def act(self, steps: Sequence[StepArrays], acts: Sequence[ActArrays]) -> None:
        """Write what the opponents do into their lanes of `acts`."""
        self.table.act(steps, acts)

    def store(self, steps: Sequence[StepArrays]) -> None:
        """Take what followed: results of matches that are over, and new matches."""
        seats = self.table.seats
        self.played = [seats.holders(behavior) == LEARNERS for behavior in range(len(steps))]
        for result in seats.finish(steps):
            self._league.count(result)
            seats.deal(result.arena, self._league.draw(self._first + result.arena))
        self.table.sit(steps)
        self.see(steps)

    def see(self, steps: Sequence[StepArrays]) -> None:
        """Let the learner see steps in the lanes that it holds."""
        self.seen = []
        for behavior, step in enumerate(steps):
            held = self.table.seats.holders(behavior) == LEARNERS
            self.seen.append(replace(step, deciding=held if step.deciding is None else held & step.deciding))


class League:
    """All opponents of a run, and how the learner did against them."""

    def __init__(self, config: Config, spec: pb.GameSpec, bounds: Sequence[int]) -> None:
        """Load the policies of other runs. bounds: the first arena of each group and, last, their number.

        Raises CheckpointError and ConfigError.
        """
        self._config, self._keys, self._spec = config, config.opponents, spec
        if sum(behavior.agents_per_arena for behavior in spec.behaviors) < 2:
            raise ConfigError(f"opponents.shares: {spec.name} has one agent, which plays alone; leave the key out")
        tables = [Table(spec, end - first, config.seed, index) for index, (first, end) in enumerate(pairwise(bounds))]
        self.groups = [Opponents(self, table, first) for table, first in zip(tables, bounds, strict=False)]
        self._actors: dict[int, Sequence[Actor | Guest]] = {}
        self._others: dict[str, int] = {}
        self._pool: dict[int, int] = {}  # the timesteps of each past policy, by its number, oldest first
        self._results: dict[int, Array] = {}  # [2]: in how many meetings the learner was ahead, and how many there were
        self._matches = np.zeros(bounds[-1], np.int64)  # that were drawn, of each arena
        for name in self._keys.shares:
            if name not in (LEARNER, PAST):
                if (run := run_of(name)) and not run.exists():
                    raise ConfigError(
                        f"opponents.shares: {run} is not the folder of a run: there is no such folder; a league needs "
                        "those of its opponents, also to go on"
                    )
                self._others[name] = number = len(self._actors) + 1
                self._join(number, load_other(name, config.game, spec))
        self._next = len(self._actors) + 1
        self._roster: list[int] = []  # who of the pool plays in the matches that begin before it grows
        self._updates = -1  # of the learner when that was drawn

    def draw(self, arena: int) -> Array:
        """Return who holds the seats of the next match of an arena, [seats]."""
        rng = np.random.Generator(
            np.random.Philox(
                key=np.array([self._config.seed, DRAWS + arena], np.uint64), counter=[0, 0, 0, self._matches[arena]]
            )
        )
        self._matches[arena] += 1
        chances = self._chances()
        seats = self.groups[0].table.seats.count
        drawn: Array = rng.choice([*chances], seats, p=[*chances.values()])
        drawn[rng.integers(seats)] = LEARNERS
        return drawn

    def _chances(self) -> dict[int, float]:
        """Return how likely a seat goes to each holder, if it is not kept for the learner."""
        shares, chances = self._keys.shares, {LEARNERS: self._keys.shares.get(LEARNER, 0.0)}
        chances |= {number: shares[name] for name, number in self._others.items()}
        for number in self._roster:
            chances[number] = chances.get(number, 0.0) + shares[PAST] / len(self._roster)
        total = sum(chances.values())
        return {number: chance / total for number, chance in chances.items()}

    def _ahead(self, number: int) -> float:
        """Return in which share of meetings the learner was ahead of an opponent, lately; one half before the first."""
        ahead, meetings = self._results.get(number, np.zeros(2))
        return float((ahead + 0.5) / (meetings + 1))

    def count(self, result: Result) -> None:
        """Count the meetings of the learner with opponents in a match; a shared place counts one half."""
        mine = result.places[result.holders == LEARNERS][:, None]
        for number in set(result.holders.tolist()) - {LEARNERS}:
            theirs = result.places[result.holders == number]
            ahead = ((mine < theirs) + 0.5 * (mine == theirs)).mean()
            before = self._results.get(number, np.zeros(2))
            self._results[number] = before * (1 - 1 / MEMORY) + [ahead, 1.0]

    def renew(self, timesteps: int, updates: int, actors: Sequence[Actor]) -> None:
        """After an update, if it is time: take the learner's actors into the pool, and draw who of it plays now.

        timesteps, updates: after which it is as it is.
        """
        if updates == self._updates or not self._keys.shares.get(PAST):
            return
        self._updates = updates
        if updates % self._keys.pool_updates:  # a new draw after each update would soon let the whole pool play
            return
        self._grow(timesteps, actors)
        weights = sampling_weights([self._ahead(number) for number in self._pool], self._keys.sampling)
        rng = np.random.Generator(
            np.random.Philox(key=np.array([self._config.seed, ROSTERS], np.uint64), counter=[0, 0, 0, updates])
        )
        self._roster = rng.choice([*self._pool], self._keys.at_once, p=weights).tolist()

    def _grow(self, timesteps: int, actors: Sequence[Actor]) -> None:
        """Add copies of actors to the pool; if it is too large, its densest part is thinned."""
        past = make_actors(self._config, self._spec, self._config.accelerator)
        for copy, actor in zip(past, actors, strict=True):
            copy.load(actor.state())
        self._join(self._next, past)
        self._pool[self._next] = timesteps
        self._next += 1
        kept = thinned([*self._pool.values()], self._keys.pool_size)
        self._pool = {number: after for number, after in self._pool.items() if after in kept}
        needed = {*self._pool, *self._others.values()}.union(*(group.table.seats.present for group in self.groups))
        for number in self._actors.keys() - needed:
            self._leave(number)

    def _join(self, number: int, actors: Sequence[Actor | Guest]) -> None:
        self._actors[number] = actors
        for group in self.groups:
            group.table.join(number, actors)

    def _leave(self, number: int) -> None:
        """Forget an opponent that holds no seat any more, now and in the next matches."""
        del self._actors[number]
        self._results.pop(number, None)
        for group in self.groups:
            del group.table.players[number]

    def row(self) -> Row:
        """Return the column of metrics: how often the learner was ahead of an opponent, as a mean over all of them."""
        met = [self._ahead(number) for number in self._results]
        return {"ahead": float(np.mean(met))} if met else {}

    def state(self, *, seated: bool) -> dict[str, Array]:
        """Return copies of everything, for a checkpoint. seated: also what opponents remember of their matches."""
        arrays = {
            "pool": np.array([*self._pool.items()], np.int64).reshape(-1, 2),
            "roster": np.array(self._roster, np.int64),
            "results": np.array([[n, *result] for n, result in self._results.items()], float).reshape(-1, 3),
            "matches": self._matches.copy(),
            "counters": np.array([self._next, self._updates]),
        }
        for number, actors in self._actors.items():
            for actor in actors:
                arrays |= {f"policies.{number}.{actor.name}.{name}": array for name, array in actor.state().items()}
        for index, group in enumerate(self.groups if seated else ()):
            arrays |= {f"tables.{index}.{name}": array for name, array in group.table.state().items()}
        return {f"{LEAGUE}{name}": array for name, array in arrays.items()}

    def load(self, arrays: dict[str, Array], *, seated: bool) -> None:
        """Take back what `state` returned from the arrays of a checkpoint. Raises CheckpointError."""
        state = select(arrays, LEAGUE)
        self._next, self._updates = map(int, state["counters"])
        self._matches[:] = state["matches"]
        self._pool, self._roster = pooled(arrays), state["roster"].tolist()
        self._results = {int(number): np.array(result) for number, *result in state["results"].tolist()}
        for number in sorted({int(name.split(".")[1]) for name in state if name.startswith("policies.")}):
            if number not in self._actors:
                self._join(number, make_actors(self._config, self._spec, self._config.accelerator))
            load_pooled(self._actors[number], arrays, number)
            self._join(number, self._actors[number])  # an exported file plays as it was
        for index, group in enumerate(self.groups if seated else ()):
            group.table.load(select(state, f"tables.{index}."))
