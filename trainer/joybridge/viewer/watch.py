"""`joybridge watch`: watch a training that runs, in the browser."""

import argparse
import sys
import webbrowser
from collections.abc import Sequence
from pathlib import Path
from threading import Event

from joybridge.contract.address import address
from joybridge.contract.credentials import ProtectedAddress, add_credentials_arguments, load_credentials
from joybridge.contract.errors import JoybridgeError
from joybridge.trainer.signals import interrupt_on_signals


def main(arguments: Sequence[str] | None = None, prog: str = "python -m joybridge.viewer") -> int:
    """Run the command line, the command first, and return its exit status."""
    options = _parse(arguments, prog)
    from joybridge.trainer.config import run_config
    from joybridge.trainer.simulators import last_simulators
    from joybridge.viewer.simulator import Simulator
    from joybridge.viewer.watched import watch
    from joybridge.viewer.web import open_website

    interrupt_on_signals()
    sys.path.insert(0, str(Path.cwd()))  # the script `joybridge`, unlike `python -m`, does not search it
    try:
        run, place = options.run, None
        config = run_config(run)
        if options.simulator:
            place = ProtectedAddress(options.simulator, load_credentials(options.tls_ca, options.token_file))
        with (
            Simulator(place, () if place else last_simulators(run).games) as simulator,
            open_website(
                options.port, lambda page: watch(page, run, simulator.reach, options.seed), "watch.html"
            ) as url,
        ):
            print(f"watch {run} ({config.game}, {config.layout}) at {url}\nCtrl-C ends it", flush=True)
            if not options.no_browser:
                webbrowser.open(url)
            Event().wait()
    except JoybridgeError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 0
    return 0


def _parse(arguments: Sequence[str] | None, prog: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog=prog)
    commands = parser.add_subparsers(dest="command", required=True)
    watch = commands.add_parser(
        "watch",
        help="watch a training that runs, in the browser",
        description="Watch a training that runs: its learning curves, and its newest policies at play. It only reads "
        "the folder of the run.",
    )
    watch.add_argument("run", type=Path, help="folder of a run")
    watch.add_argument(
        "--simulator", type=address, metavar="ADDRESS",
        help="HOST:PORT or unix:PATH of a running simulator; default: this command starts one",
    )  # fmt: skip
    add_credentials_arguments(watch)
    watch.add_argument("--seed", type=int, default=1, help="of the arena and of the samples; default %(default)s")
    watch.add_argument(
        "--port", type=int, metavar="PORT",
        help="of the page on this machine, 0: any free one; default 5006, or any free one where that is in use",
    )  # fmt: skip
    watch.add_argument("--no-browser", action="store_true", help="only print the URL of the page")
    options = parser.parse_args(arguments)
    if not 0 <= options.seed < 2**64:
        watch.error(f"argument --seed: got {options.seed}, expected 0..2^64-1")
    if options.port is not None and not 0 <= options.port < 2**16:
        watch.error(f"argument --port: got {options.port}, expected 0..65535")
    if (options.tls_ca or options.token_file) and not options.simulator:
        watch.error("--tls-ca and --token-file belong to a running simulator; name it with --simulator")
    return options
