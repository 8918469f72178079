"""Programs written with pygame as games: they run as they are, with exact seeds, snapshots, rewards and time."""

import hashlib
from contextlib import closing
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from joybridge.contract.codec import ActArrays
from joybridge.contract.spec import choose_options
from joybridge.simulator.catalog import load_game
from joybridge.simulator.listing import listing
from tests.support.programs import CATCH, CATCHING, HEAD, LOOP, SHOW, opened, program, steps, still
from tests.support.servers import ROOT

SPEC = r"""catch: .*
  time: a decision every 80 ms (4 ticks), episodes of at most 1,024 decisions
  option decision_interval: 4 | 1 | 2 | 8 | 12 | 16 (default 4)
  option screen: 64 | 48 | 84 | 128 (default 64)
  option colors: rgb | gray (default rgb)
  option pointer: position | velocity (default position)
  option fovea: none | 32 | 64 (default none)
  behavior player: 1 agent per arena
    sensors: screen [55, 74, 3] RGB
    axes: pointer_x -1..1 (position, to the right), pointer_y -1..1 (position, up)
    branches: mouse_left (released | pressed [Mouse0]), key_LEFT (released | pressed [ArrowLeft]), key_RIGHT (released |
        pressed [ArrowRight])
    rewards: score (weight 1)"""


@pytest.fixture(scope="module")
def catch():
    game: Any = load_game(f"pygame:{CATCH}")
    yield game
    game.processes.end()


def random_act(game, rng, arenas=1):
    device = game.describe(choose_options(game.options, {}, game.name)).behaviors[0].device
    choices = [[rng.integers(len(branch.choices)) for branch in device.branches] for _ in range(arenas)]
    axes = rng.uniform(-1, 1, (arenas, len(device.axes)))
    return [ActArrays(axes.astype(np.float32), np.array(choices, np.int32).reshape(arenas, -1))]


def played(playing, game, decisions, rng, arenas=1):
    """Return a hash of everything that some random decisions give, and the reward."""
    digest, reward = hashlib.sha256(), 0.0
    for _ in range(decisions):
        (step,) = playing.step(random_act(game, rng, arenas))
        for array in (*step.observations, step.rewards, step.terminated, step.truncated):
            digest.update(array.tobytes())
        reward += step.rewards.sum()
    digest.update(playing.draw(arenas - 1).tobytes())
    return digest.hexdigest(), reward


def test_the_spec_says_what_the_program_reads_and_shows(catch):
    spec = catch.describe(choose_options(catch.options, {}, catch.name))
    first, *rest = listing([spec]).splitlines()
    assert first.startswith("catch: ") and rest == SPEC.splitlines()[1:]
    assert spec.tick_seconds == pytest.approx(1 / 50)
    assert (spec.picture.width, spec.picture.height) == (320, 240)


def test_the_same_seed_and_decisions_give_the_same_bytes(catch):
    hashes = []
    for seed in (1, 1, 2):
        with opened(catch, 2, seed) as playing:
            hashes.append(played(playing, catch, 60, np.random.default_rng(0), 2))
    assert hashes[0] == hashes[1] != hashes[2]
    assert hashes[0][1] > 0  # something was caught, and its text was read


