"""`joybridge compare --search`: what it proposes, prunes, refuses and repeats. Most trainings here are imitations."""

import csv
import itertools
import math
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import optuna
import pytest
from optuna.storages.journal import JournalFileBackend, JournalStorage
from optuna.trial import FrozenTrial, TrialState

from joybridge.compare import grid, launch, search_page
from joybridge.compare import trials as trainings
from joybridge.compare.job import Job, Process
from joybridge.compare.page_settings import settings_block
from joybridge.compare.pictures import draw_themes
from joybridge.compare.scores import score_run
from joybridge.compare.variants import SEARCH, VARIANTS, make_variants
from joybridge.config.config import load_config
from joybridge.config.metrics import read_rows
from joybridge.config.programs import programs_of
from joybridge.run.run_lock import locked
from tests.support.command_line import Done, joybridge
from tests.support.jobs import train_here
from tests.support.searched import SMALL, WHAT

pytestmark = [pytest.mark.nightly, pytest.mark.usefixtures("signals")]

OUT = Path("out")
NOWHERE = "127.0.0.1:1"


class Killed(BaseException):
    """The search is killed."""


@dataclass
class Imitation:
    """Trainings whose reward follows from their settings. Each poll adds rows of metrics."""

    speeds: itertools.cycle = field(default_factory=lambda: itertools.cycle([3]))  # type: ignore[type-arg]
    fails: Callable[[Job], bool] = lambda _: False
    kill_after: float = math.inf  # polls
    held_out: float = 0  # timesteps between two values of a held-out reward, which is the epochs; inf: one at the end
    begun: list[str] = field(default_factory=list)
    terminated: list[str] = field(default_factory=list)

    def __call__(self, job: Job) -> Process:
        self.begun.append(job.experiment)
        return Training(self, job, next(self.speeds))


class Training:
    """One of them."""

    def __init__(self, shared: Imitation, job: Job, speed: int) -> None:
        self.shared, self.job, self.speed, self.rows = shared, job, speed, 0
        self.status: int | None = None
        config = load_config(job.config)
        self.interval = config.log_interval
        self.length = config.end // self.interval
        self.held_out = config.policy.epochs
        away = math.log10(config.policy.learning_rate) + 2.5
        self.best = 10 - 2 * away**2 + config.policy.epochs / 5 + (config.layout == "hybrid")

    def poll(self) -> int | None:
        self.shared.kill_after -= 1
        if self.shared.kill_after < 0 and self.status is None:
            raise Killed
        if self.status is None and self.shared.fails(self.job):
            self.job.run.mkdir(parents=True, exist_ok=True)
            (self.job.run / "log.txt").write_text("error: it diverged\n")
            self.status = 1
        elif self.status is None:
            self.rows = min(self.rows + self.speed, self.length)
            rewards = (self.best * row / self.length for row in range(1, self.rows + 1))
            lines = [
                f"{self.interval * row},{row},{reward:.6g},{self.measured(self.interval * row)}"
                for row, reward in enumerate(rewards, 1)
            ]
            self.job.run.mkdir(parents=True, exist_ok=True)
            (self.job.run / "metrics-archer.csv").write_text(
                "\n".join(["timesteps,seconds,reward,held_out_reward", *lines, ""])
            )
            self.status = 0 if self.rows == self.length else None
        return self.status

    def measured(self, timesteps: int) -> str:
        """Return the cell of the held-out reward: the epochs at the end, and less before."""
        every, end = self.shared.held_out, timesteps == self.interval * self.length
        if not every or (timesteps % every and not end):
            return ""
        return f"{self.held_out}" if end else f"{self.held_out / 2}"

    def terminate(self) -> None:
        self.status = 130
        self.shared.terminated.append(self.job.experiment)

    def wait(self) -> int:
        assert self.status is not None
        return self.status


