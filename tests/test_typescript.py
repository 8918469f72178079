"""What the server in TypeScript says about its packages; tools/check_typescript.py builds and tests it."""

import json
import re
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "proto" / "examples" / "typescript"


def test_the_lock_file_pins_versions_and_names_no_host():
    lock = (SOURCE / "package-lock.json").read_text()
    assert "://" not in lock
    package = json.loads((SOURCE / "package.json").read_text())
    for group in ("dependencies", "devDependencies"):
        for name, version in package[group].items():
            assert re.fullmatch(r"\d+\.\d+\.\d+", version), name
            assert json.loads(lock)["packages"][f"node_modules/{name}"]["version"] == version
