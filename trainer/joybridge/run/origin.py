"""What a run was made with: versions, commit, packages, machine, command line and environment variables.

It stands in the run's folder, once for each training that continued it, and in every checkpoint.
"""

import hashlib
import json
import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Iterator
from contextlib import suppress
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, distribution, distributions
from pathlib import Path

from pydantic import BaseModel, ConfigDict, TypeAdapter

from joybridge.config.files import write_atomically
from joybridge.config.json_files import ONLY_FOR_PEOPLE, read_json

FILE = "origin.json"  # in the folder of a run
MAX_BYTES = 2**24  # of it
VARIABLES = ("CUDA_", "JOYBRIDGE_", "MKL_", "NUMBA_", "OMP_", "OPENBLAS_", "PYTHONHASHSEED", "PYTORCH_", "TORCH_")
SECRETS = ("KEY", "PASSWORD", "SECRET", "TOKEN")  # in names of variables that are left out
COMPUTING = ("torch", "numpy", "numba", "scipy", "gymnasium", "pettingzoo", "pygame")  # are named first


class Origin(BaseModel):
    """With what a training ran."""

    model_config = ConfigDict(strict=True, frozen=True, extra="forbid")

    joybridge: str  # version
    commit: str  # of the sources, with "-dirty" behind it if they were changed, or `files_mark`; "": not known
    python: str
    packages: dict[str, str]  # versions of everything that is installed
    system: str
    processor: str
    cores: int
    accelerators: list[str]
    command: str
    environment: dict[str, str]
    began: str  # in UTC


@cache
def own_origin() -> Origin:
    """Return what this process runs with."""
    installed = {one.name: one.version for one in distributions() if one.name}
    return Origin(
        joybridge=installed["joybridge"],
        commit=commit(),
        python=platform.python_version(),
        packages=dict(sorted(installed.items(), key=lambda pair: pair[0].lower())),
        system=f"{platform.system()} {platform.release()} {platform.machine()}",
        processor=_processor(),
        cores=os.cpu_count() or 1,
        accelerators=_accelerators(),
        command=shlex.join(sys.argv),
        environment={
            name: value
            for name, value in sorted(os.environ.items())
            if name.startswith(VARIABLES) and not any(word in name for word in SECRETS)
        },
        began=f"{datetime.now(UTC):%Y-%m-%d %H:%M:%S}",
    )


def keep_origin(run: Path) -> None:
    """Add what this process runs with to the folder of a run, once. Raises StorageError, and ConfigError."""
    origins = run_origins(run)
    if own_origin() not in origins:
        content = [one.model_dump() for one in (*origins, own_origin())]
        write_atomically(run / FILE, json.dumps(content, indent=1).encode())


def run_origins(run: Path) -> list[Origin]:
    """Return with what the trainings of a run ran, the first one first; none if nobody has noted it.

    Raises ConfigError.
    """
    return read_json(run / FILE, TypeAdapter(list[Origin]), MAX_BYTES, ONLY_FOR_PEOPLE) or []


def differences(trained: Origin) -> Iterator[str]:
    """Yield what was otherwise in a training than it is here and may change numbers, as in "torch 2.8 (here 2.9)"."""
    here = own_origin()
    pairs = {name: (getattr(trained, name), getattr(here, name)) for name in ("joybridge", "commit", "python")}
    before, now = trained.packages, here.packages
    names = [*COMPUTING, *(name for name in before if name not in COMPUTING)]
    pairs |= {
        name: (before[name], now.get(name, "missing")) for name in names if name in before and name != "joybridge"
    }
    yield from (f"{name} {was} (here {now})" for name, (was, now) in pairs.items() if was and now and was != now)


def remark(trained: Origin | None, most: int = 5) -> str:
    """Return in a line how a training differs from what runs here, naming so many differences; "": it does not."""
    found = [] if trained is None else list(differences(trained))
    if not found:
        return ""
    more = f", and {len(found) - most} more packages" if len(found) > most else ""
    return f"trained with {', '.join(found[:most])}{more}: numbers may differ"


def commit() -> str:
    """Return the commit of the checkout, or of what pip has installed, or `files_mark`; "" if none is known."""
    root = Path(__file__).parents[3]
    if (root / ".git").exists():
        command = ["git", "-C", str(root), "describe", "--always", "--dirty", "--abbrev=40", "--exclude=*"]
        with suppress(OSError, subprocess.SubprocessError):
            return subprocess.run(command, capture_output=True, text=True, timeout=10, check=True).stdout.strip()
    with suppress(TypeError, ValueError, KeyError):  # it was not installed from a repository
        return str(json.loads(distribution("joybridge").read_text("direct_url.json") or "")["vcs_info"]["commit_id"])
    with suppress(PackageNotFoundError):
        return files_mark(distribution("joybridge").read_text("RECORD") or "")
    return ""


def files_mark(record: str) -> str:
    """Return a mark of the installed files, where a copy of a checkout leaves no commit; "" if none are listed.

    record: the text of RECORD, which pip writes; the same sources give the same mark everywhere.
    """
    lines = sorted(line for line in record.splitlines() if line.startswith("joybridge/") and ",sha256=" in line)
    text = "\n".join(lines)
    return f"files-{hashlib.sha256(text.encode()).hexdigest()[:16]}" if lines else ""


def _processor() -> str:
    with suppress(OSError, StopIteration):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.partition(": ")[2] for line in lines if line.startswith("model name"))
    return platform.processor()


def _accelerators() -> list[str]:
    import torch  # takes seconds to load; whoever trains has done so

    return [torch.cuda.get_device_name(index) for index in range(torch.cuda.device_count())]
