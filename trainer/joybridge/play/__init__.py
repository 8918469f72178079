"""Trained policies at play: evaluation, videos, measures of what they press, files that play without the trainer.

It imports `run` and what that imports. Start with `playing.py`, which all of them share.
"""
