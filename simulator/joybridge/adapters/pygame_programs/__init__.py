"""Programs written with pygame as games: `joybridge serve --pygame chimp.py`.

The program runs unchanged, with its own main loop, in a process of its own: `inside` is what surrounds it there. Once
it has drawn its first frame and asks for input, the process serves as a stem: every episode is a fork of it. A snapshot
is a fork of a player, and a stem again.
"""
