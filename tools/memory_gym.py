"""RecurrentPPO of sb3-contrib on a task of Memory Gym, for as long as ours learns it, and the page about both.

python -m tools.memory_gym train mortar_mayhem_grid --seconds 900 --seed 0    into runs/memory-gym/…/recurrent_ppo-s0
python -m tools.memory_gym page                                               results/memory-gym from runs/memory-gym

memory-gym 1.0.2 asks for an older Gymnasium, and works with this one: `pip install --no-deps memory-gym==1.0.2`.
"""

import argparse
import math
import time
from collections.abc import Sequence
from pathlib import Path
from statistics import mean

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt

from joybridge.compare import RunName, add_results, read_table
from joybridge.compare.grid import run_results
from joybridge.compare.sb3 import Metrics
from joybridge.config.config import load_config
from joybridge.config.metrics import Row, numbers, read_rows
from joybridge.ppo.threads import use_one_thread

RUNS, STUDY = Path("runs/memory-gym"), Path("results/memory-gym")
THEIRS = "recurrent_ppo"
LEARNERS = {"joybridge": "ours", THEIRS: "RecurrentPPO"}  # in the names of runs, TASK/LEARNER-sSEED
TASKS = {"mortar_mayhem_grid": "Mortar Mayhem Grid", "mystery_path_grid": "Mystery Path Grid"}


