"""The file with which an exported policy plays a pygame program: the program gets the same input as in the training."""

import json
import os
import shutil
import subprocess
import sys

import pytest

from tests.support.command_line import joybridge
from tests.support.servers import ROOT

EXAMPLES = ROOT / "proto/examples/python"
PROGRAM = """
import sys
import pygame

pygame.init()
screen = pygame.display.set_mode((150, 110))


def number(event):
    if event.type in (pygame.MOUSEBUTTONDOWN, pygame.MOUSEBUTTONUP):
        return event.type + 5 * event.button + event.pos[0]
    if event.type in (pygame.KEYDOWN, pygame.KEYUP):
        return event.type + 5 * event.key + sum(map(ord, event.unicode))
    if event.type == pygame.MOUSEMOTION:
        return event.rel[0] + 300 * event.rel[1] + sum(event.pos) + sum(event.buttons)
    return event.type if event.type in (pygame.TEXTINPUT, pygame.MOUSEWHEEL) else 0


def main():
    mixed, total = 0, 0
    for frame in range(60):
        x, y = pygame.mouse.get_pos()
        held = pygame.key.get_pressed()
        numbers = [number(event) for event in pygame.event.get()]
        numbers += [x + 200 * y, 7 * held[pygame.K_LEFT] + 11 * held[pygame.K_SPACE] + 13 * any(held)]
        numbers += [sum(pygame.mouse.get_rel()), sum(pygame.mouse.get_pressed())]
        for each in numbers:
            mixed = (mixed * 31 + each) % 65521 if each else mixed
        screen.fill((4 * frame, 60 * held[pygame.K_LEFT], 90 * pygame.mouse.get_pressed()[0]))
        pygame.draw.circle(screen, (250, mixed % 256, 20), (x, y), 30)
        total += mixed % 1009
        pygame.display.flip()
        first = total if frame == 0 else first
    print(total - first, [name for name in sys.modules if name.startswith("joybridge")])


main()
"""
SETTINGS = "keys=LEFT,SPACE mouse=true buttons=left,right reward=attr:main.total max_decisions=100"


@pytest.mark.parametrize(
    "options", [{}, {"colors": "gray", "fovea": "32", "pointer": "velocity", "screen": "48", "decision_interval": "2"}]
)
def test_a_program_gets_the_same_input_from_the_file_as_in_the_training(options, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "program.py").write_text(PROGRAM)
    config = {
        "game": f"pygame:program.py {SETTINGS}",
        "options": options,
        "layout": "bucket-5",
        "arenas": 2,
        "pipeline_groups": 1,
        "total_timesteps": 40,
        "log_interval": 20,
        "policy": {"frame_stack": 2, "hidden_sizes": [16], "rollout_steps": 10, "time_horizon": 10},
    }
    (tmp_path / "config.yaml").write_text(json.dumps(config))  # which is YAML, too
    for words in (
        ["train", "config.yaml", "--run", "run"],
        ["export", "run", "policy.json", "--deterministic"],
        ["evaluate", "run", "--episodes", "1", "--deterministic", "--json"],
    ):
        done = joybridge(*words)
        assert done.status == 0, done.errors
    for name in ("policy.py", "play_pygame.py"):
        shutil.copy(EXAMPLES / name, tmp_path)
    played = subprocess.run(
        [sys.executable, "play_pygame.py", "program.py", "policy.json"],
        env={**os.environ, "SDL_VIDEODRIVER": "dummy", "SDL_AUDIODRIVER": "dummy"},
        capture_output=True,
        text=True,
        timeout=600,
        check=True,
    )
    (expected,) = json.loads(done.output.splitlines()[-1])["player"]["returns"]
    assert expected and played.stdout.splitlines()[-1] == f"{expected:.0f} []"


@pytest.mark.parametrize(
    ("program", "policy", "message"),
    [
        ("none.py", "policy.json", "there is no file none.py"),
        ("program.py", "none.json", "No such file or directory: 'none.json'"),
        ("program.py", "program.py", "program.py is no 'joybridge.policy."),
    ],
)
def test_what_cannot_be_played_is_named(program, policy, message, tmp_path):
    for name in ("policy.py", "play_pygame.py"):
        shutil.copy(EXAMPLES / name, tmp_path)
    (tmp_path / "program.py").write_text("[]")
    command = [sys.executable, "play_pygame.py", program, policy]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 2 and message in done.stderr and "Traceback" not in done.stderr
