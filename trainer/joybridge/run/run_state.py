"""The state of a run between two rollouts: what a checkpoint holds, and what a resumed run continues from."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from joybridge.client.sharded_session import Snapshot
from joybridge.config.arrays import select
from joybridge.config.errors import CheckpointError
from joybridge.config.games import GameConfig
from joybridge.contract.tensors import Array
from joybridge.policy.actor import Actor, policy_state, trained_actors
from joybridge.policy.policy import Policy
from joybridge.policy.transfer import transferred
from joybridge.run.checkpoint import Manifest, load_checkpoint, save_checkpoint
from joybridge.run.collect import Group
from joybridge.run.curriculum import Curriculum
from joybridge.run.folder import run_config, run_spec
from joybridge.run.league import League
from joybridge.run.logger import Logger
from joybridge.run.origin import own_origin
from joybridge.run.waits import Slow

NETWORK_KEYS = (
    "activation",
    "scale_observations",
    "image_encoder",
    "frame_differences",
    "network",
)  # keys of a policy that the shapes of its network do not show


@dataclass
class RunState:
    """Everything that fixes how a run continues."""

    timesteps: int = 0  # of the lanes of the first policy
    arrays: dict[str, Array] = field(default_factory=dict)
    snapshots: list[list[str]] | None = None  # parts of each session's snapshot; None: the game has none
    score: float | None = None  # of the row of metrics that was just written; None: there was none
    slow: Slow | None = None  # a simulator whose arenas another one should play; None: each plays its own

    def save(self, run: Path, keep: int) -> None:
        """Write a checkpoint, and keep so many. Raises StorageError."""
        save_checkpoint(run, self.arrays, self._manifest(), keep)

    def save_as_best(self, run: Path) -> None:
        """Write the best checkpoint in place of the former best. Raises StorageError."""
        save_checkpoint(run, self.arrays, self._manifest(), best=True)

    def _manifest(self) -> Manifest:
        return Manifest(timesteps=self.timesteps, snapshots=self.snapshots, score=self.score, origin=own_origin())

    def restore(
        self, policies: Sequence[Policy], loggers: Sequence[Logger], groups: Sequence[Group], league: League | None
    ) -> None:
        """Put all parts but the curriculum into this state; hands only if the sessions continue.

        Raises CheckpointError.
        """
        if not any("/policy/adam." in name for name in self.arrays):
            raise CheckpointError(
                "the checkpoint has policies and no training to go on with, as that of a clone; begin a new run with "
                "it, by --from"
            )
        try:
            for policy, logger in zip(policies, loggers, strict=True):
                policy.load(select(self.arrays, f"{policy.actor.name}/policy/"))
                logger.mean.load(select(self.arrays, f"{policy.actor.name}/means/"))
            for group in groups if self.snapshots is not None else ():
                for index, hand in enumerate(group.hands):
                    hand.load(select(self.arrays, f"hands/{group.index}/{index}/"))
            if league:
                league.load(self.arrays, seated=self.snapshots is not None)
        except (LookupError, TypeError, ValueError, RuntimeError) as error:  # arrays of other names, types or shapes
            raise CheckpointError(
                f"the checkpoint does not fit this game, layout or version ({type(error).__name__}: {error}); "
                "train a new run"
            ) from error

    def restore_lesson(self, curriculum: Curriculum) -> None:
        """Put a curriculum into this state. Raises CheckpointError."""
        if not self.arrays or not curriculum.lessons:
            return
        try:
            curriculum.load(select(self.arrays, "curriculum/"))
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise CheckpointError(
                f"the checkpoint holds no lesson of this curriculum ({type(error).__name__}: {error}); train a new run"
            ) from error
        if self.snapshots is None:
            curriculum.begin()

    def session_snapshots(self) -> list[Snapshot] | None:
        """Return the snapshots of the sessions, or None where there are none. Raises CheckpointError."""
        if self.snapshots is None:
            return None
        try:
            return [
                {name: self.arrays[f"simulator/{index}/{name}"].tobytes() for name in names}
                for index, names in enumerate(self.snapshots)
            ]
        except KeyError as error:
            raise CheckpointError(f"the checkpoint holds no array {error}, which its manifest names") from error


def load_state(run: Path, checkpoint: str = "") -> RunState:
    """Return the state in a checkpoint of a run, see `load_checkpoint`. Raises CheckpointError."""
    arrays, manifest = load_checkpoint(run, checkpoint)
    return RunState(manifest.timesteps, arrays, manifest.snapshots)


def capture(
    timesteps: int,
    policies: Sequence[Policy],
    loggers: Sequence[Logger],
    groups: Sequence[Group],
    curriculum: Curriculum,
    league: League | None,
) -> RunState:
    """Return the state of a run whose rollouts are all empty; without the simulators' if the game has no snapshots."""
    arrays = {f"curriculum/{name}": array for name, array in curriculum.state().items()}
    for policy, logger in zip(policies, loggers, strict=True):
        arrays |= {f"{policy.actor.name}/policy/{name}": array for name, array in policy.state().items()}
        arrays |= {f"{policy.actor.name}/means/{name}": array for name, array in logger.mean.state().items()}
    for group in groups:
        for index, hand in enumerate(group.hands):
            arrays |= {f"hands/{group.index}/{index}/{name}": array for name, array in hand.state().items()}
    parts = None
    if groups[0].session.spec.snapshot_bytes_per_arena:
        snapshots = [snapshot for group in groups for snapshot in group.save()]
        parts = [list(snapshot) for snapshot in snapshots]
        for index, snapshot in enumerate(snapshots):
            arrays |= {f"simulator/{index}/{name}": np.frombuffer(data, np.uint8) for name, data in snapshot.items()}
    if league:
        arrays |= league.state(seated=parts is not None)
    return RunState(timesteps, arrays, parts)


