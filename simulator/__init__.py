"""The simulator: a server that runs games headless and speaks joybridge.v1. It knows nothing of learning."""
