"""Arenas of one-arena games in worker processes: `joybridge serve --workers N`.

`WorkerGame` divides the arenas of a session among processes. Each steps its own, so the bytes are those of one process.
"""