def take_weights(policies: Sequence[Policy], run: Path, games: Mapping[str, GameConfig]) -> int:
    """Give policies the networks that a run has trained; return for how many timesteps.

    games: that they play, if these are several; so has the run then, perhaps others: see `transferred`. Raises
    CheckpointError, and ConfigError if the folder holds no run.
    """
    state, trained = load_state(run), run_config(run)
    if bool(trained.games) != bool(games):
        how, what = ("`games`", "the key `game`") if trained.games else ("the key `game`", "`games`")
        raise CheckpointError(
            f"{run} was trained with {how}, and this is a run with {what}, where a policy sees and controls other "
            "things; write this one with the same key (`games` may have one name), or begin with demonstrations "
            "(--demos)"
        )
    stays = not games or any(name in trained.games for name in games)
    for policy in policies:
        network = policy_state(state.arrays, policy.actor.name)
        if not network:
            known = sorted({name.partition("/policy/")[0] for name in state.arrays if "/policy/network." in name})
            raise CheckpointError(f"{run} has no policy {policy.actor.name!r}; it has {', '.join(known)}")
        before, now = (trained.policy_config(policy.actor.name), policy.config)
        if differences := [
            f"{key} was {getattr(before, key)}, now {getattr(now, key)}"
            for key in NETWORK_KEYS
            if getattr(before, key) != getattr(now, key)
        ]:
            raise CheckpointError(f"{policy.actor.name}: the trained network does not fit: {'; '.join(differences)}")
        if trained.games:
            actors = {actor.name: actor for actor in trained_actors(trained, run_spec(run), state.arrays)}
            network = transferred(actors[policy.actor.name], policy.actor, stays=stays)
        policy.actor.load(network)
        if stays:
            policy.take_scale(select(state.arrays, f"{policy.actor.name}/policy/returns."))
    return state.timesteps


def actor_arrays(actor: Actor) -> dict[str, Array]:
    """Return the arrays of a checkpoint that hold an actor and nothing that learns; see `policy_state`."""
    return {f"{actor.name}/policy/network.{name}": array for name, array in actor.state().items()}
