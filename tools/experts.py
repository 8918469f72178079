"""Scripted experts of some games: record them, clone them under several layouts, and compare the scores.

python -m tools.experts runs/experts                    # the small games under all layouts; prints a table
python -m tools.experts runs/experts --games archer --layouts hybrid bucket-11
python -m tools.experts runs/experts --games beastly_rivals_full --layouts       # demonstrations alone
"""

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from joybridge.client.client import Session
from joybridge.client.launch import simulator_process
from joybridge.config.config import load_config
from joybridge.config.config_files import find_config
from joybridge.contract.codec import ActArrays, StepArrays
from joybridge.games.archer import game as archer
from joybridge.games.marble import game as marble
from joybridge.games.noughts import game as noughts
from joybridge.layouts import make_acts
from joybridge.play.evaluate import evaluate
from joybridge.play.playing import PlaySpec
from joybridge.policy.encoder import ObservationEncoder
from joybridge.policy.episodes import Episodes
from joybridge.run.train import train

ARENAS = 20
EPISODES = 200  # that are recorded, and that a clone is measured with
SMALL = ("archer", "marble", "orchard", "noughts")
DISTURBED = ("noughts", "beastly_rivals_full")  # whose experts alone would not show how to find back
WRONG = 0.3  # how often a random action, which is not demonstrated, stands in an expert's place there
LEAD = 0.125  # how far a player walks in a decision, at full speed, in ways of a pointer
SCORES = {
    "archer": "reward",
    "marble": "reward",
    "orchard": "reward",
    "noughts": "sound",
    "beastly_rivals_full": "passes",
}
LAYOUTS = ("hybrid", "bucket-11", "threshold-0.0", "multiagent")
TRAINING = ("total_timesteps=60000", "log_interval=20000", "policy.epochs=20", "policy.hidden_sizes=[64,64]")

Expert = Callable[[StepArrays, ActArrays], None]  # writes what it does into the act of the only behavior


def archer_expert(step: StepArrays, act: ActArrays) -> None:
    """Aim where the balloon will be when an arrow that is loosed now has flown, and loose once the bow is there."""
    bow, _, balloon = step.observations
    slope, pulls = bow[:, 0] * archer.STEEPEST, np.rint(bow[:, 1] * archer.PULLS)
    drop = archer.DROP * archer.FLIGHT * (archer.FLIGHT + 1) / 2
    there = balloon[:, 0] + archer.FLIGHT * balloon[:, 1] * archer.FASTEST
    turn = np.clip((there + drop - slope) / archer.TURN, -1, 1)
    aimed = np.abs(slope + archer.TURN * turn - drop - there) < 0.02
    assert step.masks is not None
    draw = np.where(step.masks[0][:, archer.DRAW], archer.DRAW, archer.REST)
    act.axes[:, 0] = turn
    act.choices[:, 0] = np.where((pulls == archer.PULLS) & aimed & (there < 1), archer.LOOSE, draw)


def marble_expert(step: StepArrays, act: ActArrays) -> None:
    """Roll towards the ring, and brake in time."""
    _, speed, ring = step.observations
    act.axes[:] = np.clip(6.0 * ring - 18.0 * marble.FASTEST * speed, -1, 1)


def orchard_expert(step: StepArrays, act: ActArrays) -> None:
    """Walk below the lower apple, and close the lid when a wasp attacks."""
    apples, _, wasp = step.observations
    act.choices[:, 0] = 1 + np.sign(np.rint(6 * apples[:, 0]))
    act.choices[:, 1] = wasp[:, 0] > 0.5


def noughts_expert(step: StepArrays, act: ActArrays) -> None:
    """Take the first field that perfect play takes."""
    for lane in np.flatnonzero(step.decides):
        own, other = (_bits(marks[lane]) for marks in step.observations)
        free = [field for field in noughts.FIELDS if not (own | other) >> field & 1]
        act.choices[lane, 0] = max(free, key=lambda field: -noughts.outcome(other, own | 1 << field))