TEXT = """# Memory Gym

[Memory Gym](https://arxiv.org/abs/2309.17207) (Pleines et al.) has tasks that cannot be played without memory. In
Mortar Mayhem Grid ten commands are shown, one after the other, and then have to be followed in this order; each that
is followed pays 0.1, and the first that is not ends the episode. In Mystery Path Grid an invisible path leads to a
goal, which pays 1; who leaves it begins again at its start. Both are seen as pictures of 84 × 84 pixels in color.

Ours ([gym/mortar_mayhem_grid](../../configs/gym/mortar_mayhem_grid.yaml), the same for Mystery Path) and RecurrentPPO
of sb3-contrib learned side by side, one run of each at a time, with one thread each on a machine of two cores: 15
minutes of Mortar Mayhem and 6 of Mystery Path per run. Both have the same environments, rollouts, minibatches,
epochs, learning rate, clip range, entropy coefficient and 128 units of memory. The networks are their own: ours has
`windows` and a GRU, theirs NatureCNN and an LSTM each for actor and critic.

{table}

Means over the runs, with the lowest and the highest, of the episodes in the last fifth of so many timesteps; in
brackets the timesteps. *After as many* is what all runs of the task have.

![Reward per episode over timesteps and over minutes](curves.png)

In fifteen minutes of Mortar Mayhem both come to a third of a command per episode. In Mystery Path, one run of ours
reached the goal in one episode of fifteen at its end, the others in fewer. The publications solve both tasks, with a
hundred million timesteps: PPO with Transformer-XL ends at 0.99 ± 0.00 in Mortar Mayhem Grid and 0.97 ± 0.01 in
Mystery Path Grid ([CleanRL](https://docs.cleanrl.dev/rl-algorithms/ppo-trxl/), three seeds). The curves of the paper,
of GRU and Transformer-XL, have a point every 8.2 million timesteps, so the first one after the beginning comes later
than the end of all runs here. A hundred million timesteps of ours would take more than forty hours on such a core.
Other programs ran beside the runs at times, beside both learners alike.

In a checkout, with `pip install --no-deps memory-gym==1.0.2` and sb3-contrib (memory-gym asks for older versions of
Gymnasium and pygame, and works with ours), for seeds 0, 1 and 2, both commands at once:

```sh
joybridge train gym/mortar_mayhem_grid --gym memory_gym:MortarMayhem-Grid-v0 \\
    --run runs/memory-gym/mortar_mayhem_grid/joybridge-s0                          # Ctrl-C after 15 minutes
python -m tools.memory_gym train mortar_mayhem_grid --seconds 900 --seed 0
python -m tools.memory_gym page
```
"""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(prog="python -m tools.memory_gym", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    training = commands.add_parser("train", help="train RecurrentPPO")
    training.add_argument("task", help="a configuration in configs/gym")
    training.add_argument("--seed", type=int, default=0)
    training.add_argument("--seconds", type=float, required=True)
    commands.add_parser("page", help="write the page")
    options = parser.parse_args(arguments)
    if options.command == "train":
        train(options.task, options.seed, options.seconds)
    else:
        keep()
        results = by_learner()
        draw(results)
        (STUDY / "README.md").write_text(page(results), encoding="utf-8")
        print(STUDY / "README.md")


def train(task: str, seed: int, seconds: float) -> None:
    """Train RecurrentPPO as the configuration says, in one thread, until its time is over."""
    import memory_gym  # noqa: F401  # registers the tasks
    from sb3_contrib import RecurrentPPO
    from stable_baselines3.common.env_util import make_vec_env

    class Timed(Metrics):
        """Metrics that end the training when its time is over."""

        def _on_step(self) -> bool:
            return super()._on_step() and time.monotonic() - self._begin < seconds

    use_one_thread()
    config = load_config(Path(f"configs/gym/{task}.yaml"))
    policy = config.policy
    run = RUNS / str(RunName(f"{task}/{THEIRS}", seed))
    run.mkdir(parents=True, exist_ok=True)
    model = RecurrentPPO(
        "CnnLstmPolicy",
        make_vec_env(config.game, config.arenas, seed=seed),
        n_steps=policy.rollout_steps,
        batch_size=policy.minibatch_size,
        n_epochs=policy.epochs,
        learning_rate=policy.learning_rate,
        clip_range=policy.clip_range,
        ent_coef=policy.entropy_coef,
        gamma=policy.gamma,
        gae_lambda=policy.gae_lambda,
        max_grad_norm=policy.max_grad_norm or math.inf,
        policy_kwargs={"lstm_hidden_size": policy.memory.size},
        seed=seed,
        device="cpu",
    )
    model.learn(config.total_timesteps, callback=Timed(run / "metrics-agent.csv", config.log_interval))


def keep() -> None:
    """Add the runs that are in RUNS to the table of the study."""
    for metrics in sorted(RUNS.glob("*/*/metrics-agent.csv")):
        timesteps = int(read_rows(metrics)[-1]["timesteps"])
        name = RunName.parse(metrics.parent.relative_to(RUNS).as_posix())
        interval = load_config(Path(f"configs/gym/{metrics.parents[1].name}.yaml")).log_interval
        add_results(STUDY, run_results(metrics.parent, name, timesteps, interval))


def by_learner() -> dict[str, dict[str, list[list[Row]]]]:
    """Return the rows of each run of each learner of each task in the table of the study."""
    results: dict[str, dict[str, list[list[Row]]]] = {task: {learner: [] for learner in LEARNERS} for task in TASKS}
    for name, cells in read_table(STUDY).items():
        task, _, learner = name.run.experiment.partition("/")
        results[task][learner].append(numbers(cells))
    return results


def reward(rows: Sequence[Row], until: float) -> float:
    """Return the mean reward of the episodes that ended in the last fifth of the timesteps up to some."""
    counted = [row for row in rows if 0.8 * until < row["timesteps"] <= until and row["episodes"]]
    return sum(row["reward"] * row["episodes"] for row in counted) / sum(row["episodes"] for row in counted)


def spread(values: Sequence[float], digits: int) -> str:
    """Return the mean of one value per run, and the lowest and the highest."""
    return f"{mean(values):,.{digits}f} [{min(values):,.{digits}f}, {max(values):,.{digits}f}]"


def page(results: dict[str, dict[str, list[list[Row]]]]) -> str:
    """Return the page about the runs of the study."""
    lines = ["| task | learner | runs | timesteps/s | reward after as many timesteps | reward at the end |"]
    lines.append("|---|---|---|---|---|---|")
    for task, learners in results.items():
        common = min(rows[-1]["timesteps"] for runs in learners.values() for rows in runs)
        for learner, runs in learners.items():
            cells = [
                TASKS[task],
                LEARNERS[learner],
                str(len(runs)),
                spread([rows[-1]["timesteps"] / rows[-1]["seconds"] for rows in runs], 0),
                f"{spread([reward(rows, common) for rows in runs], 3)} ({common:,.0f})",
                f"{spread([reward(rows, rows[-1]['timesteps']) for rows in runs], 3)} "
                f"({mean(rows[-1]['timesteps'] for rows in runs):,.0f})",
            ]
            lines.append(f"| {' | '.join(cells)} |")
    return TEXT.format(table="\n".join(lines))


def draw(results: dict[str, dict[str, list[list[Row]]]]) -> None:
    """Draw reward over timesteps and over minutes: a row of panels per task, a color per learner, a line per run."""
    figure, panels = plt.subplots(len(results), 2, figsize=(10, 3 * len(results)), layout="constrained", squeeze=False)
    for (task, learners), (steps, minutes) in zip(results.items(), panels, strict=True):
        for number, (learner, runs) in enumerate(learners.items()):
            for rows in runs:
                ended = [row for row in rows if row["episodes"]]
                rewards = [row["reward"] for row in ended]
                style = {"color": f"C{number}", "label": LEARNERS[learner] if rows is runs[0] else None, "alpha": 0.8}
                steps.plot([row["timesteps"] / 1e3 for row in ended], rewards, **style)
                minutes.plot([row["seconds"] / 60 for row in ended], rewards, **style)
        for panel, unit in ((steps, "thousand timesteps"), (minutes, "minutes")):
            panel.set_xlabel(unit)
            panel.grid(alpha=0.3)
            panel.spines[["top", "right"]].set_visible(False)
        steps.set_ylabel("reward per episode")
        steps.set_title(TASKS[task], loc="left", fontsize=10)
        minutes.legend(frameon=False)
    figure.savefig(STUDY / "curves.png", dpi=90)


if __name__ == "__main__":
    main()
