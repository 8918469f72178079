"""`python -m joybridge`: the same as the command `joybridge`."""

import sys

from joybridge.cli import main

sys.exit(main())
