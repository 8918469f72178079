"""The tutorial is typed, block by block, by a reader who believes every word of it."""

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import av
import numpy as np
import pytest
from matplotlib.image import imread

from joybridge.config.metrics import read_rows
from tests.support.servers import free_port

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "tutorial.md"
SECONDS = 600.0  # the longest that a block may take
LATE_SECONDS = 120.0  # the longest that its output may then be waited for
NUMBER = r"-?\d[\d.,]*"
PARTS = re.compile(rf"({NUMBER}|…|\s+)")
END = "--- end of block, failures: "


@dataclass(frozen=True)
class Block:
    """A fenced block: the line of its fence, its language, what else stands there, and its text."""

    line: int
    language: str
    note: str
    text: str


def blocks(page: str) -> Iterator[Block]:
    for match in re.finditer(r"^```(\w+) ?(.*)\n((?:.*\n)*?)```$", page, re.MULTILINE):
        yield Block(page.count("\n", 0, match.start()) + 1, *match.groups())


class Terminal:
    """One shell for the whole page, so jobs in the background live on from block to block."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.log = folder, folder.with_suffix(".log")
        self.port = str(free_port())
        path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
        with self.log.open("w") as log:
            self.shell = subprocess.Popen(
                ["bash"],
                cwd=folder,
                env={**os.environ, "PATH": path},
                stdin=subprocess.PIPE,
                stdout=log,
                stderr=subprocess.STDOUT,
                text=True,
                start_new_session=True,
            )
        self.begin = 0  # of the present block's output in the log
        self.type("trap 'failures=$((failures + 1))' ERR")

    def type(self, text: str) -> None:
        assert self.shell.stdin is not None
        self.shell.stdin.write(text + "\n")
        self.shell.stdin.flush()

    def output(self) -> str:
        return self.log.read_text()[self.begin :]

    def run(self, commands: str) -> int:
        """Run a block to its end and return how many of its commands have failed."""
        self.begin = len(self.log.read_text())
        self.type(f"failures=0\n{commands}\necho '{END}'$failures")
        self.wait_for(re.escape(END) + r"\d+\n", SECONDS)
        return int(self.output().rpartition(END)[2])

    def wait_for(self, pattern: str, seconds: float) -> None:
        """Wait until the block's output has a pattern; what is started in the background may speak late."""
        deadline = time.monotonic() + seconds
        while not re.search(pattern, self.output()):
            assert self.shell.poll() is None, f"the shell has ended, after:\n{self.output()}"
            assert time.monotonic() < deadline, f"expected, in vain, {pattern!r} in:\n{self.output()}"
            time.sleep(0.02)

    def close(self) -> None:
        with suppress(ProcessLookupError):  # nothing of it is left
            os.killpg(self.shell.pid, signal.SIGKILL)
        self.shell.communicate()


def follow(page: str, terminal: Terminal, seconds: float = LATE_SECONDS) -> list[str]:
    """Do what each block of a page says, in order; return the languages. Fails with the block's line."""
    done = []
    for block in blocks(page):
        try:
            do(block, terminal, seconds)
        except AssertionError as error:
            raise AssertionError(f"line {block.line} ({block.language}): {error}") from None
        done.append(block.language)
    return done


def do(block: Block, terminal: Terminal, seconds: float) -> None:
    text = block.text.replace("5005", terminal.port)
    if block.language == "text":
        terminal.wait_for(pattern(text), seconds)
    elif block.language == "diff":
        change(terminal.folder, text)
    elif block.note.endswith(".py"):
        (terminal.folder / block.note).write_text(text)
    else:
        commands = {"sh": text, "python": f"python - <<'END OF PYTHON'\n{text}END OF PYTHON"}
        assert block.language in commands, "nobody knows what to do with it"
        failures = terminal.run(commands[block.language])
        assert bool(failures) == (block.note == "fails"), f"{failures} commands failed:\n{terminal.output()}"


def pattern(shown: str) -> str:
    """Return the pattern of an output: its lines in this order, whatever the numbers; … stands for anything."""
    lines = [line.strip() for line in shown.splitlines() if line.strip() not in ("", "…")]
    return r"\n(?:.*\n)*?".join(
        rf"(?m:^)[ ]*{''.join(map(part_pattern, PARTS.split(line)))}[ ]*(?=\n)" for line in lines
    )


