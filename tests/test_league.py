"""Opponents in training: who holds seats, what is learned from, the pool of past policies, and exact resumption."""

from contextlib import closing

import numpy as np
import pytest

from joybridge.client.client import describe
from joybridge.config.arrays import select
from joybridge.config.config import Config, OpponentsConfig, make_config
from joybridge.config.errors import CheckpointError, ConfigError
from joybridge.config.metrics import read_rows
from joybridge.config.policy_config import PolicyConfig
from joybridge.contract.codec import StepArrays
from joybridge.policy.actor import make_actors
from joybridge.policy.policy import Policy
from joybridge.policy.seats import Result, Seats
from joybridge.run.checkpoint import load_checkpoint
from joybridge.run.collect import collect, group_bounds, open_groups
from joybridge.run.league import League
from joybridge.run.others import load_other
from joybridge.run.pool import sampling_weights
from joybridge.run.profiler import Profiler
from joybridge.run.train import train
from joybridge.run.trained import find_trained, load_actors
from joybridge.v1 import bridge_pb2 as pb

SMALL = PolicyConfig(frame_stack=2, hidden_sizes=[8], rollout_steps=16, time_horizon=16, minibatch_size=64)
PAST = OpponentsConfig(shares={"past": 3, "learner": 1}, at_once=2, pool_updates=2, pool_size=3)
NOUGHTS = Config(game="noughts", arenas=6, total_timesteps=640, log_interval=128, policy=SMALL, opponents=PAST)
MATCH = NOUGHTS.model_copy(
    update={
        "game": "beastly_rivals_full",
        "parameters": {"beast_speed": 1.5, "ball_speed": 2.0},
        "options": {"players": "3", "lives": "0", "pauses": "short", "locomotion": "axes"},
        "total_timesteps": 4500,
        "log_interval": 1000,
    }
)


def trained(config, folder, simulator, *, resume=False, **changes):
    train(config.model_copy(update=changes), folder, [simulator], resume=resume)
    return load_checkpoint(folder)


def make_league(config, simulator):
    spec = describe(simulator, config.game, config.options)
    bounds, actors = group_bounds(config), make_actors(config, spec)
    policies = [Policy(actor, spec.behaviors[actor.behavior], bounds) for actor in actors]
    return spec, policies, League(config, spec, bounds)


def test_the_learner_learns_from_what_its_lanes_did_and_from_nothing_else(simulator):
    _, (policy,), league = make_league(NOUGHTS, simulator)
    groups = open_groups(NOUGHTS, [simulator], None, {}, {})
    league.renew(0, 0, [policy.actor])
    for group, opponents in zip(groups, league.groups, strict=True):
        group.opponents = opponents
        opponents.begin(group.session.steps)
        opponents.see(group.session.steps)
    policy.begin([group.steps for group in groups])
    sent: list[list[np.ndarray]] = [[] for _ in groups]
    held: list[list[np.ndarray]] = [[] for _ in groups]
    deciding: list[list[np.ndarray]] = [[] for _ in groups]
    with closing(groups[0].session), closing(groups[1].session):
        for _ in collect(groups, [policy], Profiler(), steps=0):
            pass
        for _ in range(16):
            for number, group in enumerate(groups):
                moves = group.session.steps[0].deciding
                assert moves is not None
                deciding[number].append(moves)
                held[number].append(league.groups[number].table.seats.holders(0) == 0)
            list(collect(groups, [policy], Profiler(), steps=1))
            for number, group in enumerate(groups):
                sent[number].append(group.acts[0].choices[:, 0].copy())
                assert group.played is not None and (group.played[0] == held[number][-1]).all()
    mine, moved = (np.concatenate([np.stack(rows) for rows in part], axis=1) for part in (held, deciding))
    played = np.concatenate([np.stack(rows) for rows in sent], axis=1)
    decided = policy.rollout.decided()
    assert not decided[~mine].any() and not decided[~moved].any()
    assert decided.sum() >= (mine & moved).sum() - 6  # but for decisions whose outcome is not known yet
    assert (policy.rollout.discrete[..., 0][decided] == played[decided]).all()
    seats = mine.reshape(16, 6, 2)
    assert seats.any(axis=2).all() and 0.5 < seats.mean() < 0.75  # one is the learner's, of others a quarter
    lanes = {lane for lane, *_ in policy.episodes.finished.astype(int).tolist()}
    assert lanes and policy.episodes.count < 16 * 12 / 5  # not both agents of every match


def test_timesteps_are_those_of_the_learner(simulator, tmp_path):
    _, manifest = trained(NOUGHTS, tmp_path / "run", simulator)
    steps = [row["timesteps"] for row in read_rows(tmp_path / "run" / "metrics-player.csv")]
    assert 640 <= manifest.timesteps < 640 + 16 * 12 and steps == sorted(steps)
    assert manifest.timesteps % 12 or manifest.timesteps // 12 % 16  # it is not the number of all lanes
    assert all(0 < row["ahead"] < 1 for row in read_rows(tmp_path / "run" / "metrics-player.csv"))


