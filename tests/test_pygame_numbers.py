"""Numbers in the texts of a program are proposed as rewards, by patterns that read them."""

import re

import pytest

from joybridge.adapters.pygame_programs.inside.numbers import MAX_NUMBERS, Numbers

FRAMES = [  # texts of frames, and what is proposed
    ([["Score: 0", "Lives: 3"], ["Score: 10", "Lives: 3"]], [(r"^Score: (-?\d+)", 0, 10), (r"^Lives: (-?\d+)", 3, 3)]),
    ([["   99"], ["  100"]], [(r"^ *(\d+)$", 99, 100)]),
    ([["$ 99"], ["$100"]], [(r"^\$ *(\d+)$", 99, 100)]),
    ([["Gold 1,200"], ["Gold 900"]], [(r"^Gold (-?[\d,]+)", 900, 1200)]),
    ([["x = -1.5 m"], ["x = 2.5 m"]], [(r"^x = (-?[\d.]+)", -1.5, 2.5)]),
    ([["3/20"], ["4/20"]], [(r"^(\d+)/20$", 3, 4)]),
    ([["1:07"], ["2:08"]], [(r"^(\d+):\d+$", 1, 2), (r"^\d+:(\d+)$", 7, 8)]),
    ([["0", "0"], ["1", "0"]], [(r"text1:^(\d+)$", 0, 1), (r"text2:^(\d+)$", 0, 0)]),
    ([["P1: 5", "P2: 5"], ["P1: 6", "P2: 7"]], [(r"^P1: (-?\d+)", 5, 6), (r"^P2: (-?\d+)", 5, 7)]),
    (
        [["Popped 0  Lost 3"], ["Popped 0  Lost 4"]],
        [(r"^Popped (-?\d+)", 0, 0), (r"^Popped -?\d+ *Lost (-?\d+)", 3, 4)],
    ),
    ([["Player 1: 5"], ["Player 1: 6"]], [(r"^Player 1: (-?\d+)", 5, 6)]),
    ([["A: 1\nB: 2"], ["A: 3\nB: 2"]], [(r"^A: (-?\d+)", 1, 3), (r"^A: -?\d+\s+B: (-?\d+)", 2, 2)]),
    ([["All 3 rights reserved by the author"]], []),
    ([["no number"], [" ".join("12345"[: MAX_NUMBERS + 1])]], []),
]


@pytest.mark.parametrize(("frames", "proposed"), FRAMES)
def test_a_proposed_pattern_reads_the_number_in_every_frame(frames, proposed):
    numbers = Numbers()
    for texts in frames:
        for text in texts:
            numbers.read(text)
        numbers.end_frame()
    assert sorted(numbers.found()) == sorted(proposed)
    for reward, low, high in proposed:
        _, _, pattern = reward.rpartition("text")
        matches = [re.search(re.sub(r"^\d:", "", pattern), text) for texts in frames for text in texts]
        read = {float(match[1].replace(",", "")) for match in matches if match}
        assert {low, high} <= read


def test_a_score_that_falls_below_nothing_later_is_still_read():
    numbers = Numbers()
    numbers.read("Score: 3")
    ((pattern, _, _),) = numbers.found()
    assert re.findall(pattern, "Score: -2") == ["-2"]


def test_numbers_that_change_come_first():
    numbers = Numbers()
    for frame in range(3):
        numbers.read("Level 1")
        numbers.read("Level 1")
        numbers.read(f"Score {frame}")
        numbers.end_frame()
    assert numbers.found()[0] == (r"^Score (-?\d+)", 0, 2)