def part_pattern(part: str) -> str:
    for known in (NUMBER, r"\s+"):
        if re.fullmatch(known, part):
            return known
    return ".*" if part == "…" else re.escape(part)


def change(folder: Path, diff: str) -> None:
    """Apply hunks without line numbers: each one's old lines stand in the file exactly once."""
    header, *hunks = diff.split("@@\n")
    path = folder / header.removeprefix("---").strip()
    text = path.read_text()
    for hunk in hunks:
        lines = hunk.splitlines(keepends=True)
        old = "".join(line[1:] for line in lines if line[0] in " -")
        new = "".join(line[1:] for line in lines if line[0] in " +")
        assert text.count(old) == 1, f"stands {text.count(old)} times in {path.name}:\n{old}"
        text = text.replace(old, new)
    path.write_text(text)


@pytest.fixture
def terminal(tmp_path):
    folder = tmp_path / "reader"
    folder.mkdir()
    terminal = Terminal(folder)
    yield terminal
    terminal.close()


def test_everything_on_the_page_is_as_it_says(terminal):
    page = PAGE.read_text(encoding="utf-8")
    done = follow(page, terminal)
    assert len(done) == page.count("\n```") / 2 and {"sh", "python", "diff", "text"} == set(done)
    folder = terminal.folder

    for run in ("first", "bucket"):  # both layouts learn
        rows = read_rows(folder / f"runs/{run}/metrics-player.csv")
        assert rows[-1]["reward"] > rows[0]["reward"] + 8, rows
    shown, seen = (
        imread(ROOT / "simulator/joybridge/simulator/new_game/template/my_game.png"),
        imread(folder / "look.png"),
    )
    assert shown.shape == seen.shape and np.abs(shown - seen).mean() < 0.01  # the fonts of machines differ
    assert imread(folder / "curve.png").std() > 0.05
    with av.open(str(folder / "my_game.mp4")) as video:
        frames = [frame.to_ndarray(format="rgb24").tobytes() for frame in video.decode(video=0)]
    assert len(frames) == 100 and len(set(frames)) > 50


@pytest.mark.parametrize(
    ("page", "line", "complaint"),
    [
        ("words\n\n```sh\nfalse\n```\n", 3, "1 commands failed"),
        ("```sh\nfalse\ntrue\n```\n", 1, "1 commands failed"),
        ("```sh fails\ntrue\n```\n", 1, "0 commands failed"),
        ("```sh\nexit\n```\n", 1, "the shell has ended"),
        ("```python\nraise KeyError\n```\n", 1, "KeyError"),
        ("```sh\necho one 2\n```\n\n```text\nanother 2\n```\n", 5, "another"),
        ("```sh\necho a; echo b\n```\n```text\nb\na\n```\n", 4, "in vain"),
        ("```sh\necho a fish\n```\n```text\na\n```\n", 4, "in vain"),
        ("```python a.py\nb = 1\n```\n```diff\n--- a.py\n@@\n-b = 2\n+b = 3\n```\n", 4, "stands 0 times in a.py"),
        ("```rust\n```\n", 1, "nobody knows"),
    ],
)
def test_what_is_not_as_the_page_says_fails_with_its_line(page, line, complaint, terminal):
    with pytest.raises(AssertionError, match=rf"^line {line} (?s:.*){complaint}"):
        follow(page, terminal, seconds=0.2)


def test_numbers_may_differ_and_lines_may_lie_between(terminal):
    follow(
        "```sh\necho took 12.5 s; echo more; echo '  at -3 of 1,000'\n```\n```text\ntook 9 s\n…\n at 4 … 2\n```\n",
        terminal,
        seconds=1.0,
    )


def test_a_diff_changes_what_it_shows(terminal):
    follow(
        "```python a.py\na = 1\nb = 2\n```\n```diff\n--- a.py\n@@\n a = 1\n-b = 2\n+b = 3\n```\n```sh\ncat a.py\n```\n",
        terminal,
    )
    assert (terminal.folder / "a.py").read_text() == "a = 1\nb = 3\n"
