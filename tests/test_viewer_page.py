"""The page of `joybridge play` in a real browser: a scripted pointer and keys play, and the page shows what happens."""

import itertools
from contextlib import ExitStack

import pytest

from joybridge.viewer.arena import Settings
from joybridge.viewer.page_session import PageGame, welcome
from joybridge.viewer.run_view import watch
from joybridge.viewer.simulator import Simulator
from joybridge.viewer.watched_game import watch_game
from joybridge.viewer.web import open_website
from tests.support.chromium import PROGRAM, chromium
from tests.support.servers import server
from tests.support.wire import SECONDS
from tests.test_watch import go_on

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(PROGRAM is None, reason="needs Chromium: apt-get install chromium"),
]

TITLE = "document.querySelector('#curtain-title').textContent"
TURN = "Number(document.querySelector('#decision').textContent.split(' ')[1] ?? -1)"
CLICK = f"{TITLE}.startsWith('Click or press Enter')"
SHOWN = "document.querySelector('#curtain').classList.contains('shown')"


def find(selector, what, begin):
    """Return an expression for the element of a kind whose text or label begins with some words."""
    return f"[...document.querySelectorAll('{selector}')].find((b) => {what}.startsWith('{begin}'))"


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    with chromium(tmp_path_factory.mktemp("chromium")) as browser:
        yield browser


@pytest.fixture
def visit(browser, simulator):
    """Yield a function that opens a page that plays a game of the shared simulator."""
    with ExitStack() as open_pages:

        def visit(game, source=None, people=1, **options):
            settings = Settings(seed=1, options=options, parameters={})
            what = PageGame(game, SECONDS, people)
            url = open_pages.enter_context(open_website(0, welcome(source or Simulator(simulator, ()), what, settings)))
            tabs = [browser.tab() for _ in range(people)]
            for number, tab in enumerate(tabs, 1):
                open_pages.callback(tab.close)
                tab.size(1280, 900)
                tab.go(url)
                tab.wait(f"{TITLE} === 'Waiting for others'" if number < people else CLICK)
            return tabs[0] if people == 1 else tabs

        yield visit


