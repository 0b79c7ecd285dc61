"""The tests nearest to a changed file: `python -m tests.near observer/model/couple.py --pytest=-x`.

Modules that mutants are tried on have a list of tests (`campaigns/mutants/nearest.py`). Of others, the test
files that import the module run. A changed test file runs itself.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from campaigns.mutants.nearest import NEAREST

ROOT = Path(__file__).parents[1]
MOST_FILES = 8
"""How many test files run if many import a module: the nearest by folder, then the shortest."""


def nearest(file: str) -> tuple[str, ...]:
    """Return arguments to pytest for a file, relative to the project; empty if no test imports it."""
    if file.startswith("tests/"):
        return (file,)
    if file in NEAREST:
        return NEAREST[file].tests
    module = re.escape(file.removesuffix(".py").removesuffix("/__init__").replace("/", "."))
    package, _, name = module.rpartition(r"\.")
    imports = re.compile(
        rf"^(from {module} import|import {module}\b|from {package} import .*\b{name}\b)", re.M
    )
    found = [
        path for path in sorted(ROOT.glob("tests/**/test_*.py")) if imports.search(path.read_text("utf-8"))
    ]
    folder = Path(file).parent.name
    found.sort(key=lambda path: (path.parent.name != folder, path.stat().st_size))
    return tuple(str(path.relative_to(ROOT)) for path in found[:MOST_FILES])


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the nearest tests of the files that are given; 2 if a file has none."""
    parser = argparse.ArgumentParser(prog="make near", description="Run the tests nearest to changed files.")
    parser.add_argument("file", nargs="+", help="a file of the project, as observer/model/couple.py")
    parser.add_argument("--pytest", default="", help="further arguments to pytest")
    options = parser.parse_args(arguments)
    tests: dict[str, None] = {}
    for file in options.file:
        of_file = nearest(file) if (ROOT / file).is_file() else ()
        if not of_file:
            reason = "no test imports it" if (ROOT / file).is_file() else "there is no such file"
            print(
                f"{file}: {reason}; give a file of the project, as observer/model/couple.py", file=sys.stderr
            )
            return 2
        tests |= dict.fromkeys(of_file)
    print("\n".join(tests))
    command = [
        sys.executable,
        "-m",
        "pytest",
        "-q",
        "-n",
        "2",
        "-p",
        "no:benchmark",
        "-m",
        "not system and not slow",
    ]
    return subprocess.call([*command, *options.pytest.split(), *tests], cwd=ROOT)


if __name__ == "__main__":
    sys.exit(main())
