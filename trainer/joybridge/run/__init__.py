"""A training run: collect, learn, log, save, resume.

It imports `policy`, `demonstrations`, `client` and what these import. START HERE: `train.py` shows PPO on a page.
"""
