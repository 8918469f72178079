"""The trainer: a client that learns to play the games of any joybridge.v1 server. It knows no game's rules."""

import os

# The trainer starts child processes (a simulator, ffmpeg) but never forks to go on in Python, so gRPC need not
# prepare for that, nor warn that it cannot.
os.environ.setdefault("GRPC_ENABLE_FORK_SUPPORT", "0")
