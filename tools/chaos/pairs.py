"""Two trainers that start in one folder at the same moment, with different settings: one trains, one is refused."""

from pathlib import Path

from joybridge.run.checkpoint import has_checkpoint
from joybridge.run.folder import run_config
from tools.chaos.outcome import Outcome
from tools.chaos.training import DEADLINE_SECONDS, Training

RATES = ("1e-3", "1e-5")


def pairs(folder: Path, faults: int) -> Outcome:
    """Start two trainers with different settings in one folder at the same moment, so many times."""
    problems = []
    winners = []
    for number in range(faults):
        run = folder / f"run-{number}"
        both = [Training(run, f"policy.learning_rate={rate}", "stop_at=960") for rate in RATES]
        statuses = sorted(one.process.wait(DEADLINE_SECONDS) for one in both)
        said = both[0].said()
        kept = run_config(run).policy.learning_rate
        winner = both[0] if both[0].process.returncode == 0 else both[1]
        winners.append(RATES[both.index(winner)])
        right = statuses == [0, 1] and "is being trained by " in said and "Traceback" not in said
        if not right or kept != float(winners[-1]) or not has_checkpoint(run):
            problems.append(f"pair {number}: statuses {statuses}, learning rate {kept}, said {said[-300:]!r}")
    return Outcome(
        faults, problems, f"one of two was refused each time; the others' learning rates {', '.join(winners)}"
    )
