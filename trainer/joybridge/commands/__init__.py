"""The commands train, evaluate, record, export, replay and look: options, messages, exit statuses.

It may import every room; only the table of commands in `joybridge.cli` names it. Start with `__main__.py`.
"""