def match_expert(step: StepArrays, act: ActArrays) -> None:
    """Follow the rival that is nearest to the pointer, and click on it as soon as the ball is there."""
    own, pointer, rivals, *_ = step.observations
    nearest, holds = rivals[:, 0], (own[:, 8] == 1) & (own[:, 10] == 0) & (own[:, 11] == 0)
    act.axes[:] = np.clip(nearest[:, 15:17] + LEAD * nearest[:, 4:6], -1, 1)
    act.choices[:, 0] = holds & (pointer[:, 5] == 1)


def _bits(marks: np.ndarray) -> int:
    return sum(1 << int(field) for field in np.flatnonzero(marks))


EXPERTS: dict[str, Expert] = {
    "archer": archer_expert,
    "marble": marble_expert,
    "orchard": orchard_expert,
    "noughts": noughts_expert,
    "beastly_rivals_full": match_expert,
}


def record(game: str, address: str, folder: Path, seed: int = 1) -> float:
    """Record EPISODES episodes of a game's expert in a folder; return its score, of those without random moves."""
    expert, rng = EXPERTS[game], np.random.default_rng(seed)
    for wrong in (WRONG, 0.0) if game in DISTURBED else (0.0,):
        options = load_config(find_config(f"{game}/hybrid")).options
        with Session(address, game, arenas=ARENAS, seed=seed, options=options) as session:
            demonstration = session.record_demonstration(folder)
            (behavior,) = session.spec.behaviors
            encoder = ObservationEncoder(game, behavior, None, {})
            acts = make_acts(session.spec, ARENAS)
            table = Episodes(len(acts[0].choices), [metric.name for metric in behavior.metrics])
            while len(table.finished) < EPISODES:
                (step,) = session.steps
                expert(step, acts[0])
                random = rng.random(len(acts[0].choices)) < wrong
                acts[0].axes[random] = rng.uniform(-1, 1, acts[0].axes[random].shape)
                if step.masks is not None:
                    for lane in np.flatnonzero(random & (step.deciding if step.deciding is not None else True)):
                        acts[0].choices[lane, 0] = rng.choice(np.flatnonzero(step.masks[0][lane]))
                demonstration.hold([np.flatnonzero(~random).tolist()] if wrong else None)
                (after,) = session.step(acts)
                table.add(after, encoder.rewards(after))
    return float(table.summarize()[SCORES[game]])


def clone(game: str, layout: str, address: str, folder: Path, run: Path, seed: int = 0) -> float:
    """Clone the demonstrations in a folder under a layout; return the score of the clone, which takes no chances."""
    overrides = [*TRAINING, f"layout={layout}", f"demonstrations={folder}", f"seed={seed}"]
    config = load_config(find_config(f"{game}/hybrid"), overrides)
    train(config, run, [address], resume=False)
    results = evaluate(PlaySpec(run, address, seed=2, deterministic=True), episodes=EPISODES, say=lambda text: None)
    return next(iter(results.values())).means[SCORES[game]]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a row per game: the score of its expert, and those of its clones as shares of it."""
    parser = argparse.ArgumentParser(prog="python -m tools.experts")
    parser.add_argument("folder", type=Path, help="for demonstrations and runs")
    parser.add_argument("--games", nargs="+", choices=EXPERTS, default=SMALL)
    parser.add_argument("--layouts", nargs="*", default=LAYOUTS, help="of clones; none: demonstrations alone")
    options = parser.parse_args(arguments)
    print("| game | expert |", " | ".join(options.layouts), "|", flush=True)
    with simulator_process() as address:
        for game in options.games:
            demos = options.folder / game / "demos"
            best = record(game, address, demos)
            scores = [clone(game, layout, address, demos, options.folder / game / layout) for layout in options.layouts]
            row = " | ".join(f"{score:.3f} ({score / best:.1%})" for score in scores)
            print(f"| {game} | {best:.3f} | {row} |", flush=True)


if __name__ == "__main__":
    main()