def test_the_pool_grows_and_is_thinned_and_forgets_who_is_in_no_match(simulator):
    _, (policy,), league = make_league(NOUGHTS, simulator)
    for updates in range(13):
        league.renew(100 * updates, updates, [policy.actor])
        league.renew(100 * updates, updates, [policy.actor])  # once is enough
    state = select(league.state(seated=False), "league/")
    assert state["pool"][:, 1].tolist() == [0, 400, 1200]
    numbers = {int(name.split(".")[1]) for name in state if name.startswith("policies.")}
    assert numbers == set(state["pool"][:, 0].tolist()) and set(state["roster"].tolist()) <= numbers


def test_a_past_policy_plays_on_unchanged_while_the_learner_learns(simulator):
    _, (policy,), league = make_league(NOUGHTS, simulator)
    league.renew(0, 0, [policy.actor])
    before = policy.actor.state()
    policy.actor.load({name: array + 1 for name, array in before.items()})
    state = select(league.state(seated=False), "league/")
    assert all((state[f"policies.1.player.{name}"] == array).all() for name, array in before.items())


@pytest.mark.parametrize(
    ("sampling", "weights"),
    [
        ("uniform", [1 / 3, 1 / 3, 1 / 3]),
        ("latest", [0, 0, 1]),
        ("pfsp_hard", [0.64 / 0.9, 0.25 / 0.9, 0.01 / 0.9]),
        ("pfsp_even", [0.16 / 0.5, 0.25 / 0.5, 0.09 / 0.5]),
    ],
)
def test_past_policies_are_drawn_by_their_results(sampling, weights):
    assert sampling_weights([0.2, 0.5, 0.9], sampling) == pytest.approx(weights)


def test_results_count_every_meeting_of_the_learner_and_fade(simulator):
    _, (policy,), league = make_league(MATCH, simulator)
    league.renew(0, 0, [policy.actor])
    assert league.row() == {}
    league.count(Result(0, np.array([0, 1, 0]), np.array([3.0, 1.5, 1.5])))
    assert league.row()["ahead"] == (0.75 + 0.5) / 2
    for _ in range(2000):
        league.count(Result(0, np.array([0, 1, 2]), np.array([1.0, 3.0, 2.0])))
    assert league.row()["ahead"] < 0.01


REMEMBERS = {
    "policy": {**SMALL.model_dump(), "remember_acts": 2, "memory": {"kind": "gru", "size": 4}},
    "total_timesteps": 900,
}
SCRIPTED = {"opponents": {**PAST.model_dump(), "shares": {"past": 1, "script:patient": 1, "script:flee": 1}}}


