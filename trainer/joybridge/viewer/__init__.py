"""Play a game in the browser, `joybridge play`, or watch a training, `joybridge watch`.

Playing works with any server, from the spec alone, and needs no torch.

play.py          the command line
web.py           the local web server: the files of the page, and who may have them
page_session.py  plays with one page: its messages, the clock of the game, what happens if the simulator is lost
arena.py         one arena, and who holds its seats
scores.py        the scores of an arena, and its episodes that have ended
run_opponent.py  policies that play beside the person or hold the other seats; needs torch
messages.py      what a page and this program send each other
controls.py      which keys, pointer and gamepad act on which axes and branches
simulator.py     where sessions are opened
page_options.py  options of both commands
watch.py         the command line of `joybridge watch`
clock.py         the pace of what is watched
watched_game.py  a game without a run, as a page shows it
run_view.py      a run in training, as a page shows it; needs torch
page/            the page: HTML, style and JavaScript modules, without a build step
"""

from joybridge.cli import Command

PLAY = Command("joybridge.viewer.play", "viewer", "play a game in the browser")
WATCH = Command("joybridge.viewer.watch", "train,viewer", "watch a running training, or a game, in the browser")
