"""A policy begins with the network of one that plays other games: what stays, what joins and what leaves."""

import numpy as np
import pytest

from joybridge.config.config import make_config
from joybridge.layouts import make_acts
from joybridge.policy.actor import Actor, make_actors
from joybridge.policy.lineup import make_lineup
from joybridge.policy.transfer import transferred
from joybridge.ppo.fast.kernels import Noise
from joybridge.ppo.observation import Observation


def begin(actor, before):
    """Give an actor the network of the one before, or weights of chance."""
    if before:
        actor.load(transferred(before, actor))
    else:
        rng = np.random.default_rng(1)
        actor.load({n: rng.normal(size=array.shape).astype(np.float32) for n, array in actor.state().items()})


def play(actor, seen, act, axes):
    """Return what an actor does with the axes x and y, and its values."""
    lanes = len(act.choices)
    noise = Noise(np.zeros((lanes, actor.layout.space.continuous), np.float32), np.zeros((lanes, 9), np.float32))
    acted = actor.act(seen, None, noise, deterministic=True)
    actor.layout.write(acted.action.continuous, acted.action.discrete, act)
    return act.axes[:, [axes.index("x"), axes.index("y")]], acted.values


@pytest.mark.parametrize(("layout", "acts"), [("hybrid", 0), ("hybrid", 2), ("bucket-5", 0)])
def test_a_policy_plays_the_games_that_stay_as_before_when_others_join_and_leave(layout, acts, simulator):
    policy = {"frame_stack": 2, "hidden_sizes": [8], "remember_acts": acts}
    shared = {"layout": layout, "policy": policy, "tell_game": True}
    marble: dict[str, dict[str, str]] = {"marble": {}}
    more = {"birds": {"game": "shooting_birds"}, "archer": {}, "other": {"game": "orchard"}} | marble
    played: list[tuple[np.ndarray, np.ndarray]] = []
    before: Actor | None = None
    some = marble | {"archer": {}}
    for games in (some, more) if acts else (some, more, marble):  # of past acts, parts that leave were seen, too
        lineup = make_lineup(simulator, make_config(shared | {"games": games}))
        (actor,) = make_actors(make_config(shared | {"games": games}), lineup.spec)
        begin(actor, before)
        rng = np.random.default_rng(2)
        numbers = [rng.normal(size=(5, 2)).astype(np.float32) for _ in range(6)]
        frames = [actor.see(lineup.views["marble"].see(numbers[i : i + 3])).numbers for i in (0, 3)]
        (act,) = make_acts(lineup.spec, 5)
        axes = [axis.name for axis in lineup.common.device.axes]
        act.axes[:, [axes.index("x"), axes.index("y")]] = rng.uniform(-1, 1, (5, 2))
        past = actor.past.note(np.zeros((5, actor.past.size), np.float32), act, None)
        seen = Observation(np.concatenate([past, *frames], axis=1), ())
        played.append(play(actor, seen, act, axes))
        before = actor
    assert np.ptp(played[0][0]) > 0.1
    for moved, values in played[1:]:
        np.testing.assert_allclose(moved, played[0][0], rtol=1e-5)
        np.testing.assert_allclose(values, played[0][1], rtol=1e-5)


def test_a_policy_of_other_games_keeps_what_it_sees_and_is_less_sure_of_what_to_do(simulator):
    actors = []
    for game in ("marble", "archer"):
        config = make_config({"games": {game: {}}, "layout": "hybrid", "policy": {"frame_stack": 1}})
        (actor,) = make_actors(config, make_lineup(simulator, config).spec)
        actors.append(actor)
    before, now = actors
    begin(before, None)
    saved, made, other = before.state(), transferred(before, now), transferred(before, now, stays=False)
    for name in ("actor.hidden.1.weight", "critic.hidden.1.weight", "actor.hidden.0.bias"):
        np.testing.assert_array_equal(other[name], saved[name])
    for name in ("critic.head.weight", "value_bias", "mean_bias", "log_variance"):
        np.testing.assert_array_equal(other[name], now.state()[name])
    np.testing.assert_allclose(other["actor.head.weight"], made["actor.head.weight"] / 20, rtol=1e-6)
    assert np.ptp(made["actor.head.weight"]) > 1
    now.load(other)


OWN_NETWORK = """
from torch import nn

class Seen(nn.Module):
    def __init__(self, shapes):
        super().__init__()
        frames, numbers = shapes["numbers"]
        self.convolutions = nn.ModuleDict({"all": nn.Linear(frames * numbers, 4)})

    def forward(self, sensors):
        return self.convolutions["all"](sensors["numbers"].flatten(1))
"""


def test_a_network_of_ones_own_keeps_its_parts_whatever_they_are_called(simulator, tmp_path, monkeypatch):
    (tmp_path / "seen_parts.py").write_text(OWN_NETWORK)
    monkeypatch.syspath_prepend(tmp_path)
    config = make_config({"games": {"marble": {}}, "policy": {"network": "seen_parts:Seen"}})
    before, now = (make_actors(config, make_lineup(simulator, config).spec)[0] for _ in range(2))
    made = transferred(before, now)
    assert {name for name in made if "convolutions" in name} and made.keys() == before.state().keys()
    now.load(made)


@pytest.mark.parametrize("shared_encoder", [True, False])
def test_images_join_and_leave_with_their_games(shared_encoder, simulator):
    policy = {"frame_stack": 2, "hidden_sizes": [8], "image_encoder": "moments", "shared_encoder": shared_encoder}
    marble = {"marble": {"options": {"observation": "screen"}}}
    birds = {"shooting_birds": {"options": {"observation": "fovea+wide"}}}
    played: list[tuple[np.ndarray, np.ndarray]] = []
    before: Actor | None = None
    for games in (marble, birds | marble, marble):
        config = make_config({"games": games, "policy": policy, "layout": "hybrid"})
        lineup = make_lineup(simulator, config)
        (actor,) = make_actors(config, lineup.spec)
        begin(actor, before)
        device, sensors = lineup.spec.behaviors[0].device, lineup.spec.behaviors[0].sensors
        (act,) = make_acts(lineup.spec, 5)
        axes = [axis.name for axis in device.axes]
        rng = np.random.default_rng(2)
        shown = {s.name: np.zeros((2, 5, *s.shape), np.uint8) for s in sensors}
        shown["screen"] = rng.integers(0, 255, shown["screen"].shape, np.uint8)
        frames = [actor.see([shown[s.name][at] for s in sensors]) for at in range(2)]
        stacks = tuple(np.stack(pair, axis=1) for pair in zip(*(frame.images for frame in frames), strict=True))
        seen = Observation(np.concatenate([frame.numbers for frame in frames], axis=1), stacks)
        played.append(play(actor, seen, act, axes))
        before = actor
    assert np.ptp(played[0][1]) > 0.1
    for moved, values in played[1:]:
        np.testing.assert_allclose(moved, played[0][0], rtol=1e-4, atol=1e-5)
        np.testing.assert_allclose(values, played[0][1], rtol=1e-4)
