"""The reference of errors: the Reasons of the contract and the exceptions of Python, each with what to do."""

import ast
import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from joybridge.contract.errors import JoybridgeError
from tools.docs.contract import PROTO

ROOT = Path(__file__).parents[2]
SIDES = [ROOT / side for side in ("proto", "simulator", "trainer")]
BASE = "JoybridgeError"
INSIDE = {  # modules whose exceptions are caught where they are raised
    "joybridge.conformance.expectations",
    "joybridge.contract.local_socket",
    "joybridge.simulator.session",
    "joybridge.viewer.messages",
}
REASON = re.compile(r"^  REASON_(\w+) = \d+; +// (\w+): (.*)$", re.MULTILINE)

REASONS = {  # what to do
    "UNKNOWN_GAME": "use a name that `joybridge list --simulator ADDRESS` prints, or start the server with `--game`",
    "MALFORMED_MESSAGE": "generate the client's code from the same `bridge.proto` as the server's",
    "UNKNOWN_REQUEST": "set exactly one request; ask `ListGames` for the revision before you use a new one",
    "UNKNOWN_OPTION": "use an option of the spec; a number is a parameter",
    "UNKNOWN_CHOICE": "use a choice of the spec",
    "UNKNOWN_PARAMETER": "use a parameter of the spec; a name among choices is an option",
    "PARAMETER_OUT_OF_RANGE": "stay within `low` and `high` of the spec",
    "NO_ARENAS": "ask for at least one",
    "WRONG_SNAPSHOT": "start with the game, options, seed and arenas with which the snapshot was saved",
    "WRONG_BEHAVIORS": "send one entry per behavior, in the order of the spec",
    "WRONG_TENSOR": "send a row per lane, with a column per axis or branch, as `float32` or `int32`, little-endian",
    "NOT_FINITE": "find the NaN in the policy; training ends with DivergedError before it sends one",
    "ACTION_OUT_OF_RANGE": "clip axes to `low` and `high`; choices count from 0",
    "ACTION_MASKED": "choose what the masks of the last `Step` allow",
    "WRONG_DRAW": "name each arena at most once, counted from 0",
    "OLD_SERVER": "install a newer server, or an older client",
    "WRONG_ORDER": "send `Start` first and once; open another stream for another session",
    "NO_SNAPSHOTS": "send `Save` only if the spec has `snapshot_bytes_per_arena`",
    "NO_PICTURES": "draw only if the spec has a picture",
    "TOO_MANY_ARENAS": "ask for fewer (`arenas`), or add a second server with another `--simulator`",
    "TOO_MANY_SESSIONS": "wait, end another session, or start the server with a larger `--sessions`",
    "MESSAGE_TOO_LARGE": "send only the fields of the contract; all sizes follow from the spec",
    "GAME_FAILED": "read the traceback in the server's log; `joybridge replay` repeats a recorded fault",
    "GAME_TOO_SLOW": "find the endless loop in the game, or raise `--step-seconds` of the server",
    "NO_START": "send `Start` at once, or raise `--start-seconds` of the server",
    "IDLE": "close sessions that are not used, or raise `--idle-seconds` of the server",
    "NO_TOKEN": "give the client the server's token with `--token-file`",
    "WRONG_DISTRIBUTION": "give `low` below `high`, above 0 if it is log-uniform, or 1 to 100 values",
    "NO_DISTRIBUTIONS": "give the parameter one value; only games with `parameters_per_episode` draw it per episode",
    "SHUTTING_DOWN": "start the server again; a trainer waits for it and goes on",
}

