"""The simulator: a server that runs games headless and speaks joybridge.v1. It knows nothing of learning."""

import os

os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")  # a server's output is its own