@pytest.fixture
def run(simulator, tmp_path, monkeypatch) -> Callable[..., Done]:
    """Return what searches in a folder of its own, with imitations."""
    monkeypatch.setattr(search_page, "draw_themes", lambda *_: [])
    for module in (grid, trainings):
        monkeypatch.setattr(module, "POLL_SECONDS", 0.0)
    monkeypatch.setattr(grid, "GRACE_SECONDS", 0.0)
    monkeypatch.chdir(tmp_path)
    Path("small.yaml").write_text(SMALL)

    def searched(*more: str, begin: Callable[[Job], Process] | None = None, at: str = simulator) -> Done:
        monkeypatch.setattr(launch, "start", begin or Imitation())
        words = ["compare", "small.yaml", "--output", str(OUT), "--simulator", at]
        if "--search" not in more:
            words += ["--search", *WHAT]
        return joybridge(*words, *more)

    return searched


def study(folder: Path = OUT) -> optuna.Study:
    storage = JournalStorage(JournalFileBackend(str(folder / SEARCH)))
    return optuna.load_study(study_name="search", storage=storage)


def trials(folder: Path = OUT) -> list[FrozenTrial]:
    return study(folder).trials


def states(folder: Path = OUT) -> list[str]:
    return [trial.state.name for trial in trials(folder)]


def files(folder: Path = OUT) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in ("page.md", "trials.csv", "best.yaml")}


# ------------------------------------------------------------------------------------------------- the whole command


