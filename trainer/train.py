"""Training, from top to bottom: act, step, store, learn, report, save.

A run goes in cycles, after each of which every rollout is empty. At these boundaries the whole state is
captured, the simulator's included; whatever stops a run in between, it goes on from the last boundary as if
nothing had happened.
"""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from joybridge.tensors import Array
from trainer.actions import make_acts
from trainer.build import make_policies, rollout_cycle
from trainer.checkpoint import has_checkpoint, load_checkpoint, save_checkpoint
from trainer.client import describe
from trainer.config import Config, ConfigError, dump_config, load_config
from trainer.metrics import Journal, Row, Stopwatch
from trainer.policy import Policy
from trainer.shards import Shards


@dataclass
class Boundary:
    """The state of a run between two cycles: what a checkpoint holds."""

    arrays: dict[str, Array]
    manifest: dict[str, Any]


Report = Callable[[int, Row, Row | None], None]  # (transitions, live figures, new row of the first policy or None)


def train(config: Config, run: Path, addresses: Sequence[str], *, resume: bool, report: Report) -> None:
    """Train `config` in folder `run` on the simulators at `addresses`, from the beginning or a checkpoint.

    Raises ConfigError, CheckpointError, SimulatorError; on these and on KeyboardInterrupt the last boundary
    has been saved.
    """
    torch.set_num_threads(1)  # two threads collapse when the other core is busy, and the simulator keeps it so
    arrays, manifest = load_checkpoint(run) if resume else ({}, {"transitions": 0, "snapshots": None})
    policies = make_policies(config, describe(addresses[0], config.game, config.options), config.arenas)
    cycle = rollout_cycle(policies)
    write_config(config, run, resume)

    transitions: int = manifest["transitions"]  # of the first behaviour's lanes
    lanes = policies[0].lanes
    simulators = Shards(
        addresses, config.game, arenas=config.arenas, seed=config.seed, options=[config.options] * len(addresses),
        parameters=config.parameters, snapshots=unpack_snapshots(arrays, manifest["snapshots"], len(addresses)),
    )  # fmt: skip
    journals = [Journal(run, policy.name, policy.lanes, policy.metrics, transitions) for policy in policies]
    for policy, journal in zip(policies, journals, strict=True):
        policy.begin(simulators.steps)
        if resume:
            policy.load(select(arrays, f"{policy.name}/policy/"))
            journal.episodes.load(select(arrays, f"{policy.name}/episodes/"))
            journal.means.load(select(arrays, f"{policy.name}/means/"))
    boundary = capture(transitions, policies, journals, simulators)
    saved = transitions
    acts = make_acts(simulators.spec, config.arenas)
    watch = Stopwatch()
    try:
        while transitions < config.end:
            for _ in range(cycle):
                with watch.measure("act"):
                    for policy in policies:
                        policy.act(simulators.steps, acts)
                    simulators.send(acts)
                with watch.measure("learn"):
                    for policy in policies:
                        policy.learn_on()
                with watch.measure_wait(lambda: simulators.simulate_seconds):
                    steps = simulators.receive()
                with watch.measure("act"):
                    for policy, journal in zip(policies, journals, strict=True):
                        journal.episodes.add(steps[policy.behaviour], policy.take(steps))
                transitions += lanes
                watch.transitions += lanes
                with watch.measure("learn"):
                    for policy, journal in zip(policies, journals, strict=True):
                        if policy.rollout.full:
                            journal.means.add(policy.turn_over(transitions / config.transitions))
                if transitions // config.summary > (transitions - lanes) // config.summary:
                    shared = watch.summarise()
                    rows = [journal.write(transitions, shared) for journal in journals]
                    report(transitions, rows[0], rows[0])
            boundary = capture(transitions, policies, journals, simulators)
            if transitions - saved >= config.checkpoint:
                save_checkpoint(run, boundary.arrays, boundary.manifest)
                saved = transitions
            report(transitions, watch.live(), None)
    finally:
        save_checkpoint(run, boundary.arrays, boundary.manifest)
        for journal in journals:
            journal.writer.close()
        simulators.close()


def capture(transitions: int, policies: Sequence[Policy], journals: Sequence[Journal], simulators: Shards) -> Boundary:
    """Return the state of the run; without the simulators' where the game has no snapshots."""
    arrays: dict[str, Array] = {}
    for policy, journal in zip(policies, journals, strict=True):
        arrays |= {f"{policy.name}/policy/{name}": array for name, array in policy.state().items()}
        arrays |= {f"{policy.name}/episodes/{name}": array for name, array in journal.episodes.state().items()}
        arrays |= {f"{policy.name}/means/{name}": array for name, array in journal.means.state().items()}
    parts = None
    if simulators.spec.snapshot_bytes_per_arena:
        snapshots = simulators.save()
        parts = [list(snapshot) for snapshot in snapshots]
        for index, snapshot in enumerate(snapshots):
            arrays |= {f"simulator/{index}/{name}": np.frombuffer(data, np.uint8) for name, data in snapshot.items()}
    return Boundary(arrays, {"transitions": transitions, "snapshots": parts})


def unpack_snapshots(
    arrays: dict[str, Array], parts: list[list[str]] | None, simulators: int
) -> list[dict[str, bytes]] | None:
    """Return the simulators' snapshots from a checkpoint's arrays. Raises ConfigError for another number of them."""
    if parts is None:
        return None
    if len(parts) != simulators:
        raise ConfigError(
            f"the checkpoint was made with {len(parts)} simulators; resume with as many, not {simulators}"
        )
    return [
        {name: arrays[f"simulator/{index}/{name}"].tobytes() for name in names} for index, names in enumerate(parts)
    ]


def select(arrays: dict[str, Array], prefix: str) -> dict[str, Array]:
    """Return the arrays whose names begin with `prefix`, without it."""
    return {name.removeprefix(prefix): array for name, array in arrays.items() if name.startswith(prefix)}


def write_config(config: Config, run: Path, resume: bool) -> None:
    """Keep the whole configuration in the run's folder; a resumed run must have been configured alike.

    Only `stop`, `checkpoint` and `summary` may change. Raises ConfigError.
    """
    run.mkdir(parents=True, exist_ok=True)
    path = run / "config.yaml"
    if resume:
        before, now = load_config(path).model_dump(), config.model_dump()
        changed = [key for key in now if before[key] != now[key] and key not in ("stop", "checkpoint", "summary")]
        if changed:
            raise ConfigError(
                f"cannot resume {run}: {', '.join(changed)} changed "
                f"(was {json.dumps({key: before[key] for key in changed})}); use another --run for a new configuration"
            )
    elif has_checkpoint(run):
        raise ConfigError(f"{run} holds a run already; go on with --resume, or name another folder with --run")
    path.write_text(dump_config(config), encoding="utf-8")
