"""What is promised, and the tests that hold it: those with the marker `promise` and the number of the promise."""

import ast
from collections import defaultdict
from pathlib import Path

TESTS = Path(__file__).parents[2] / "tests"
PROMISES = {
    "P1": "Every kind of malformed request has its own status and sentence, and disturbs nobody",
    "P2": "Requests in any order are answered or refused as the contract says",
    "P3": "All games, and the servers in other languages, pass the conformance kit",
    "P4": "Within v1, fields are only added to the contract",
    "P5": "Earlier trainers work with today's simulator, and the reverse (`python -m tools.check_versions`)",
    "P6": "An observation may have 64 MiB",
    "P7": "Health and other sessions are answered while a game hangs",
    "L1": "No call to a server is without a deadline",
    "L2": "A simulator that does not answer is named with what was waited for",
    "L3": "A client that is frozen or gone loses its place within 15 seconds, and notices a server that is",
    "L4": "A simulator that is not there yet is waited for, and each second it is said what is in the way",
    "F1": "A run whose simulator is killed goes on by itself and ends in the same bits",
    "F2": "Killed trainers and grids lose little, and nothing is half-written",
    "F3": "A game that fails costs its arena after long play, else its own session, and is named with step and arena",
    "F4": "A simulator that holds up the others is named, and its arenas move where the game has snapshots",
    "F5": "An interrupted run saves, ends its simulator and resumes exactly",
    "F6": "A full or read-only disk is said, and the older files stay whole",
    "F7": "Connections and sessions that end leave nothing behind",
    "F8": "Growth of memory is found (`python -m tools.soak`)",
    "S1": "One trainer per run, one comparison per folder",
    "S2": "Silent streams take no place, and silent sessions end",
    "S3": "A response answers one request, or ends the session",
    "C1": "A kill at any moment of saving leaves a checkpoint that can be loaded",
    "C2": "Every flipped byte and every cut of a checkpoint is noticed",
    "C3": "A stopped run resumes to the same bits",
    "C4": "Files of earlier versions are read, or refused by name",
    "D1": "A game is the same for any number of arenas and simulators",
    "D2": "The same seed gives the same weights, bit for bit",
    "D3": "A seed keeps its episodes; another game under the same name is noticed",
    "D4": "Pictures show the state and leave it alone",
    "X1": "No address that others can reach without TLS and a token",
    "X2": "The token is needed for every call but health, is private, and never travels in clear text",
    "X3": "No code runs from files, and nothing starts because a run of somebody else says so",
    "X4": "Arenas, messages and names have limits",
    "X5": "Few packages, with hashes; the wheel is built twice to the same bytes, and what it brings can be listed",
    "X6": "Small files do not become large in memory, and damaged ones read nothing that is not theirs",
    "X7": "What games, environments and workers hold ends with the session and with the server",
    "E1": "The environments pass the checks of Gymnasium and PettingZoo",
    "E2": "A game of one's own takes sixty lines and passes the kit",
    "M1": "The gradient of PPO is that of autograd",
    "M2": "Each small game is learned as it is configured",
    "O1": "Errors have codes that stay, and a next move",
    "O2": "A recorded fault fails again in the same step",
    "Q2": "Slower starts, updates and round trips are found (`python -m tools.ratios`)",
    "T1": "Small changes of what learning rests on are noticed by tests (`python -m tools.mutants`)",
    "T2": "This table is generated from the tests",
}


def promises() -> str:
    """Return a table of the promises and of the tests that hold them."""
    held = tests_by_promise()
    rows = [f"| {number} | {text} | {'<br>'.join(held[number])} |" for number, text in PROMISES.items()]
    return "\n".join(["| | promise | held by |", "| --- | --- | --- |", *rows])


def tests_by_promise() -> dict[str, list[str]]:
    """Return the tests that hold each promise, as `FILE::TEST`, by its number."""
    found = defaultdict(list)
    for path in sorted(TESTS.glob("test_*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.FunctionDef):
                for number in _promises_of(node):
                    found[number].append(f"`{path.stem}::{node.name}`")
    return found


def _promises_of(test: ast.FunctionDef) -> list[str]:
    return [
        argument.value
        for decorator in test.decorator_list
        if isinstance(decorator, ast.Call) and ast.unparse(decorator.func) == "pytest.mark.promise"
        for argument in decorator.args
        if isinstance(argument, ast.Constant) and isinstance(argument.value, str)
    ]