def test_a_search_finds_better_settings_prunes_hopeless_trials_and_says_what_to_do_next(run):
    begin = Imitation()
    done = run("--trials", "20", begin=begin)
    assert done.status == 0, done.errors
    found = trials()
    assert len(found) == 20 == len(begin.begun)
    assert found[0].params == {"layout": "hybrid", "policy.epochs": 4, "policy.learning_rate": 0.000325}
    best = study().best_trial
    assert (best.value or 0) > (found[0].value or 0) + 0.5
    pruned = [trial for trial in found if trial.state == TrialState.PRUNED]
    assert begin.terminated == [f"trial-{trial.number:03}" for trial in pruned] and len(pruned) > 3
    assert (pruned[0].last_step or 0) < 1000
    assert {trial.last_step for trial in pruned} <= {400, 600, 800, 1000, 1200, 1400, 1600, 1800}
    page = (OUT / "page.md").read_text()
    assert f"| **{best.number}** | " in page and "(own settings)" in page
    train, compare = (line.removeprefix("next: ") for line in done.errors.splitlines()[-2:])
    assert train.startswith("joybridge train small.yaml ") and train in page and compare in page
    assert "--also out/best.yaml" in compare and "--seeds 5 --output out-seeds" in compare
    assert load_config(OUT / "best.yaml").policy.epochs == best.params["policy.epochs"]
    files = ["small.yaml", str(OUT / "best.yaml")]
    block = settings_block(make_variants(files, [], []), [Path(file) for file in files])
    assert "| key | small | best |" in block and "| `policy.learning_rate` | 0.000325 | 0.00" in block
    assert "`seed`" not in block and "`total_timesteps`" not in block  # those of a comparison are the same for all
    assert "- out/best.yaml: The best of 20 trials of 2,000 timesteps with seed " in block
    assert "policy.learning\\_rate=" in block.split("\n\n## What all share")[0].splitlines()[-1]
    with (OUT / "trials.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["state"] == "pruned" for row in rows] == [trial in pruned for trial in found]


def test_where_the_game_is_stands_in_the_best_configuration_and_in_no_command(run):
    place = "joybridge.games.archer.game:Archer"
    Path("small.yaml").write_text(SMALL.replace("game: archer", f"game: {place}"))
    done = run("--trials", "2")
    assert done.status == 0, done.errors
    files = ["small.yaml", str(OUT / "best.yaml")]
    assert [programs_of(file, []) for file in files] == [{"game": place}] * 2
    commands = done.errors.splitlines()[-2:]
    assert all(command.startswith("next: joybridge ") and "game" not in command for command in commands)
    assert "Archer" not in (OUT / "page.md").read_text().partition("## Again")[2]


def test_a_search_that_is_killed_anywhere_and_repeated_ends_with_the_same_trials(run):
    assert run("--trials", "8").status == 0
    whole = files()
    OUT.rename("whole")
    for kill_after in (0, 3, 9, 14):  # in the first trial, at its rungs, in others
        with pytest.raises(Killed):
            run("--trials", "8", begin=Imitation(kill_after=kill_after))
    assert run("--trials", "8").status == 0
    assert files() == whole


def test_two_trials_are_trained_at_a_time(run):
    begin = Imitation(speeds=itertools.cycle([1, 7, 2]))
    assert run("--trials", "9", "--jobs", "2", begin=begin).status == 0
    assert len(begin.begun) == 9 == len(trials()) and all(trial.state.is_finished() for trial in trials())


def test_a_finished_search_is_repeated_without_a_simulator_and_more_trials_may_follow(run):
    assert run("--trials", "4").status == 0
    four, proposed = files(), trials()
    del four["page.md"]  # it names the simulator
    assert run("--trials", "4", at=NOWHERE).status == 0
    assert four.items() <= files().items()
    begin = Imitation()
    assert run("--trials", "6", begin=begin).status == 0
    assert begin.begun == ["trial-004", "trial-005"] and trials()[:4] == proposed


def test_an_interrupt_saves_the_trials_and_says_so(run):
    def interrupted(job: Job) -> Process:
        if job.experiment == "trial-002":
            raise KeyboardInterrupt
        return Imitation()(job)

    done = run("--trials", "4", begin=interrupted)
    assert done.status == 130
    assert "all trials are kept; repeat the same command to continue" in done.errors
    assert states() == ["COMPLETE", "COMPLETE", "RUNNING"]


def test_a_failed_trial_stops_no_other_and_is_on_the_page(run):
    done = run("--trials", "5", begin=Imitation(fails=lambda job: job.experiment == "trial-001"))
    assert done.status == 1 and "trial 1: failed: it diverged" in done.output
    assert states().count("FAIL") == 1 and len(states()) == 5
    assert "- 1: failed: it diverged" in (OUT / "page.md").read_text()


def test_a_search_whose_first_trials_all_fail_ends(run):
    begin = Imitation(fails=lambda _: True)
    done = run("--trials", "9", begin=begin)
    assert done.status == 1 and len(begin.begun) == 3
    assert "the first 3 trials have failed, so the search has ended; the last one: it diverged" in done.errors


def test_no_settings_are_trained_twice(run):
    begin = Imitation()
    done = run("--search", "policy.epochs=1..2", "layout=hybrid,bucket-3", "--trials", "9", begin=begin)
    assert done.status == 0 and len(trials()) == 9
    assert len(begin.begun) == len({tuple(trial.params.values()) for trial in trials()}) <= 4


@pytest.mark.slow
def test_trainings_are_scored_from_their_metrics_and_a_lost_journal_is_made_again_from_them(run, monkeypatch):
    monkeypatch.setattr(search_page, "draw_themes", draw_themes)
    more = ("--trials", "2", "total_timesteps=1280", "log_interval=320")
    done = run(*more, begin=train_here)
    assert done.status == 0, done.errors
    found = trials()
    assert states() == ["COMPLETE"] * 2
    with (OUT / "runs/trial-000-s0/metrics-archer.csv").open(newline="") as file:
        assert found[0].value == float(list(csv.DictReader(file))[-1]["reward"])
    html = (OUT / "page.html").read_text()
    assert len(re.findall(r'(?:src|srcset)="data:image/png;base64,', html)) == 4
    before = files()
    (OUT / SEARCH).unlink()
    monkeypatch.setattr(search_page, "draw_themes", lambda *_: [])
    assert run(*more, begin=refuse).status == 0
    assert files() == before


def refuse(job: Job) -> Process:
    raise AssertionError(f"{job.name} was started though it had ended")


# ----------------------------------------------------------------------------------------------------------- refusals


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["policy.epocs=1..4"], "--search policy.epocs=1..4: unknown key 'policy.epocs'; did you mean 'policy.ep"),
        (["policy.epochs=4..1"], "the range is empty; write the lower end first, 1..4"),
        (["policy.epochs=4..4"], "both ends are equal; write policy.epochs=4 behind the options"),
        (["policy.epochs=0..4"], "policy.epochs: got 0; Input should be greater than or equal to 1"),
        (["policy.epochs=1..10000000000000000000000"], "the range is too large, expected whole numbers up to 9,007,"),
        (["policy.epochs=1.5..4"], "policy.epochs: got 1.5; Input should be a valid integer"),
        (["policy.clip_range=0.1..1"], "policy.clip_range: got 1; Input should be less than 1"),
        (["policy.entropy_coef=0..0.1:log"], "0 has no logarithm; begin above 0, or leave out :log"),
        (["policy.learning_rate=1e-4..inf"], "VALUE,… with numbers, as in policy.learning_rate=1e-5..1e-3:log"),
        (["policy.learning_rate=a..b"], "--search got 'policy.learning_rate=a..b', expected KEY=LOW..HIGH, "),
        (["policy.learning_rate=1e-4..1e-3:lin"], "--search got 'policy.learning_rate=1e-4..1e-3:lin', expected "),
        (["layout=0..1"], "layout is no number; list its values, as in layout=VALUE,VALUE"),
        (["policy.autograd=0..1"], "policy.autograd is no number; list its values, as in policy.autograd=VALUE,VALUE"),
        (["policy.epochs"], "--search got 'policy.epochs', expected KEY=LOW..HIGH, KEY=LOW..HIGH:log or KEY=VALUE"),
        (["policy.epochs=1,1"], "which names a value twice"),
        (["policy.gamma=0.9,0.90"], "0.9 and 0.90 are the same; name each value once"),
        (["policy.epochs=1..2", "policy.epochs=3..4"], "policy.epochs is set twice; set it once, or search it"),
        (["policy.epochs=1..2", "policy.epochs=3"], "policy.epochs is set twice"),
        (["seed=1..4"], "seed is not searched, because all trials have the same seed"),
        (["options.size=1,2"], "options.size is not searched, because options change what a game pays"),
        (["total_timesteps=100..200"], "total_timesteps is not searched, because trials of other lengths"),
        (["policy.reward_weights.hit=0..2"], "rewards of other reward_weights cannot be compared; name a metric"),
        (["policy.epochs=1..2", "log_interval=5000"], "log_interval is 5,000, longer than the runs of 2,000"),
    ],
)
def test_wrong_ranges_are_refused_before_a_simulator_is_waited_for(run, words, message):
    done = run("--search", *words, at=NOWHERE)
    assert done.status == 1 and message in done.errors and "waiting" not in done.errors
    assert not OUT.exists()


