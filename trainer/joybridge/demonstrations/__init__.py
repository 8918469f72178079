"""Recorded play as decisions: which files there are, what they hold, and how a policy clones it.

It imports `policy`, `client` and `config`. Start with `recorded.py`; formats of others register as entry points.
"""
