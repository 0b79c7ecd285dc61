"""A state file is restored as it was saved, or its owner starts cold and the log says why."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from structlog.testing import capture_logs

from observer.files.state import StateFile, save_state


@pytest.fixture
def file(tmp_path: Path) -> StateFile:
    return StateFile(tmp_path / "folder" / "state.json", "usual heats", version=2)


def restored(file: StateFile, key: str = "heat_W") -> tuple[list[Any], list[Any]]:
    """What `take` got, and what was logged."""
    taken: list[Any] = []
    with capture_logs() as logs:
        file.restore(lambda document: taken.append(document[key]))
    return taken, logs  # type: ignore[return-value]


def test_a_saved_document_is_restored(file: StateFile) -> None:
    assert restored(file) == ([], [])
    file.save(file.encoded({"heat_W": 12.5}))
    assert restored(file) == ([12.5], [])


@pytest.mark.parametrize(
    "damaged", [b"", b"[]", b"\xff", b"{", b'{"format": 1, "heat_W": 1}', b'{"format": 2}', b"[" * 100_000]
)
def test_a_damaged_file_is_reported_and_nothing_is_restored(file: StateFile, damaged: bytes) -> None:
    assert save_state(file.path, damaged) is None
    taken, (entry,) = restored(file)
    assert taken == []
    assert entry["event"] == "usual heats: no state restored"
    assert str(file.path) in entry["reason"]
    assert "starts anew" in entry["reason"]


def test_a_state_that_cannot_be_saved_is_reported_with_the_remedy(file: StateFile, tmp_path: Path) -> None:
    (tmp_path / "folder").write_text("a file where the folder should be")
    with capture_logs() as logs:
        file.save(b"{}")
    assert "cannot be written" in logs[0]["reason"]
    assert "free space or repair it" in logs[0]["reason"]
