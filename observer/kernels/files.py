"""The sources of the compiled kernels; `setup.py` reads this file as text."""

from __future__ import annotations

import hashlib
from pathlib import Path

APART = {"__init__.py", "files.py", "layout.py", "libc.py"}
"""Files that are not compiled."""


def digest(folder: Path) -> str:
    """Return the digest of a folder's kernel files, which the compiled ones keep of theirs."""
    whole = hashlib.sha256()
    for path in sorted(folder.glob("*.p*")):
        if path.suffix in (".py", ".pxd") and path.name not in APART:
            whole.update(path.read_bytes())
    return whole.hexdigest()
