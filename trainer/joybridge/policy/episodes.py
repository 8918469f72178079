"""Finished episodes of the lanes of one policy."""

from collections.abc import Mapping, Sequence

import numpy as np

from joybridge.config.metrics import Row, column_name
from joybridge.contract.codec import StepArrays
from joybridge.contract.tensors import Array


class Episodes:
    """Sums up the episodes of one policy's lanes."""

    def __init__(
        self,
        lanes: int,
        metrics: Sequence[str],
        drawn: Mapping[int, str] | None = None,
        games: tuple[Sequence[str], Array] | None = None,
    ) -> None:
        """Begin at an episode's first decision in every lane.

        metrics: the game's, by name; see `column_name`. drawn: the parameters that are drawn at each episode, by their
        place in the spec; their values are metrics as well. games: their names, if there are several, and which of them
        each lane plays, int [lanes]; the metrics of other games than its own are NaN in an episode.
        """
        self._games = games
        self._drawn = drawn or {}
        self.metrics = [*map(column_name, metrics), *(f"parameters.{name}" for name in self._drawn.values())]
        self.count = 0  # episodes that have finished since this was made
        self.interrupted = 0  # episodes that an error of the game has cut, and that are no results, since the last row
        self.reward = np.zeros(lanes)
        self.length = np.zeros(lanes, np.int64)
        self.finished = np.zeros((0, 3 + len(self.metrics)))  # lane, reward, length, metrics of each episode

    def begin(self) -> None:
        """Forget the episodes that have begun: new ones begin in every lane."""
        self.reward[:] = 0.0
        self.length[:] = 0

    def add(self, step: StepArrays, rewards: Array, lanes: slice = slice(None), played: Array | None = None) -> None:
        """Count one step of some lanes: rewards [lanes], as the policy gets them.

        played: the lanes in which it has played, a bool for each; None: all.
        """
        self.reward[lanes] += rewards
        self.length[lanes] += 1
        if len(step.ended):
            ended = step.ended + (lanes.start or 0)
            columns = [ended[:, None], self.reward[ended, None], self.length[ended, None]]
            if step.metrics is not None:
                columns.append(step.metrics)
            if self._drawn and step.parameters is not None:
                columns.append(step.parameters[:, list(self._drawn)])
            rows = np.concatenate(columns, axis=1)
            counts = np.ones(len(rows), bool) if played is None else played[step.ended]
            if step.interrupted is not None:
                self.interrupted += int((counts & step.interrupted).sum())
                counts = counts & ~step.interrupted
            rows = rows[counts]
            self.count += len(rows)
            self.finished = np.concatenate([self.finished, rows])
            self.reward[ended] = 0.0
            self.length[ended] = 0

    def has(self, shares: Array, held: Array | None = None) -> bool:
        """Return whether the lanes that are held have finished so many episodes: shares [arenas], see `equal_shares`.

        held: bool [lanes]; None: all.
        """
        lanes = np.bincount(self.finished[:, 0].astype(int), minlength=len(self.reward))
        enough = lanes >= self._of_lanes(shares)
        return bool((enough if held is None else enough[held]).all())

    def keep(self, shares: Array) -> None:
        """Keep the first episodes of each lane, lane by lane, as many as its arena's share [arenas]."""
        lanes, own = self.finished[:, 0].astype(int), self._of_lanes(shares).tolist()
        self.finished = np.concatenate([self.finished[lanes == lane][:share] for lane, share in enumerate(own)])

    def _of_lanes(self, shares: Array) -> Array:
        return np.repeat(shares, len(self.reward) // len(shares))

    @property
    def columns(self) -> list[str]:
        """Return what a row may have besides the number of episodes."""
        of_games = [f"{game}.{name}" for game in (self._games or ((),))[0] for name in ("reward", "length")]
        return ["reward", "length", *of_games, *self.metrics]

    def summarize(self) -> Row:
        """Return means over the finished episodes and forget them; no means where none has finished.

        Of several games, reward and length are means over the games' own means, once all have finished episodes.
        """
        finished, self.finished = self.finished, self.finished[:0]
        row: Row = {"episodes": len(finished)}
        if self.interrupted:
            row["interrupted"], self.interrupted = self.interrupted, 0
        if self._games is not None:
            return row | self._summarize_games(finished)
        if len(finished):
            means = finished.mean(axis=0)
            row |= {"reward": means[1], "reward_std": finished[:, 1].std(), "length": means[2]}
            row |= dict(zip(self.metrics, means[3:].tolist(), strict=True))
        return row

    def _summarize_games(self, finished: Array) -> Row:
        """Return the columns of several games."""
        assert self._games is not None
        names, kinds = self._games
        kind = kinds[finished[:, 0].astype(int)]
        row: Row = {}
        for number, name in enumerate(names):
            own = finished[kind == number]
            if len(own):
                means = dict(zip(["reward", "length", *self.metrics], own[:, 1:].mean(axis=0).tolist(), strict=True))
                row |= {f"{name}.episodes": len(own)}
                row |= {f"{name}.{one}": means[one] for one in ("reward", "length")}
                row |= {metric: mean for metric, mean in means.items() if metric.startswith(f"{name}.")}
        for one in ("reward", "length"):
            of_games = [row[f"{name}.{one}"] for name in names if f"{name}.{one}" in row]
            if len(of_games) == len(names):
                row[one] = float(np.mean(of_games))
        return row

    def state(self) -> dict[str, Array]:
        """Return everything for a checkpoint."""
        arrays = {"reward": self.reward.copy(), "length": self.length.copy(), "finished": self.finished.copy()}
        return arrays | ({"interrupted": np.array(self.interrupted)} if self.interrupted else {})

    def load(self, state: dict[str, Array]) -> None:
        """Take back what `state` returned."""
        self.reward, self.length, self.finished = (state[name].copy() for name in ("reward", "length", "finished"))
        self.interrupted = int(state.get("interrupted", 0))


def equal_shares(episodes: int, arenas: int, choices: int = 1) -> Array:
    """Return how many of some episodes each arena plays, [arenas], as equally as it goes.

    They are fixed beforehand, so short episodes count no more often than long ones. choices: parts of the arenas, side
    by side, that get equal shares, too.
    """
    in_turn = np.arange(arenas).reshape(choices, -1).T.ravel()  # the first arena of each choice, …
    shares = np.full(arenas, episodes // arenas)
    shares[in_turn[: episodes % arenas]] += 1
    return shares
