"""The table of a study: the metrics of all its finished runs, in one compressed CSV.

`pandas.read_csv("FOLDER/runs.csv.xz")` reads it. The columns of KEYS say which run a row is of; the others are those of
the metrics files, whose cells are kept as they are written. The same runs give the same bytes, whatever their order.
"""

import csv
import io
import lzma
from collections.abc import Mapping
from pathlib import Path

from filelock import FileLock

from joybridge.compare.names import ResultName, RunName
from joybridge.config.errors import CheckpointError
from joybridge.config.files import storing, write_atomically
from joybridge.config.metrics import KEYS, Cells, numbers, parse_cells
from joybridge.contract.files import read_file

TABLE = "runs.csv.xz"
MAX_BYTES = 2**28  # of a table as text

Results = dict[ResultName, list[Cells]]  # the rows of metrics of each policy of each run


def read_table(folder: Path) -> Results:
    """Return the results in the folder of a study by name, sorted; none where there is no table.

    Raises CheckpointError unless the table is whole, all of its metrics are numbers and every row has its timesteps.
    """
    path, results = folder / TABLE, Results()
    try:
        for cells in parse_cells(_unpacked(path), but=KEYS):
            key = {name: cells.pop(name, "") for name in KEYS}
            run = RunName(key["experiment"], int(key["seed"]))
            results.setdefault(ResultName(run, int(key["total_timesteps"]), key["policy"]), []).append(cells)
    except FileNotFoundError:
        return {}
    except (OSError, ValueError, lzma.LZMAError) as error:
        raise CheckpointError(f"{path} is no table of results ({error}); move it away") from error
    return results


def add_results(folder: Path, added: Mapping[ResultName, list[Cells]]) -> None:
    """Add results to the table of a study; what is there already stays as it is.

    Raises FileExistsError, and adds nothing, where another run, which has other rewards, is there under the same name.
    Raises CheckpointError for a damaged table, and StorageError.
    """
    with storing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    with FileLock(folder / ".lock"):  # another program may be adding results of its own
        results = read_table(folder)
        for name, rows in added.items():
            if _rewards(results.get(name, rows)) != _rewards(rows):
                raise FileExistsError(f"{folder / TABLE} has {name} of another run; move it away or use another folder")
        missing = {name: rows for name, rows in added.items() if rows and name not in results}
        if missing:
            write_atomically(folder / TABLE, _packed({**results, **missing}))


def _unpacked(path: Path) -> str:
    """Return the text of a table. Raises OSError, LZMAError and ValueError, also for one longer than MAX_BYTES."""
    unpacker = lzma.LZMADecompressor(lzma.FORMAT_XZ)
    data = unpacker.decompress(read_file(path, MAX_BYTES), MAX_BYTES)
    if not unpacker.eof or unpacker.unused_data:
        raise ValueError(f"its end is missing, is not its end, or comes after more than {MAX_BYTES:,} bytes")
    return data.decode()


def _packed(results: Results) -> bytes:
    """Return the content of a table."""
    ordered = sorted(results, key=str)
    columns = dict.fromkeys(column for name in ordered for cells in results[name] for column in cells)
    text = io.StringIO(newline="")
    table = csv.DictWriter(text, [*KEYS, *columns], lineterminator="\n")
    table.writeheader()
    for name in ordered:
        run = name.run
        key = dict(zip(KEYS, (name, run.experiment, run.seed, name.timesteps, name.policy), strict=True))
        table.writerows(key | cells for cells in results[name])
    return lzma.compress(text.getvalue().encode())


def _rewards(rows: list[Cells]) -> list[float | None]:
    return [row.get("reward") for row in numbers(rows)]