@pytest.mark.slow
@pytest.mark.parametrize("changes", [{}, {"layout": "multiagent", "total_timesteps": 2400}, REMEMBERS, SCRIPTED])
def test_a_league_resumes_to_the_same_bits(changes, simulator, tmp_path):
    config = make_config({**MATCH.model_dump(), **changes})
    whole, _ = trained(config, tmp_path / "whole", simulator)
    assert len(whole["league/pool"]) == 3 and whole["league/matches"].max() > 1
    assert len({*whole["league/tables.0.seats.holders"].ravel().tolist()}) > 2
    for stop in (1, config.total_timesteps // 2):
        trained(config, tmp_path / "parts", simulator, resume=stop > 1, stop_at=stop)
    parts, _ = trained(config, tmp_path / "parts", simulator, resume=True)
    assert parts.keys() == whole.keys()
    assert [name for name in whole if not np.array_equal(parts[name], whole[name])] == []


def test_a_league_of_two_behaviors_in_a_game_without_snapshots_goes_on(simulator, tmp_path):
    ferry = NOUGHTS.model_copy(update={"game": "ferry", "total_timesteps": 1200})
    trained(ferry, tmp_path / "run", simulator, stop_at=600)
    arrays, manifest = trained(ferry, tmp_path / "run", simulator, resume=True)
    assert manifest.snapshots is None and manifest.timesteps >= 1200 and len(arrays["league/pool"]) == 3
    for name in ("helmsman", "lookout"):
        episodes = [row["episodes"] for row in read_rows(tmp_path / "run" / f"metrics-{name}.csv")]
        assert sum(episodes) > 0


def test_a_policy_of_another_run_with_another_layout_and_other_sensors_plays(simulator, tmp_path):
    other = MATCH.model_copy(update={"layout": "bucket-3", "opponents": OpponentsConfig(), "total_timesteps": 300})
    trained(other, tmp_path / "other", simulator)
    config = MATCH.model_copy(
        update={"opponents": OpponentsConfig(shares={str(tmp_path / "other"): 1}), "total_timesteps": 1500}
    )
    arrays, _ = trained(config, tmp_path / "run", simulator)
    assert set(arrays["league/tables.0.seats.holders"].ravel().tolist()) == {0, 1}
    assert len(arrays["league/pool"]) == 0 and arrays["league/results"][0, 2] > 0


def test_a_script_plays_its_seats_and_the_learner_learns_from_the_others(simulator, tmp_path):
    opponents = OpponentsConfig(shares={"script:perfect": 1})
    arrays, _ = trained(NOUGHTS, tmp_path / "run", simulator, opponents=opponents)
    seats = arrays["league/tables.0.seats.holders"] if "league/tables.0.seats.holders" in arrays else np.zeros(0)
    assert set(seats.ravel().tolist()) <= {0, 1} and not any(
        "policies." in name for name in arrays if "league/" in name
    )
    rows = read_rows(tmp_path / "run" / "metrics-player.csv")
    assert all(row["ahead"] <= 0.5 and row["reward"] <= 0 for row in rows)  # nobody beats it


def test_past_policies_of_a_run_are_rated_beside_its_checkpoints(simulator, tmp_path):
    arrays, manifest = trained(NOUGHTS, tmp_path / "run", simulator)
    players = find_trained(tmp_path / "run", 9)
    assert [one.timesteps for one in players] == sorted({*arrays["league/pool"][:, 1].tolist(), manifest.timesteps})
    number = int(arrays["league/pool"][1, 0])
    spec = describe(simulator, "noughts", {})
    (actor,), (named,) = (
        load_actors(players[1], NOUGHTS, spec),
        load_other(f"{tmp_path}/run@{players[1].timesteps}", "noughts", spec),
    )
    state = actor.state()
    assert state and all((arrays[f"league/policies.{number}.player.{name}"] == state[name]).all() for name in state)
    assert all((named.state()[name] == state[name]).all() for name in state)
    with pytest.raises(CheckpointError, match=r"run has no policy of 7 timesteps, only of [0-9, ]+; name one of them"):
        load_other(f"{tmp_path}/run@7", "noughts", spec)


def test_what_cannot_be_an_opponent_is_refused_by_name(simulator, tmp_path):
    def refused(error=ConfigError, **changes):
        with pytest.raises(error) as caught:
            trained(make_config({**NOUGHTS.model_dump(), **changes}), tmp_path / "run", simulator)
        assert not (tmp_path / "run").exists()
        return str(caught.value)

    assert "opponents.shares: archer has one agent, which plays alone" in refused(game="archer")
    wanted = "opponents.shares: gone is not the folder of a run: there is no such folder; a league needs those"
    assert wanted in refused(opponents={"shares": {"gone": 1}})
    assert "script:fool: noughts has no such script for player, which has perfect, careless, random" in refused(
        opponents={"shares": {"script:fool": 1}}
    )
    assert "opponents.shares.past: got -1" in refused(opponents={"shares": {"past": -1}})
    assert "opponents.shares: got {'past': 0}; expected a share above 0" in refused(opponents={"shares": {"past": 0}})
    ferry = NOUGHTS.model_copy(update={"game": "ferry", "total_timesteps": 96, "opponents": OpponentsConfig()})
    trained(ferry, tmp_path / "ferry", simulator)
    wanted = f"opponents: {tmp_path / 'ferry'} plays ferry, expected noughts"
    assert wanted in refused(opponents={"shares": {str(tmp_path / "ferry"): 1}})
    for file in (tmp_path / "ferry" / "checkpoints").glob("*/SHA256SUMS"):
        file.write_text("")
    (tmp_path / "ferry" / "config.yaml").write_text("game: noughts")
    assert "damaged" in refused(CheckpointError, opponents={"shares": {str(tmp_path / "ferry"): 1}})


def test_who_held_a_seat_when_its_episode_ended_has_its_result():
    one = pb.Behavior(name="p", agents_per_arena=2, channels=[pb.RewardChannel(name="r", default_weight=1)])
    seats, found = Seats(pb.GameSpec(behaviors=[one]), 1), []
    seats.begin(0, [0, 1])
    seats.deal(0, [2, 3])
    for rewards, ends in (([5, 0], [True, False]), ([0, 1], [False, True])):
        lanes = np.array(ends)
        step = StepArrays([], np.array(rewards, np.float32)[:, None], lanes, np.zeros(2, bool))
        step.ended = np.flatnonzero(lanes).astype(np.int32)
        found += seats.finish([step])
        seats.sit([step])
    (result,) = found
    assert (result.holders.tolist(), result.scores.tolist()) == ([0, 1], [5, 1])
    assert seats.holders(0).tolist() == [2, 3] and {*seats.state()} >= {"earners", "holders"}