def test_a_pointer_and_keys_play_shooting_birds_in_two_tabs(visit):
    tabs = [visit("shooting_birds", level="6"), visit("shooting_birds", level="0")]
    for tab in tabs:
        tab.call("Page.bringToFront")
        tab.click(400, 300)
        tab.wait(f"{TURN} > 3")
        moves = itertools.cycle([*range(400, 560, 4), *range(560, 400, -4)])
        while tab.text(".stick .value:last-child") == "0.00":  # the speed, which lasts as long as the movement
            x = next(moves)
            tab.mouse("mouseMoved", x, 300 - x // 8)
        tab.mouse("mousePressed", 560, 220, "left", 1)
        tab.mouse("mouseReleased", 560, 220, "left")
        tab.wait("/[1-9]/.test(document.querySelector('#scores').textContent)")  # a hit or a miss
        tab.key("KeyR", "r")
        pixels = "document.querySelector('#picture').getContext('2d').getImageData(0, 0, 640, 400).data"
        assert tab.value(f"new Set({pixels}).size") > 50
        tab.key("KeyP", "p")
        assert tab.wait(SHOWN) and tab.value(TITLE) == "Paused"
        turn = tab.value(TURN)
        tab.key("Period", ".")
        tab.wait(f"{TURN} > {turn}")
        assert tab.errors == []


def test_keys_take_turns_and_a_forbidden_choice_is_seen_as_such(visit):
    tab = visit("noughts")
    tab.call("Page.bringToFront")  # a hidden page is not painted
    tab.value(
        "(() => { const { prototype } = CanvasRenderingContext2D, real = prototype.drawImage; window.covered = [];"
        f"prototype.drawImage = function (...all) {{ window.covered.push({SHOWN}); "
        "return real.apply(this, all); }; })()"
    )
    tab.key("Enter", "Enter")
    for number, digit in enumerate("152", 1):
        tab.key(f"Digit{digit}", digit)
        tab.wait(f"{TURN} === {number}")
    forbidden = "[...document.querySelectorAll('.chip.forbidden')].map((chip) => chip.textContent.slice(0, 2)).join()"
    tab.wait(f"{forbidden} === 'a1,b1,b2'")
    tab.key("Digit5", "5")
    tab.wait("document.querySelector('.chip.refused') !== null")
    tab.key("Digit8", "8")
    tab.wait(f"{TURN} === 4")
    tab.wait("window.covered.length === 4")
    tab.key("Digit3", "3")  # a1, b1, c1: three in a row
    tab.wait(f"{TITLE} === 'The episode is over'")
    assert "player 1" in tab.text("#episodes") and "score" in tab.text("#curtain-text")
    tab.key("Enter", "Enter")
    tab.wait("window.covered.length === 5")
    assert not any(tab.value("window.covered"))  # the next board is not drawn while people look at how this one ended
    assert tab.errors == []


def test_every_tick_of_a_decision_is_shown(visit):
    tab = visit("beastly_rivals")
    tab.key("Enter", "Enter")
    tab.wait(f"{TURN} > 1")
    tab.key("KeyP", "p")
    tab.wait(f"{SHOWN} && {TITLE} === 'Paused'")
    tab.value(
        "(() => { const { prototype } = CanvasRenderingContext2D, real = prototype.drawImage; window.shown = 0;"
        "prototype.drawImage = function (...all) { window.shown += 1; return real.apply(this, all); }; })()"
    )
    tab.key("Period", ".")
    tab.wait("window.shown >= 6")  # a decision that the pause came too late for may have had one picture
    assert tab.errors == []


def test_two_people_play_one_match_in_two_tabs(visit):
    one, other = visit("noughts", people=2)
    one.wait(CLICK)
    one.key("Enter", "Enter")
    one.key("Digit1", "1")
    one.wait("document.querySelector('#people').textContent === 'you are player 1; waits for player 2'")
    other.key("Enter", "Enter")
    for number, (tab, digit) in enumerate(((one, "1"), (other, "5"), (one, "2"), (other, "8"), (one, "3")), 1):
        tab.call("Page.bringToFront")  # a hidden page is not painted
        if number > 1:
            tab.wait(f"{TURN} === {number - 1}")  # a key counts only once the page knows that it has the move
            tab.key(f"Digit{digit}", digit)
        tab.wait(f"{TURN} === {number}")
        assert tab.value("document.querySelector('#seat').disabled")
    for tab in (one, other):
        tab.call("Page.bringToFront")
        tab.wait(f"{TITLE} === 'The episode is over'")
        assert tab.errors == []
    other.go("about:blank")
    one.call("Page.bringToFront")
    one.wait(f"{TITLE} === 'Waiting for others'")


def test_the_space_bar_does_not_scroll_the_page_before_the_game_begins(visit):
    tab = visit("archer")
    tab.size(1200, 400)
    tab.value("addEventListener('keydown', (event) => { window.kept = event.defaultPrevented; })")
    tab.key("Space", " ")
    tab.wait("window.kept === true")
    assert tab.errors == []


def test_changed_controls_are_remembered(visit):
    tab = visit("orchard")
    tab.value("document.querySelector('#controls-card').open = true")
    tab.value(f"{find('#controls button', 'b.ariaLabel', 'Add a key for right')}.click()")
    tab.key("KeyX", "x")
    keys = find("#controls .binding", "b.textContent", "right")
    tab.wait(f"{keys}.textContent.includes('X')")
    tab.call("Page.reload")
    tab.wait(f"{keys}.textContent.includes('X') && {TITLE}.startsWith('Click')")
    tab.key("Enter", "Enter")
    tab.key("KeyX", "x", up=False)
    tab.wait(f"{find('.chip', 'b.textContent', 'right')}.ariaPressed === 'true'")
    assert tab.errors == []


def test_the_page_says_that_the_simulator_is_gone_and_goes_on_when_it_is_back(visit, tmp_path):
    address = f"unix:{tmp_path / 'simulator'}"
    with server("--address", address) as process:
        tab = visit("marble", Simulator(address, ()))
        tab.key("Enter", "Enter")
        tab.wait(f"{TURN} > 2")
        process.kill()
        tab.wait(f"{TITLE} === 'The simulator is gone'")
    with server("--address", address):
        tab.wait(f"{TITLE}.startsWith('Click or press Enter')")
        tab.key("Enter", "Enter")
        tab.wait(f"{TURN} > 2")
    assert tab.errors == []


def test_a_training_is_watched(browser, simulator, tmp_path):
    go_on(tmp_path, simulator, resume=False)
    with open_website(0, lambda page: watch(page, tmp_path, lambda: simulator, 1), "watch.html") as url:
        tab = browser.tab()
        tab.size(1280, 900)
        tab.go(url)
        tab.wait(f"{TURN} > 3")
        assert not tab.value(SHOWN) and "player: reward" in tab.text("#newest")
        assert (
            tab.text("#trained") == "after 64 timesteps"
            and tab.value("document.querySelectorAll('progress').length") > 10
        )
        pixels = "document.querySelector('#curves').getContext('2d').getImageData(0, 0, 1200, 360).data"
        assert tab.value(f"{pixels}.some((value) => value > 0)")
        tab.value("document.querySelector('#pause').click()")
        tab.wait("document.querySelector('#pause').textContent === 'Continue'")
        tab.value("document.querySelector('#pause').click()")
        other = browser.tab()  # in front, so the page is hidden: nothing is played for it
        still = f"(async (turn) => (await new Promise((f) => setTimeout(f, 200)), {TURN} === turn))({TURN})"
        tab.wait(f"document.hidden && {still}")
        turn = tab.value(TURN)
        other.close()
        tab.call("Page.bringToFront")
        tab.wait(f"{TURN} > {turn}")
        assert tab.errors == []
        tab.close()


def test_a_game_is_watched(browser, simulator):
    settings = Settings(1, {}, {})
    with open_website(
        0, lambda page: watch_game(page, lambda: simulator, "archer", settings, SECONDS), "watch.html"
    ) as url:
        tab = browser.tab()
        tab.size(1280, 900)
        tab.go(url)
        tab.wait(f"{TURN} > 3")
        assert not tab.value(SHOWN) and tab.text("#trained") == "random decisions"
        hidden = (
            "['curves-card', 'outputs-card'].every((id) => document.getElementById(id).checkVisibility() === false)"
        )
        assert tab.value(hidden)
        assert tab.errors == []
        tab.close()