def test_what_does_not_fit_the_game_is_refused_before_anything_is_trained(run):
    done = run("--search", "layout=hybrid,joint-9999", begin=refuse)
    assert done.status == 1 and "layout=joint-9999: layout: 'joint-9999' cannot express this device" in done.errors
    done = run("--metric", "acuracy", begin=refuse)
    assert done.status == 1 and "--metric got 'acuracy'; archer has reward, length, hits, accuracy" in done.errors
    done = run("--behavior", "archers", begin=refuse)
    assert done.status == 1 and "--behavior got 'archers'; archer has archer" in done.errors


def test_a_search_whose_ranges_have_changed_is_refused_by_name(run):
    assert run("--trials", "3").status == 0
    before = files(), trials()
    done = run("--search", "policy.epochs=1..6", *WHAT[::2])
    assert done.status == 1
    assert done.errors == (
        'error: out holds another search: ranges.policy.epochs was "1..5" and is now "1..6"; repeat the command as it '
        "was, or name another folder with --output\n"
    )
    assert "timesteps was 2000 and is now 1000" in run("stop_at=1000").errors
    assert "seed was 0 and is now 1" in run("seed=1").errors
    assert "policy.gamma was 0.99 and is now 0.9" in run("policy.gamma=0.9").errors
    assert 'metric was "reward" and is now "length"' in run("--metric", "length").errors
    assert (files(), trials()) == before
    assert run("--trials", "3", "--search", *reversed(WHAT), at=NOWHERE).status == 0  # their order means nothing


