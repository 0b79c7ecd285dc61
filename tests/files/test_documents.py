"""Results as JSON that people read, too."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from observer.errors import UserError
from observer.files.documents import result_text, write_json


def test_micrometres_are_readable_in_a_result(tmp_path: Path) -> None:
    write_json(tmp_path / "result.json", {"text": "44 µm at 20 °C"})
    assert "44 µm at 20 °C" in (tmp_path / "result.json").read_text(encoding="utf-8")


def test_characters_that_command_a_terminal_are_escapes_and_come_back() -> None:
    document = {"name": "a\x1b[2J\u202eb\U000e0041", "lines": "one\ntwo"}
    text = result_text(document)
    assert all(bad not in text for bad in "\x1b\u202e\U000e0041")
    assert json.loads(text) == document


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_a_number_that_is_not_finite_is_named_by_its_place(value: float) -> None:
    with pytest.raises(UserError, match=r"gap\.per_sensor\[1\] in the result is not a finite number; check"):
        result_text({"gap": {"per_sensor": [1.0, value]}})
