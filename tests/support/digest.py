"""Print the digest of a short run: python -m tests.support.digest MODULE."""

import sys
from importlib import import_module

if __name__ == "__main__":
    print(import_module(sys.argv[1]).digest_of_a_short_run())
