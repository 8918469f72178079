"""Seats and tournaments: who plays where, which results matches have, and what `joybridge rate` makes of them."""

import json
import shutil
from collections import Counter
from functools import partial
from itertools import combinations

import numpy as np
import pytest

from joybridge.cli import main
from joybridge.client.client import describe
from joybridge.compare import rating, rating_page
from joybridge.compare.rate import check_settings_of_log
from joybridge.compare.rating import rate
from joybridge.config.config import Config
from joybridge.config.errors import ConfigError
from joybridge.config.policy_config import PolicyConfig
from joybridge.contract.codec import StepArrays
from joybridge.contract.sharding import rows_of
from joybridge.layouts import make_acts
from joybridge.play import tournament
from joybridge.play.tournament import deal, play_tournament
from joybridge.policy.actor import Actor, make_actors
from joybridge.policy.player import PolicyPlayer
from joybridge.policy.seats import Seats
from joybridge.policy.table import Table
from joybridge.run.matches import Match, locked_log, read_matches, write_matches
from joybridge.run.others import seat_others
from joybridge.run.pool import thinned
from joybridge.run.train import train
from joybridge.simulator import Game, behavior, button, channel, sensor, spec
from tests.support.command_line import joybridge

pytestmark = pytest.mark.usefixtures("signals")

SMALL = PolicyConfig(frame_stack=2, hidden_sizes=[8], rollout_steps=16, time_horizon=16, minibatch_size=64)
NOUGHTS = Config(
    game="noughts",
    arenas=4,
    total_timesteps=512,
    log_interval=512,
    checkpoint_interval=128,
    keep_checkpoints=9,
    policy=SMALL,
)


@pytest.fixture(scope="module")
def run(simulator, tmp_path_factory):
    """Return a run with four checkpoints."""
    folder = tmp_path_factory.mktemp("tournament") / "run"
    train(NOUGHTS, folder, [simulator], resume=False)
    return folder


class Chase(Game):
    name = "chase"
    description = "Catch it."


def match_spec(*, place: bool = False):
    """Return the spec of a game of two hunters and a prey."""
    hunter, prey = (
        behavior(
            name,
            sensors=[sensor("sight", [1])],
            branches=[button("go")],
            agents=agents,
            channels=[channel("catch", 0.5), channel("trace", 0.0)],
            metrics=["speed", *(["place"] if place else [])],
        )
        for name, agents in (("hunter", 2), ("prey", 1))
    )
    return spec(Chase, [hunter, prey])


def step(rewards: list[float], ended: list[int] = [], metrics: list[list[float]] | None = None) -> StepArrays:  # noqa: B006
    """Return a step with these rewards of the lanes, in which some of their episodes ended."""
    lanes = len(rewards)
    ends = np.isin(np.arange(lanes), ended)
    both = np.stack([np.array(rewards, np.float32), np.full(lanes, 7, np.float32)], axis=1)
    return StepArrays(
        [np.zeros((lanes, 1), np.float32)],
        both,
        ends,
        np.zeros(lanes, bool),
        ended=np.array(ended, np.int32),
        metrics=None if metrics is None else np.array(metrics, np.float32),
    )


def test_the_rewards_of_a_whole_episode_decide_a_match_over_all_behaviors():
    seats = Seats(match_spec(), 2)
    assert seats.count == 3
    seats.begin(1, [4, 5, 6])
    assert seats.holders(0).tolist() == [0, 0, 4, 5] and seats.holders(1).tolist() == [0, 6]
    assert seats.finish([step([9, 9, 1, 0]), step([9, 2])]) == []
    (result,) = seats.finish([step([0, 0, 1, 4], [2, 3]), step([0, 0], [1])])
    assert (result.arena, result.holders.tolist(), result.places.tolist()) == (1, [4, 5, 6], [2.5, 1, 2.5])
    (result,) = seats.finish([step([0, 0, 1, 2], [2, 3]), step([0, 0], [1])])
    assert result.places.tolist() == [2, 1, 3]  # the rewards of the first match do not count in the second


