"""Which program a campaign measured, and a banner where its code has changed since: `make evidence`.

`docs/runs.json` has an entry for each table of results: date, version and commit of its first row, and a
digest of each folder of code that the results depend on. A page shows it under a line
`<!-- run: docs/…/results.csv -->`.
"""

from __future__ import annotations

import datetime
import hashlib
import json
import re
import subprocess
from importlib.metadata import version
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
RUNS = ROOT / "docs" / "runs.json"
MARK = re.compile(r"(<!-- run: (\S+) -->\n)(?:\nRun on [^\n]*\n)?")
CODE = (".py", ".pxd")


def entries(file: Path = RUNS) -> dict[str, dict[str, Any]]:
    """Return date, version, commit and code of each table, by the table's path from the root."""
    content: dict[str, dict[str, Any]] = json.loads(file.read_text(encoding="utf-8"))
    return content


def digest(folder: str) -> str:
    """Return twelve hexadecimal digits that change with any source file of a folder of the project."""
    state = hashlib.sha256()
    for path in sorted(p for p in (ROOT / folder).rglob("*") if p.suffix in CODE):
        state.update(str(path.relative_to(ROOT)).encode() + b"\0" + path.read_bytes() + b"\0")
    return state.hexdigest()[:12]


def note_run(table: Path, file: Path = RUNS) -> None:
    """Write down that the present program begins a table of results; tables without an entry are ignored."""
    known, path = entries(file), table.resolve()
    name = path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) else ""
    if name not in known:
        return
    commit = subprocess.run(
        ["git", "rev-parse", "--short=8", "HEAD"], cwd=ROOT, check=True, capture_output=True, text=True
    ).stdout.strip()
    today = datetime.datetime.now(datetime.UTC).date().isoformat()
    code = {folder: digest(folder) for folder in known[name]["code"]}
    known[name] = {"date": today, "version": version("ballscrew-observer"), "commit": commit, "code": code}
    file.write_text(json.dumps(known, indent=2) + "\n", encoding="utf-8")


def caption(entry: dict[str, Any]) -> str:
    """Return the sentence about a run, with a warning if its code has changed since."""
    run = f"Run on {entry['date']} with version {entry['version']}, commit `{entry['commit']}`."
    changed = any(digest(folder) != before for folder, before in entry["code"].items())
    folders = ", ".join(f"`{folder}`" for folder in entry["code"])
    return f"{run} **Its code has changed since** ({folders})." if changed else run


def with_captions(page: str) -> str:
    """Return a page with the present sentence under each of its marks."""
    known = entries()
    return MARK.sub(lambda mark: f"{mark[1]}\n{caption(known[mark[2]])}\n", page)


def main() -> None:
    """Write the sentences into all pages."""
    for path in sorted((ROOT / "docs").rglob("*.md")):
        page = path.read_text(encoding="utf-8")
        if (captioned := with_captions(page)) != page:
            path.write_text(captioned, encoding="utf-8")
            print(path.relative_to(ROOT))


if __name__ == "__main__":
    main()