EXCEPTIONS = {  # what to do
    "JoybridgeError": "Print it: the text says what to do.",
    "MessageError": "Repair the program that made the message; `joybridge check` finds the same mistake in a server.",
    "TensorError": "Send the dtype, shape and size that the text names.",
    "SpecError": "Use a name and a value of the spec that `joybridge list` prints.",
    "CommunicatorError": "Start the trainer of ML-Agents, or use another release of it, as the text says.",
    "CredentialsError": "Name a file with certificates in PEM or a token in one line; send tokens with TLS.",
    "SelectionError": "Use one of the names in the text; `joybridge check --list` prints all.",
    "NewGameError": "Choose another name or folder, as the text says.",
    "GameError": "Repair the game; the text names the arena, the part and what was expected.",
    "ArenaError": "Repair the game; the text names the arena.",
    "ServerError": "Start the server, or name a game that it has.",
    "CatalogError": "Repair the game or its place; its module must be importable from the current folder.",
    "ServerCredentialsError": "Give the server TLS and a token, or let it listen on 127.0.0.1.",
    "AdapterError": "Wrap the environment, for example in `gymnasium.wrappers.RescaleAction`, as the text says.",
    "TapeError": "Repair the program, or record the tape again if it should have changed.",
    "Difference": "The same: `replay` says where the pictures are.",
    "ConfigError": "Set the key to what the text expects; `joybridge keys WORD` explains it.",
    "SettingError": "Write the layout in the form that the text names.",
    "DeviceError": "Take another layout for this game.",
    "UntrustedRunError": "Look at what the run names; if you trust it, repeat the command with `--trust-run`.",
    "CheckpointError": "Name another checkpoint with `--checkpoint`, or train a new run.",
    "StorageError": "Make room, give write permission, or name another folder.",
    "RunLockedError": "End the other training, or name another folder with `--run`.",
    "DivergedError": "Start a new run with smaller rewards, observations or `policy.learning_rate`.",
    "ExportError": "Report it: nothing is written.",
    "SimulatorError": "`reason` and `field` say what was refused; see the reasons above.",
    "SimulatorLost": "Start the simulator again and resume; `joybridge train` does both by itself.",
    "NoSuchGame": "Name a game of the server: `joybridge list --simulator ADDRESS`.",
    "SimulatorShutDown": "Wait until the server is started again, then resume.",
    "FaultFound": "Repair the game: the step that the text names fails again, or differs.",
    "RecordingError": "Name a demonstration, or a file of the folder `faults` of a run, that is as it was written.",
    "ActionError": "Send an action of the action space; `sample_allowed` draws one that the mask allows.",
}


def reasons() -> str:
    """Return a table of every Reason of the contract: its status, when it is sent, and what to do."""
    rows = [f"| `{name}` | `{code}` | {when} | {REASONS[name]} |" for name, code, when in REASON.findall(_contract())]
    return "\n".join(["| reason | status | when | what to do |", "| --- | --- | --- | --- |", *rows])


def exceptions() -> str:
    """Return the tree of exceptions that callers meet, as nested lists: when each is raised, and what to do."""
    return "\n".join(_branch(BASE, 0))


def found_exceptions() -> dict[str, tuple[str, str, str]]:
    """Return the base, the module and the docstring of every exception that reaches callers, by name."""
    classes = {
        node.name: (base.id, module, ast.get_docstring(node) or "")
        for module, tree in _modules()
        for node in tree.body
        if isinstance(node, ast.ClassDef) and node.name[0] != "_" and module not in INSIDE
        for base in node.bases[:1]
        if isinstance(base, ast.Name)
    }

    def derived(name: str) -> bool:
        return name == BASE or (name in classes and derived(classes[name][0]))

    return {name: found for name, found in classes.items() if derived(name)}


def _branch(name: str, depth: int) -> Iterator[str]:
    found = found_exceptions()
    _, module, docstring = found[name]
    when = " ".join(docstring.partition("\n\n")[0].split())
    code = "" if name == BASE else f", `{code_of(name)}`"
    yield f"{'  ' * depth}- **{name}** (`{module}`{code}): {when} *{EXCEPTIONS[name]}*"
    for child, (base, _, _) in found.items():
        if base == name:
            yield from _branch(child, depth + 1)


def code_of(name: str) -> str:
    """Return the code of an exception, as `JoybridgeError.code` has it."""
    made: JoybridgeError = type(name, (JoybridgeError,), {})()
    return made.code


def _contract() -> str:
    return PROTO.read_text(encoding="utf-8")


@cache
def _modules() -> list[tuple[str, ast.Module]]:
    """Return the name and the syntax tree of every module, without generated ones."""
    return [
        (".".join(path.relative_to(side).with_suffix("").parts), ast.parse(path.read_text(encoding="utf-8")))
        for side in SIDES
        for path in sorted((side / "joybridge").rglob("*.py"))
        if "_pb2" not in path.name
    ]
