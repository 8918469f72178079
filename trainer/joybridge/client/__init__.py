"""The connection to simulators: sessions and their transports, several simulators as one, and starting them.

It imports `config` and the contract, and no torch. Start with `client.py`, which shows a session from Start to Act.
"""

import os

# The trainer starts child processes (a simulator, ffmpeg) but never forks to go on in Python, so gRPC need not
# prepare for that, nor warn that it cannot.
os.environ.setdefault("GRPC_ENABLE_FORK_SUPPORT", "0")
