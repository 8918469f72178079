"""Datasets of Minari: demonstrations are written as them, and policies learn from them. Only it imports minari.

It imports `demonstrations` and what that imports; it registers its command and its format as entry points.
"""

from joybridge.cli import Command

COMMAND = Command("joybridge.minari.writing", "minari", "write demonstrations as datasets of Minari")