def test_the_frames_of_a_decision_are_those_of_decisions_of_a_frame_each(catch):
    acts = [random_act(catch, np.random.default_rng(seed)) for seed in range(5)]
    shown: dict[int, list[Any]] = {}
    for interval in (4, 1):
        shown[interval] = frames = []
        with opened(catch, seed=3, decision_interval=str(interval)) as playing:
            playing.drawn_by_tick = 0
            for act in (act for act in acts for _ in range(4 // interval)):
                playing.step(act)
                frames += [*playing.tick_pictures, playing.draw(0)]
    assert np.array_equal(shown[4], shown[1]) and len(shown[4]) == 20
    assert all((one != next_one).any() for one, next_one in pairwise(shown[4]))


def test_an_arena_is_the_same_alone_and_among_others(catch):
    act = random_act(catch, np.random.default_rng(3))
    with opened(catch, 3) as three:
        (among,) = three.step([ActArrays(*(np.repeat(part, 3, 0) for part in (act[0].axes, act[0].choices)))])
    for arena in range(3):
        options = choose_options(catch.options, {}, catch.name)
        with closing(catch(options, {}, 1, arena, 0)) as alone:
            (step,) = alone.step(act)
        assert np.array_equal(step.observations[0][0], among.observations[0][arena])


def test_a_snapshot_continues_like_the_original_over_2000_frames(catch):
    rng = np.random.default_rng(5)
    with opened(catch) as original, opened(catch) as forked, opened(catch) as repeated:
        played(original, catch, 40, rng)
        state = original.save()
        forked.restore(state)
        catch.processes.forget_branches()
        repeated.restore(state)
        results = {played(one, catch, 500, np.random.default_rng(6)) for one in (original, forked, repeated)}
    assert len(results) == 1


def test_sounds_variables_and_text_pay_each_in_its_own_channel(tmp_path):
    body = "n = 0\ntone = pygame.mixer.Sound('tone.wav')\nfont = pygame.font.Font(None, 20)\n" + LOOP
    body += "    n += 1\n    font.render(f'gold {2 * n}', True, 'white')\n    tone.play() if n % 2 else None\n"
    (tmp_path / "tone.wav").write_bytes(bytes(1000))
    game = program(
        tmp_path, HEAD + body + SHOW, r"reward=sound:tone reward=attr:n 'reward=gold (\d+)' max_decisions=50"
    )
    first, second = steps(game, 2)
    assert first.rewards.tolist() == second.rewards.tolist() == [[2.0, 4.0, 8.0]]


def test_several_channels_are_metrics_too_each_with_what_it_paid_in_the_episode(tmp_path):
    body = "n = 0\nfont = pygame.font.Font(None, 20)\n" + LOOP
    body += "    n += 1\n    for score in (n, -n): font.render(f'score {score}', True, 'white')\n"
    rewards = r"'reward=score (\d+)' 'reward=score (-\d+)' max_decisions=3"
    game = program(tmp_path, HEAD + body + SHOW, rewards)
    names = game.look.metrics
    _, second, third = steps(game, 3)
    assert names == ["score_total", "score_2_total"]
    assert second.metrics is None and third.metrics.tolist() == [[12.0, -12.0]]


def test_two_scores_that_look_alike_are_told_apart_by_their_place_in_the_frame(tmp_path):
    body = "n = 0\nfont = pygame.font.Font(None, 20)\n" + LOOP
    body += "    n += 1\n    for score in (n, 10 * n): font.render(f'{score:>4}', True, 'white')\n"
    rewards = r"""'reward=text1:^ *(\d+)$' 'reward=text2:^ *(\d+)$'"""
    game = program(tmp_path, HEAD + body + SHOW, rewards)
    assert [step.rewards.tolist() for step in steps(game, 2)] == [[[4.0, 40.0]]] * 2
    assert game.look.channels == ["reward", "reward_2"]
    unasked = program(tmp_path, HEAD + body + SHOW)
    for reward in rewards.strip("'").split("' '"):
        assert f"'{reward}' (" in unasked.description


def test_buttons_are_found_where_the_program_passes_them_on(tmp_path):
    body = "def pressed(pos, button):\n    return button == 1 or button == 3\n" + LOOP
    body += "    for e in events:\n        if e.type == pygame.MOUSEBUTTONDOWN: pressed(e.pos, e.button)\n"
    assert program(tmp_path, HEAD + body + SHOW, "snapshots=false").look.buttons == ["left", "right"]


def test_a_rendered_text_or_the_end_of_the_program_ends_the_episode(tmp_path):
    body = "n = 0\nfont = pygame.font.Font(None, 20)\n" + LOOP
    for line, settings in (
        ("    if n == 6: font.render('Game over', True, 'white')\n", "'done=Game over'"),
        ("    if n == 6: break\n", ""),
        ("    if n == 6: pygame.quit(); raise SystemExit\n", ""),
    ):
        game = program(tmp_path, HEAD + body + "    n += 1\n" + line + SHOW, settings)
        ends = [(step.terminated[0], step.truncated[0]) for step in steps(game, 3)]
        assert ends == [(False, False), (True, False), (False, False)]


def test_an_episode_is_truncated_at_its_longest(tmp_path):
    ends = [bool(step.truncated[0]) for step in steps(program(tmp_path, HEAD + LOOP + SHOW, "max_decisions=2"), 4)]
    assert ends == [False, True, False, True]


def test_a_hook_of_the_page_presses_the_key_of_a_menu_in_each_episode(tmp_path):
    page = (ROOT / "docs/pygame-programs.md").read_text()
    hook = page.partition("**A menu before the game**")[2].partition("```python\n")[2].partition("```")[0]
    (tmp_path / "menu_hook.py").write_text(hook)
    menu = "pygame.font.init()\nshown = 'menu'\n" + LOOP
    menu += "    shown = 'game' if any(e.type == pygame.KEYDOWN for e in events) else shown\n"
    menu += "    pygame.font.Font(None, 12).render(f'{shown} {int(shown == \"game\")}', True, 'red')\n"
    settings = f"hook={tmp_path}/menu_hook.py 'reward=^\\w+ (\\d+)' keys=LEFT mouse=false max_decisions=3"
    game = program(tmp_path, HEAD + menu + SHOW, settings)
    with opened(game) as playing:
        still = [ActArrays(np.zeros((1, 0), np.float32), np.zeros((1, 1), np.int32))]
        assert [playing.step(still)[0].rewards.sum() for _ in range(6)] == [1, 0, 0, 1, 0, 0]


def test_a_hook_finds_what_only_a_running_function_has(tmp_path):
    hook = tmp_path / "lives_hook.py"
    hook.write_text(
        "from joybridge.adapters.hooks import look_up\n"
        "def state(program):\n"
        "    return [look_up('main.lives') or 0, look_up('main.nobody') is None]\n"
        "def done(program):\n"
        "    return look_up('main.lives') == 18\n"
    )
    with opened(load_game(f"pygame:{CATCHING} hook={hook} keys=LEFT mouse=false")) as playing:
        still = [ActArrays(np.zeros((1, 0), np.float32), np.zeros((1, 1), np.int32))]
        steps = [playing.step(still)[0] for _ in range(400)]
    seen = {tuple(step.observations[1][0].tolist()) for step in steps}
    assert seen == {(20.0, 1.0), (19.0, 1.0)} and any(len(step.ended) for step in steps)


def test_a_hook_adds_a_sensor_rewards_an_end_and_metrics(tmp_path):
    hook = tmp_path / "hook.py"
    hook.write_text(
        "def state(program): return [program.n, 0.5]\ndef reward(program): return {'frames': 1.0}\n"
        "def done(program): return program.n >= 8\ndef metrics(program): return {'last': program.n}\n"
    )
    game = program(tmp_path, HEAD + "n = 0\n" + LOOP + "    n += 1\n" + SHOW, f"hook={hook}")
    first, second = steps(game, 2)
    assert first.observations[1].tolist() == [[5.0, 0.5]] and first.rewards.tolist() == [[4.0]]
    assert second.terminated[0] and second.metrics.tolist() == [[8.0]]


def test_pointer_buttons_and_keys_come_as_events_and_as_states(tmp_path):
    body = LOOP + (
        "    for event in events:\n"
        "        if event.type == pygame.MOUSEBUTTONDOWN: print(event.pos)\n"
        "        if event.type == pygame.KEYDOWN and event.key == pygame.K_a: text = event.unicode\n"
        "    held = pygame.key.get_pressed()[pygame.K_a], pygame.mouse.get_pressed()[0]\n"
        "    seen = [*pygame.mouse.get_pos(), *held, len(text)]\n"
    )
    hook = tmp_path / "hook.py"
    hook.write_text("def state(program): return program.seen\n")
    game = program(tmp_path, HEAD + "text, seen = '', [0] * 5\n" + body + SHOW, f"hook={hook}")
    with opened(game) as playing:
        (step,) = playing.step([ActArrays(np.array([[1, 1]], np.float32), np.array([[1, 1]], np.int32))])
    assert step.observations[1].tolist() == [[63.0, 0.0, 1.0, 1.0, 1.0]]


def test_time_is_virtual_everywhere(tmp_path):
    body = LOOP + "    seen = time.time(), pygame.time.get_ticks(), datetime.datetime.now().timestamp()\n"
    body += "    late = pygame.time.get_ticks() + 100\n    while pygame.time.get_ticks() < late: pass\n"
    hook = tmp_path / "hook.py"
    hook.write_text("def state(program): return [program.seen[1], program.seen[0] % 86400, program.seen[2] % 86400]\n")
    game = program(tmp_path, "import datetime, time\n" + HEAD + "seen = (0, 0, 0)\n" + body + SHOW, f"hook={hook}")
    first, second = (step.observations[1][0] for step in steps(game, 2))
    assert 400 <= second[0] - first[0] <= 500
    assert second[1] == second[2] == pytest.approx(second[0] / 1000, abs=1)


def test_keys_that_no_source_names_are_found_by_watching_the_program_play(tmp_path):
    body = (
        "numbers, late = [100, 107], {}\n"
        + LOOP
        + (
            "    for event in events:\n"
            "        if event.type == pygame.KEYDOWN and event.key in (pygame.K_UP, numbers[0], *late): pass\n"
            "    held = pygame.key.get_pressed()\n"
            "    moved = held[numbers[1]], any(held)\n"
        )
    )
    description = program(tmp_path, HEAD + body + SHOW).description
    assert description.endswith("Keys in its sources: UP; that it was seen to read: UP, d, k.")


def test_a_joystick_is_plugged_in_where_a_program_reads_nothing_else(tmp_path):
    body = (
        "stick, seen = pygame.joystick.Joystick(pygame.joystick.get_count() - 1), [0] * 5\n"
        "while True:\n"
        "    for event in pygame.event.get():\n"
        "        seen[3] += event.type == pygame.JOYAXISMOTION\n"
        "        seen[4] += event.type == pygame.JOYBUTTONDOWN and event.button == 3\n"
        "    seen[:3] = stick.get_axis(0), stick.get_axis(1), stick.get_button(3)\n"
    )
    (tmp_path / "hook.py").write_text("def state(program): return program.seen\n")
    game = program(tmp_path, HEAD + body + SHOW, f"hook={tmp_path / 'hook.py'}")
    with opened(game) as playing:
        act = ActArrays(np.array([[0.5, 1.0]], np.float32), np.array([[0, 0, 0, 1]], np.int32))
        (step,) = playing.step([act])
    assert step.observations[1].tolist() == [[0.5, -1.0, 1.0, 2.0, 1.0]]


def test_a_program_that_does_not_go_on_from_snapshots_as_before_is_served_without(tmp_path):
    source = "import os\n" + HEAD + LOOP + "    screen.fill(os.getpid() % 2**24)\n" + SHOW
    game = program(tmp_path, source)
    spec = game.describe(choose_options(game.options, {}, game.name))
    assert spec.snapshot_bytes_per_arena == 0 and "Without snapshots" in spec.description
    forced: Any = program(tmp_path, source, "snapshots=true")
    with opened(forced) as playing:
        playing.step(still(forced))
        state = playing.save()
        forced.processes.forget_branches()
        with pytest.raises(ValueError, match="arena 0 does not show the picture of the snapshot"):
            playing.restore(state)


def test_a_program_that_compares_keys_with_all_there_are_has_those_of_its_sources(tmp_path):
    body = (
        "names = [pygame.K_UP, *range(97, 123), *range(48, 58)]\n"
        + LOOP
        + (
            "    for event in events:\n"
            "        if event.type == pygame.KEYDOWN and any([event.key == name for name in names]): pass\n"
        )
    )
    assert list(program(tmp_path, HEAD + body + SHOW).look.keys) == ["UP"]
