"""The commands of the trainer, one per file: options, messages, exit statuses.

It may import every room; only the table of commands in `joybridge.cli` names it. Start with `train.py`.
"""