def test_a_game_says_with_the_metric_place_who_was_first():
    seats = Seats(match_spec(place=True), 1)
    ended = [step([9, 0], [0, 1], [[5, 3], [5, 1.5]]), step([0], [0], [[5, 1.5]])]
    (result,) = seats.finish(ended)
    assert result.places.tolist() == [3, 1.5, 1.5]


def test_who_was_dealt_in_sits_down_when_the_episode_of_the_seat_ends():
    seats = Seats(match_spec(), 1)
    seats.begin(0, [1, 2, 3])
    early = [step([5, 0], [0]), step([0])]
    assert seats.finish(early) == []  # others still play
    seats.sit(early)
    assert seats.holders(0).tolist() == [1, 2] and seats.present == {1, 2, 3}
    late = [step([-9, 1], [1]), step([0], [0])]  # the first has begun another episode, which is not of this match
    quiet = [step([0, 0]), step([0])]
    assert seats.finish(quiet) == []  # nothing ends, and who has ended still has
    (result,) = seats.finish(late)
    assert result.holders.tolist() == [1, 2, 3] and result.places.tolist() == [1, 2, 3]
    seats.deal(result.arena, [7, 8, 9])
    seats.sit(late)
    assert seats.holders(0).tolist() == [1, 8] and seats.holders(1).tolist() == [9]
    assert seats.present == {1, 7, 8, 9}
    seats.sit([step([0, 0], [0]), step([0])])
    assert seats.holders(0).tolist() == [7, 8]


def test_seats_continue_from_their_state():
    seats, other = Seats(match_spec(), 1), Seats(match_spec(), 1)
    seats.begin(0, [1, 2, 3])
    seats.finish([step([5, 0], [0]), step([0])])
    other.load(seats.state())
    (result,) = other.finish([step([0, 9], [1]), step([8], [0])])
    assert result.holders.tolist() == [1, 2, 3] and result.places.tolist() == [3, 1, 2]


def test_rows_of_a_step_are_those_of_its_lanes():
    whole = step([1, 2, 3, 4], [1, 3], [[10, 1], [30, 3]])
    whole.final_observations = [np.array([[1.0], [3.0]], np.float32)]
    part = rows_of(whole, np.array([0, 3]))
    assert part.rewards[:, 0].tolist() == [1, 4] and part.ended.tolist() == [1] and part.terminated.tolist() == [0, 1]
    assert part.final_observations is not None and part.final_observations[0].tolist() == [[3]]
    assert part.metrics is not None and part.metrics.tolist() == [[30, 3]]


def test_every_player_is_dealt_in_equally_often_and_in_every_seat():
    dealt = [deal(5, 3, 7, arena, match) for arena in range(20) for match in range(50)]
    assert all(len(set(seats.tolist())) == 3 for seats in dealt)
    counts = Counter((int(player), seat) for seats in dealt for seat, player in enumerate(seats))
    assert len(counts) == 15 and min(counts.values()) > 150 and max(counts.values()) < 250  # 200 each
    pairs = Counter(tuple(sorted(pair)) for seats in dealt for pair in combinations(seats.tolist(), 2))
    assert len(pairs) == 10 and min(pairs.values()) > 250  # 300 each
    assert sorted(deal(2, 5, 7, 0, 0).tolist()) in ([0, 0, 0, 1, 1], [0, 0, 1, 1, 1])
    assert len({tuple(deal(5, 3, 2**64 - 1, arena, 0).tolist()) for arena in range(20)}) > 10


def test_settings_may_stand_between_runs_and_options(tmp_path, capsys):
    assert main(["rate", str(tmp_path / "run"), "options.level=2"]) == 1
    assert f"{tmp_path / 'run'} is not the folder of a run" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["rate", "options.level=2"])
    assert "options.level=2 is a setting; name the folder of a run before it" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("numbers", "limit", "kept"),
    [
        ([10, 20, 30], 3, [10, 20, 30]),
        ([0, 10, 11, 20, 30], 4, [0, 10, 20, 30]),
        ([0, 10, 20, 21, 40], 3, [0, 21, 40]),
        ([3, 1, 2], 1, [3]),
        ([0, 5, 9], 2, [0, 9]),
    ],
)
def test_what_is_kept_of_a_run_is_spread_evenly(numbers, limit, kept):
    assert thinned(numbers, limit) == kept