@pytest.mark.parametrize(
    "damage", [lambda text: text[: len(text) // 2] + "\n\n", lambda text: text.replace('"op_code":4', '"op":4')]
)
def test_a_damaged_journal_is_named_and_once_moved_away_the_same_trials_are_proposed(run, damage):
    assert run("--trials", "3").status == 0
    before = files()
    (OUT / SEARCH).write_text(damage((OUT / SEARCH).read_text()))
    done = run("--trials", "3")
    assert done.status == 1 and "error: out/search.journal is damaged (" in done.errors
    (OUT / SEARCH).unlink()
    assert run("--trials", "3").status == 0
    assert files() == before


def test_a_comparison_and_a_search_do_not_share_a_folder(run, simulator):
    assert run("--trials", "1").status == 0
    done = joybridge("compare", "small.yaml", "--layouts", "hybrid", "--output", str(OUT), "--simulator", simulator)
    assert done.status == 1 and "out holds a search; name another folder with --output" in done.errors
    (OUT / VARIANTS).write_text((OUT / VARIANTS).read_text().replace('"search": ', '"other": ', 1))
    assert "out holds a comparison; name another folder with --output" in run("--trials", "1").errors


def test_two_searches_do_not_share_a_folder(run):
    with locked(OUT):
        done = run("--trials", "1")
    assert done.status == 1 and "end that training, or name another folder with --output" in done.errors


def test_a_missing_optuna_names_the_extra(run, monkeypatch):
    for name in ("search", "trials", "search_page"):
        monkeypatch.delitem(sys.modules, f"joybridge.compare.{name}", raising=False)
    monkeypatch.setitem(sys.modules, "optuna", None)
    done = joybridge("compare", "small.yaml", "--search", "policy.epochs=1..4", "--output", "out")
    assert done.status == 1
    assert done.errors == (
        "error: --search needs the module optuna; install it with `pip install 'joybridge[search]'`\n"
    )


# --------------------------------------------------------------------------------------------------- ranges and rungs


@pytest.mark.parametrize("every", [None, 500, 5000])
def test_a_trial_has_the_score_that_a_comparison_gives_the_same_file(run, every):
    settings = [f"evaluate_during={{every: {every or 'null'}, episodes: 2}}", "policy.learning_rate=0.1"]
    begin = Imitation(held_out=every or math.inf)
    done = run("--search", "policy.epochs=1..5", "--trials", "9", "--metric", "held_out_reward", *settings, begin=begin)
    assert done.status == 0, done.errors
    complete = [trial for trial in trials() if trial.state == TrialState.COMPLETE]
    for trial in complete:
        path = OUT / f"runs/trial-{trial.number:03}-s0/metrics-archer.csv"
        assert trial.value == trial.params["policy.epochs"]
        if path.exists():  # another trial had the same settings
            assert trial.value == score_run(read_rows(path), str(path), 0, "held_out_reward").score
        assert trial.last_step == 1800
    assert ("Until there, and of pruned trials everywhere" in (OUT / "page.md").read_text()) == (every != 500)


def test_trials_are_pruned_no_earlier_than_is_wished(run):
    begin = Imitation()
    assert run("--trials", "20", "--prune-from", "0.7", begin=begin).status == 0
    assert {trial.last_step for trial in trials() if trial.state == TrialState.PRUNED} <= {1400, 1600, 1800}
    assert len(begin.terminated) > 1
    changed = run("--trials", "21", "--prune-from", "1")
    assert changed.status == 1 and "prune_from was 0.7 and is now 1" in changed.errors


def test_no_trial_is_pruned_without_need(run):
    begin = Imitation()
    assert run("--trials", "20", "--prune-from", "1", begin=begin).status == 0
    assert begin.terminated == [] and set(states()) == {"COMPLETE"}


def test_a_metric_of_the_end_prunes_by_its_training(run):
    settings = ["evaluate_during={episodes: 2}"]
    begin = Imitation(held_out=math.inf)
    assert run("--trials", "20", "--metric", "held_out_reward", *settings, begin=begin).status == 0
    assert len(begin.terminated) > 3
