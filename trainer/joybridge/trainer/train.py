"""Training, from top to bottom: act, step, store, learn, report, save.

A run goes in cycles, after each of which every rollout is empty. At these boundaries the whole state is
captured, the simulator's included; whatever stops a run in between, it goes on from the last boundary as if
nothing had happened.
"""

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from joybridge.contract.tensors import Array
from joybridge.trainer.agent import Policy
from joybridge.trainer.build import make_policies, rollout_cycle
from joybridge.trainer.checkpoint import has_checkpoint, load_checkpoint, save_checkpoint, select
from joybridge.trainer.config import Config, ConfigError, changes, dump_config, load_config
from joybridge.trainer.evaluate import balanced_choices
from joybridge.trainer.metrics import Journal, Row, Stopwatch
from joybridge.trainer.pipeline import Group, close_groups, group_count, open_groups
from joybridge.trainer.wire.client import describe
from joybridge.trainer.wire.event_loop import uninterrupted


@dataclass
class Boundary:
    """The state of a run between two cycles: what a checkpoint holds."""

    arrays: dict[str, Array]
    manifest: dict[str, Any]


Report = Callable[[int, Row, Row | None], None]  # (timesteps, live figures, new row of the first policy or None)


def train(config: Config, run: Path, addresses: Sequence[str], *, resume: bool, report: Report) -> None:
    """Train `config` in folder `run` on the simulators at `addresses`, from the beginning or a checkpoint.

    Raises ConfigError, CheckpointError, SimulatorError, DivergedError; on these and on KeyboardInterrupt the last
    boundary has been saved.
    """
    torch.set_num_threads(1)  # two threads collapse when the other core is busy, and the simulator keeps it so
    arrays, manifest = load_checkpoint(run) if resume else ({}, {"timesteps": 0, "snapshots": None})
    spec = describe(addresses[0], config.game, config.options)
    balanced_choices(config, spec)  # which only evaluation needs, but then it would be too late
    policies = make_policies(config, spec, config.arenas, group_count(config))
    cycle = rollout_cycle(policies)
    stretch = math.gcd(
        *(policy.config.rollout_steps for policy in policies)
    )  # decisions between which nothing is learned
    write_config(config, run, resume)

    timesteps: int = manifest["timesteps"]  # of the first behavior's lanes
    lanes = policies[0].lanes
    groups = open_groups(config, addresses, unpack_snapshots(arrays, manifest["snapshots"]))
    journals = [Journal(run, policy.name, policy.lanes, policy.metrics, timesteps) for policy in policies]
    if resume:
        restore(arrays, policies, journals)
    if manifest["snapshots"] is None:
        begin_episodes(groups, policies, journals)
    boundary = capture(timesteps, policies, journals, groups)
    saved = timesteps
    watch = Stopwatch()
    try:
        while timesteps < config.end:
            for decision in range(cycle):
                if decision % stretch == 0:
                    for group in groups:
                        group.act(policies, watch)
                with watch.measure("learn"):
                    for policy in policies:
                        policy.learn_on()
                last = (decision + 1) % stretch == 0
                for group in groups:
                    group.take(policies, journals, watch)
                    if not last:
                        group.act(policies, watch)
                timesteps += lanes
                watch.timesteps += lanes
                with watch.measure("learn"):
                    for policy, journal in zip(policies, journals, strict=True):
                        if policy.full:
                            journal.means.add(policy.turn_over(timesteps / config.total_timesteps))
                if timesteps // config.log_interval > (timesteps - lanes) // config.log_interval:
                    shared = watch.summarise()
                    rows = [journal.write(timesteps, shared) for journal in journals]
                    report(timesteps, rows[0], rows[0])
            boundary = capture(timesteps, policies, journals, groups)
            if timesteps - saved >= config.checkpoint_interval:
                save_checkpoint(run, boundary.arrays, boundary.manifest)
                saved = timesteps
            report(timesteps, watch.live(), None)
    finally:
        with uninterrupted():
            save_checkpoint(run, boundary.arrays, boundary.manifest)
        for journal in journals:
            journal.writer.close()
        close_groups(groups)


def capture(
    timesteps: int, policies: Sequence[Policy], journals: Sequence[Journal], groups: Sequence[Group]
) -> Boundary:
    """Return the state of the run; without the simulators' where the game has no snapshots."""
    arrays: dict[str, Array] = {}
    for policy, journal in zip(policies, journals, strict=True):
        arrays |= {f"{policy.name}/policy/{name}": array for name, array in policy.state().items()}
        arrays |= {f"{policy.name}/episodes/{name}": array for name, array in journal.episodes.state().items()}
        arrays |= {f"{policy.name}/means/{name}": array for name, array in journal.means.state().items()}
    parts = None
    if groups[0].simulators.spec.snapshot_bytes_per_arena:
        snapshots = [snapshot for group in groups for snapshot in group.simulators.save()]
        parts = [list(snapshot) for snapshot in snapshots]
        for index, snapshot in enumerate(snapshots):
            arrays |= {f"simulator/{index}/{name}": np.frombuffer(data, np.uint8) for name, data in snapshot.items()}
    return Boundary(arrays, {"timesteps": timesteps, "snapshots": parts})


def restore(arrays: dict[str, Array], policies: Sequence[Policy], journals: Sequence[Journal]) -> None:
    """Take back what `capture` put into a checkpoint's arrays, except for the simulators'."""
    for policy, journal in zip(policies, journals, strict=True):
        policy.load(select(arrays, f"{policy.name}/policy/"))
        journal.episodes.load(select(arrays, f"{policy.name}/episodes/"))
        journal.means.load(select(arrays, f"{policy.name}/means/"))


def begin_episodes(groups: Sequence[Group], policies: Sequence[Policy], journals: Sequence[Journal]) -> None:
    """Begin with the new episodes that the simulators play, as they do unless they had snapshots."""
    for group in groups:
        group.begin(policies)
    for journal in journals:
        journal.episodes.begin()


def unpack_snapshots(arrays: dict[str, Array], parts: list[list[str]] | None) -> list[dict[str, bytes]] | None:
    """Return the sessions' snapshots from a checkpoint's arrays, or None where it has none."""
    if parts is None:
        return None
    return [
        {name: arrays[f"simulator/{index}/{name}"].tobytes() for name in names} for index, names in enumerate(parts)
    ]


def write_config(config: Config, run: Path, resume: bool) -> None:
    """Keep the whole configuration in the run's folder; a resumed run must have been configured alike.

    Only `joybridge.trainer.config.MAY_CHANGE` may differ. Raises ConfigError.
    """
    run.mkdir(parents=True, exist_ok=True)
    path = run / "config.yaml"
    if resume:
        if changed := changes(load_config(path), config):
            raise ConfigError(
                f"cannot resume {run}: {', '.join(changed)} changed "
                f"(was {json.dumps(changed)}); use another --run for a new configuration"
            )
    elif has_checkpoint(run):
        raise ConfigError(f"{run} holds a run already; go on with --resume, or name another folder with --run")
    fresh = path.with_suffix(".new")
    fresh.write_text(dump_config(config), encoding="utf-8")
    fresh.replace(path)  # so that nothing that happens leaves half of it