def test_each_policy_acts_once_per_decision_and_only_where_it_holds_a_seat_that_decides(simulator, monkeypatch):
    game, batches, whole = describe(simulator, "noughts", {}), [], Actor.act

    def act(self, observations, *rest, **more):
        batches.append(len(observations.numbers))
        return whole(self, observations, *rest, **more)

    monkeypatch.setattr(Actor, "act", act)
    players = {name: make_actors(NOUGHTS.model_copy(update={"seed": seed}), game) for seed, name in enumerate("abc")}
    results = play_tournament(players, NOUGHTS, address=simulator, matches=6, seed=3, say=print)
    assert len(results) == 6 and {int(holder) for result in results for holder in result.holders} == {0, 1, 2}
    assert max(batches) <= 6 and len(batches) <= 3 * 9 * 2  # an agent of each arena decides, in at most nine decisions


def test_a_player_plays_in_some_lanes_as_it_does_in_all_of_them(simulator):
    """The likeliest action in a lane depends on nothing but what the lane has seen."""
    from joybridge.client.client import Session

    config = NOUGHTS.model_copy(update={"policy": SMALL.model_copy(update={"frame_stack": 3})})
    with Session(simulator, "noughts", arenas=3, seed=5, options={}) as session:
        tables = [Table(session.spec, 3, 1) for _ in range(2)]
        for table, holders in zip(tables, ([1, 1], [1, 2]), strict=True):
            for holder in (1, 2):
                table.join(holder, make_actors(config, session.spec))
                for player in table.players[holder]:
                    assert isinstance(player, PolicyPlayer)
                    player.deterministic = True
            for arena in range(3):
                table.seats.begin(arena, holders)
            table.begin(session.steps)
        for number in range(30):
            acts = [make_acts(session.spec, 3) for _ in tables]
            for table, own in zip(tables, acts, strict=True):
                table.act(session.steps, own)
            deciding = session.steps[0].deciding
            assert (acts[0][0].choices[deciding] == acts[1][0].choices[deciding]).all()
            steps = session.step(acts[0])
            for table, swapped in zip(tables, ([1, 1], [2, 1] if number % 2 else [1, 2]), strict=True):
                for result in table.seats.finish(steps):
                    table.seats.deal(result.arena, swapped)
                table.sit(steps)


def test_a_run_is_evaluated_with_another_one_in_all_seats_but_its_own(run, simulator, tmp_path, capsys):
    def evaluated(*more):
        command = ["evaluate", str(run), "--episodes", "40", "--json", "--simulator", simulator, *more]
        assert main(command) == 0
        return json.loads(capsys.readouterr().out.splitlines()[-1])["player"]

    alone, against = evaluated(), evaluated("--others", str(run))
    assert alone["episodes"] == 80 and alone["means"]["reward"] == 0  # both agents of a match, and one wins
    assert against["episodes"] == 40 and against["means"]["reward"] != 0
    perfect = evaluated("--others", "script:perfect", "--others", "script:random")
    assert perfect["episodes"] == 40 and perfect["means"]["reward"] < 0
    video = ["record", str(run), str(tmp_path / "play.mp4"), "--seconds", "1", "--others", str(run)]
    assert main([*video, "--simulator", simulator]) == 0


def test_all_others_play_about_equally_often(simulator):
    noughts = describe(simulator, "noughts", {})
    scripts = ["script:perfect", "script:random", "script:careless"]
    table = seat_others(scripts, "noughts", noughts, 7, 0)
    assert table.seats.dealt.tolist() == [[0, 1], [0, 2], [0, 3]] * 2 + [[0, 1]]


