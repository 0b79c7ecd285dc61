"""Certificates of OPC UA's applications, made by the command that the page on plants shows."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

from tests.docs.console import blocks

PAGE = Path(__file__).parents[2] / "docs" / "how-to" / "plant.md"


def made_as_on_the_page(folder: Path) -> None:
    """Do in a folder what the page has its reader do: opcua.pem, opcua.key and opcua-users."""
    _run(folder, _script())


def application(folder: Path, name: str) -> tuple[Path, Path]:
    """Certificate and key of another application, `urn:NAME`, by the same command."""
    command = _script().split("\n(umask")[0]
    command = re.sub(r"URI:[^,\"]+", f"URI:urn:{name}", command).replace("opcua.", f"{name}.")
    _run(folder, command)
    (folder / f"{name}.key").chmod(0o600)
    return folder / f"{name}.pem", folder / f"{name}.key"


def _script() -> str:
    (script,) = [body for _, language, body in blocks(PAGE) if language == "sh"]
    return script


def _run(folder: Path, script: str) -> None:
    subprocess.run(["sh", "-ec", script], cwd=folder, check=True, capture_output=True)
