"""A state file is restored as it was saved, or its owner starts cold and the log says why."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any

import pytest
from structlog.testing import capture_logs

from observer.files.state import StateFile, StateWriter, save_state
from tests.patience import PATIENCE_S


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
    file.save({"heat_W": 12.5})
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
        file.save({})
    assert "cannot be written" in logs[0]["reason"]
    assert "free space or repair it" in logs[0]["reason"]


def test_the_last_of_several_contents_is_in_the_file(tmp_path: Path) -> None:
    may_end, writer = threading.Event(), StateWriter(tmp_path / "state")

    def slow() -> bytes:
        may_end.wait(PATIENCE_S)
        return b"first"

    writer.replace(slow)
    assert not writer.wait()
    writer.replace(lambda: b"second")
    may_end.set()
    assert writer.wait(PATIENCE_S)
    assert (tmp_path / "state").read_bytes() == b"second"
    assert writer.problem is None


def test_a_defect_is_a_problem_until_a_content_is_written(tmp_path: Path) -> None:
    writer = StateWriter(tmp_path / "state")
    with capture_logs() as logs:
        for _ in range(2):
            writer.replace(lambda: bytes(1 // 0))
            assert writer.wait(PATIENCE_S)
    assert [entry["event"] for entry in logs] == ["state not saved"], "it is logged once"
    assert isinstance(logs[0]["exc_info"], ZeroDivisionError)
    assert "report this" in str(writer.problem)
    writer.replace(lambda: b"")
    assert writer.wait(PATIENCE_S)
    assert writer.problem is None