def test_others_are_refused_where_they_cannot_play(run, simulator, tmp_path, capsys):
    archer = Config(game="archer", arenas=2, total_timesteps=32, log_interval=32, policy=SMALL)
    train(archer, tmp_path / "archer", [simulator], resume=False)
    for played, message in (
        (tmp_path / "archer", "others: archer has one agent, which plays alone; leave them out"),
        (run, f"opponents: {tmp_path / 'archer'} plays archer, expected noughts; name a run of this game"),
    ):
        assert main(["evaluate", str(played), "--others", str(tmp_path / "archer"), "--simulator", simulator]) == 1
        assert message in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["evaluate", str(run), "--others", str(run), "--inputs"])
    assert "--inputs measures all agents" in capsys.readouterr().err


def rated(simulator, *arguments, draw=False):
    """Rate runs in a small tournament. draw: also draw the pictures, which takes seconds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(rating, "rate", partial(rate, resamples=10))
        if not draw:
            patch.setattr(rating_page, "draw_themes", lambda *_: [])
        done = joybridge("rate", *map(str, arguments), "--matches", "40", "--simulator", simulator)
    assert done.status == 0, done.errors
    return done


def test_policies_of_a_run_are_rated_and_the_same_seed_gives_the_same_page(run, simulator, tmp_path):
    done = rated(simulator, run, "--output", tmp_path / "one", "--policies", 3, "--figures", "svg", draw=True)
    assert f"{tmp_path / 'one' / 'pictures' / 'payoff.svg'}" in done.output
    log = read_matches(tmp_path / "one")
    assert {player for match in log for player in match.players} == {"run@128", "run@384", "run@512"}
    assert len(log) == 40 and all(len(set(match.players)) == 2 for match in log)
    numbers = json.loads((tmp_path / "one" / "rating.json").read_text())
    assert numbers["ratings"]["run@128"] == {"value": 0, "low": 0, "high": 0} and numbers["anchor"] == "run@128"
    assert "| run@128 | 0 [0, 0] |" in done.output and "## Over training" in (tmp_path / "one" / "page.md").read_text()
    html = (tmp_path / "one" / "page.html").read_text()
    assert html.count("data:image/png") == 6  # three pictures, for light and for dark pages
    rated(simulator, run, "--output", tmp_path / "two", "--policies", 3)
    for name in ("matches.jsonl", "rating.json"):
        assert (tmp_path / "two" / name).read_bytes() == (tmp_path / "one" / name).read_bytes()


def test_another_seed_adds_matches_and_the_same_one_replaces_its_own(run, simulator, tmp_path):
    shutil.copytree(run, tmp_path / "run")
    other = tmp_path / "other" / "run"
    shutil.copytree(run, other)
    more = [other, "--policies", 1]
    for seed, players, matches in ((1, more, 40), (2, more, 80), (2, [*more, "--anchor", f"{other}@512"], 80)):
        done = rated(simulator, tmp_path / "run", *players, "--seed", seed)
        assert len(read_matches(tmp_path / "run" / "rating")) == matches
    assert f"{tmp_path / 'run'}@512" in done.output.replace("\\", "")  # folders of one name go by their paths
    assert "| 0 [0, 0] |" in next(line for line in done.output.splitlines() if "other" in line)


def test_other_players_with_the_same_seed_add_matches(run, simulator, tmp_path):
    for script, matches in (("perfect", 40), ("random", 80), ("random", 80)):
        again = rated(simulator, run, "--others", f"script:{script}", "--policies", 1, "--output", tmp_path)
        log = read_matches(tmp_path)
        assert len(log) == matches and {"script:perfect", f"script:{script}"} <= {p for m in log for p in m.players}
    assert "40 matches of these players with this seed are played again" in again.errors


def test_scripts_of_a_game_are_players_and_can_be_the_anchor(run, simulator, tmp_path):
    scripts = ["--others", "script:perfect", "--others", "script:random"]
    rated(simulator, run, *scripts, "--policies", 1, "--anchor", "script:random", "--output", tmp_path)
    log = read_matches(tmp_path)
    assert len(log) == 40 and {name for match in log for name in match.players} == {"run@512", *scripts[1::2]}
    places = [dict(zip(match.players, match.places, strict=True)) for match in log]
    assert all(one["script:perfect"] <= 1.5 for one in places if "script:perfect" in one)
    assert any(one["script:random"] == 2 for one in places if "script:random" in one)
    shared = sum(set(match.places) == {1.5} for match in log)
    assert f"in {shared} of them ({shared / 40:.1%}) the first place is shared" in (tmp_path / "page.md").read_text()
    numbers = json.loads((tmp_path / "rating.json").read_text())
    assert numbers["ratings"]["script:random"]["value"] == 0 < numbers["ratings"]["script:perfect"]["value"]


def test_another_run_is_called_by_what_it_had_learned_and_nobody_plays_under_two_names(run, simulator, tmp_path):
    other, again = tmp_path / "other", tmp_path / "again" / "other"
    for folder in (other, again):
        shutil.copytree(run, folder)
    others = [word for name in (run, f"{run}@128", other, again) for word in ("--others", name)]
    rated(simulator, run, *others, "--policies", 2, "--output", tmp_path)
    players = {name for match in read_matches(tmp_path) for name in match.players}
    assert players == {"run@128", "run@512", "other@512", str(again)}


def test_a_match_that_people_play_meanwhile_is_kept(run, simulator, tmp_path, monkeypatch):
    person = Match(players=("anna", "run@512"), places=(1, 2), seed=99)

    def play(*words, **more):
        with locked_log(tmp_path):
            write_matches(tmp_path, [*read_matches(tmp_path), person])
        return play_tournament(*words, **more)

    monkeypatch.setattr(tournament, "play_tournament", play)
    rated(simulator, run, "--output", tmp_path, "--policies", 2)
    log = read_matches(tmp_path)
    assert len(log) == 41 and log[0] == person


def test_matches_under_other_settings_are_not_rated_together(tmp_path):
    log = [Match(players=("a", "b"), places=(1, 2), settings="options.level=1")]
    check_settings_of_log(log, "options.level=1", tmp_path)
    with pytest.raises(ConfigError, match=r"played with options.level=1, and these .* with those of the training"):
        check_settings_of_log(log, "", tmp_path)


def test_what_cannot_be_rated_is_refused_by_name(run, simulator, tmp_path):
    def refused(*arguments):
        done = joybridge("rate", *map(str, arguments), "--simulator", simulator)
        assert done.status == 1
        return done.errors

    archer = Config(game="archer", arenas=2, total_timesteps=32, log_interval=32, policy=SMALL)
    train(archer, tmp_path / "archer", [simulator], resume=False)
    assert "archer has one agent, and a match needs two" in refused(tmp_path / "archer")
    assert f"{tmp_path / 'archer'} plays archer, expected noughts as {run}" in refused(run, tmp_path / "archer")
    assert "has one checkpoint, and a tournament needs two players" in refused(run, "--policies", 1)
    assert f"{tmp_path / 'none'} is not the folder of a run" in refused(run, "--others", tmp_path / "none")
    assert "--anchor got 'perfect', expected one of run@128, run@256" in refused(run, "--anchor", "perfect")
    assert "script:fool: noughts has no such script for player, which has perfect, careless, random" in refused(
        run, "--others", "script:fool"
    )
    few = ["--matches", 1, "--seed", 0, "--output", tmp_path / "few"]
    assert "run@128, whose rating would be 0, has played in none of 1 matches" in refused(run, *few)
    shutil.copytree(run, tmp_path / "moved")
    config = tmp_path / "moved" / "config.yaml"
    config.write_text(config.read_text().replace("pointer_speed: 0.1", "pointer_speed: 0.5"))
    assert "has another `pointer` than" in refused(run, tmp_path / "moved")
    shutil.copytree(run, tmp_path / "damaged")
    (tmp_path / "damaged" / "rating").mkdir()
    (tmp_path / "damaged" / "rating" / "matches.jsonl").write_text("{}\n")
    assert "matches.jsonl, line 1, is no match: players: Field required; delete it" in refused(tmp_path / "damaged")
