"""What the search of the site finds: the words of "What you may be looking for", and questions whose answer is known.

    python -m tools.docs.search     ask them all of the site that `python -m tools.docs` has built; needs Node.js

The words of each row of docs/find.md are entries in the index of the page that its first link leads to. So a word that
people use, and no page does, finds its page first.
"""

import json
import re
import shutil
import subprocess
import sys
from collections import defaultdict
from functools import cache
from posixpath import join, normpath
from typing import NamedTuple

from tools.docs.pages import ROOT

FIND = "docs/find.md"
NOT_SEARCHED = {"CHANGELOG.md", "docs/decisions.md"}  # they name everything, and answer no question of a user
ROW = re.compile(r"^\| ([^|]+) \| (.+) \|$", re.MULTILINE)
LINK = re.compile(r"\]\(([^)#:]+\.md)")
FIRST, LEAST = 3, 53  # so many results are looked at; so many questions find their page there

QUESTIONS = {  # as people type them; the pages that answer, without .md
    "pygame": ["docs/pygame-programs", "docs/tutorial"],
    "pixels": ["docs/pictures"],
    "screen": ["docs/pictures"],
    "self-play": ["docs/opponents"],
    "league": ["docs/opponents"],
    "lstm": ["docs/memory"],
    "recurrent": ["docs/memory"],
    "godot": ["docs/your-server"],
    "unity": ["docs/ml-agents", "docs/from-ml-agents"],
    "browser": ["docs/play"],
    "held-out": ["docs/training"],
    "generalization": ["docs/training", "docs/worlds"],
    "procedural": ["docs/worlds"],
    "mouse": ["docs/pointer"],
    "cursor": ["docs/pointer"],
    "frame skip": ["docs/reference/contract", "docs/pointer"],
    "onnx": ["docs/exported-policies"],
    "load a model": ["docs/exported-policies"],
    "imitation": ["docs/demonstrations"],
    "hyperparameter": ["docs/compare"],
    "sweep": ["docs/compare"],
    "cluster": ["docs/grids"],
    "wandb": ["docs/training"],
    "resume": ["docs/training"],
    "custom network": ["docs/own-parts"],
    "action masking": ["docs/gymnasium"],
    "stable-baselines3": ["docs/gymnasium", "docs/from-sb3-cleanrl"],
    "windows": ["docs/getting-started"],
    "human reaction time": ["docs/training"],
    "curriculum": ["docs/training"],
    "frame stack": ["docs/memory", "docs/reference/keys", "docs/training", "docs/pictures"],
    "determinism gpu": ["docs/training", "docs/speed"],
    "reward normalization": ["docs/from-sb3-cleanrl", "docs/training", "docs/reference/keys"],
    "custom network architecture": ["docs/own-parts"],
    "confidence interval": ["docs/compare"],
    "p value": ["docs/compare"],
    "resume checkpoint": ["docs/training"],
    "warm start": ["docs/training"],
    "replay buffer": ["docs/find", "docs/gymnasium"],
    "multiple buttons at once": ["docs/layouts"],
    "onnx export": ["docs/exported-policies"],
    "drag and drop": ["docs/layouts", "docs/pygame-programs", "docs/pointer"],
    "highscore file": ["docs/pygame-programs"],
    "PermissionError": ["docs/pygame-programs"],
    "title screen": ["docs/pygame-programs"],
    "game over": ["docs/pygame-programs"],
    "sound effect reward": ["docs/pygame-programs"],
    "headless server xvfb": ["docs/pygame-programs", "docs/operating"],
    "button held down": ["docs/layouts", "docs/pygame-programs"],
    "cite bibtex": ["docs/paper"],
    "effect size": ["docs/compare"],
    "probability of improvement": ["docs/compare"],
    "learning curve dataframe": ["docs/training"],
    "custom encoder": ["docs/own-parts"],
    "shared actor critic": ["docs/reference/keys", "docs/compare"],
    "observation noise": ["docs/training"],
}


class Found(NamedTuple):
    """The pages that a question finds, best first."""

    question: str
    pages: list[str]

    @property
    def right(self) -> bool:
        """Whether a page that answers is among the first."""
        return any(page in self.pages[:FIRST] for page in QUESTIONS[self.question])


@cache
def words() -> dict[str, list[str]]:
    """Return the words that lead to each page, by its path, from docs/find.md."""
    found: dict[str, list[str]] = defaultdict(list)
    for said, answer in ROW.findall((ROOT / FIND).read_text(encoding="utf-8")):
        if link := LINK.search(answer):
            found[normpath(join("docs", link[1]))] += [word.strip().lower() for word in said.split(",")]
    return found


def indexed(page: str, text: str) -> str:
    """Return the text of a page with its words as entries of the index, after its title; some are not searched."""
    if page in NOT_SEARCHED:
        return f"---\nnosearch: true\n---\n{text}"
    if page not in words():
        return text
    entries = ", ".join(f"! {word}" for word in words()[page])
    title, line, rest = text.partition("\n")
    return f"{title}{line}\n```{{index}} {entries}\n```\n{rest}" if title.startswith("# ") else text


def ask(site: str = "site") -> list[Found]:
    """Return what the site's own search finds for each question. Raises CalledProcessError and OSError."""
    program = ROOT / "tools/docs/search.mjs"
    command = [shutil.which("node") or "node", str(program), str(ROOT / site), json.dumps(list(QUESTIONS))]
    answers = json.loads(subprocess.run(command, check=True, stdout=subprocess.PIPE, text=True).stdout)
    return [Found(question, list(dict.fromkeys(answers[question]))) for question in QUESTIONS]


def main() -> int:
    """Print the questions whose page is not among the first; return 1 if there are too many."""
    found = ask()
    for one in found:
        if not one.right:
            print(f"{one.question}: {', '.join(one.pages[:FIRST]) or 'nothing'}; wanted {QUESTIONS[one.question]}")
    right = sum(one.right for one in found)
    print(f"{right} of {len(found)} questions find their page among the first {FIRST}, expected {LEAST}")
    return int(right < LEAST)


if __name__ == "__main__":
    sys.exit(main())
