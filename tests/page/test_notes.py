"""Notes: kept beside the recordings, read back, and refused in words."""

from __future__ import annotations

import json

import pytest

from observer.page.notes import MOST_TEXT, Notes


def test_a_note_is_there_after_a_restart_in_the_order_of_its_time(tmp_path):
    Notes(tmp_path, "lathe-z").add("200.5", "new  grease\n", "anna")
    Notes(tmp_path, "lathe-z").add("100", '=cmd|"<b>"', "ben")
    notes_found = Notes(tmp_path, "lathe-z").listed()
    assert notes_found == [
        {"time_s": 100.0, "text": '=cmd|"<b>"', "by": "ben"},
        {"time_s": 200.5, "text": "new grease", "by": "anna"},
    ]
    assert Notes(tmp_path, "lathe-z2").listed() == []


def test_a_damaged_line_takes_no_other_with_it(tmp_path):
    notes = Notes(tmp_path, "lathe-z")
    notes.add("1", "first", "anna")
    (file,) = tmp_path.iterdir()
    with file.open("ab") as more:
        more.write(b'\xff\n{"time_s": NaN, "text": "", "by": ""}\n[1]\n{"time_s": 2, "te')
    notes.add("3", "third", "anna")
    assert [note["text"] for note in notes.listed()] == ["first", "third"]
    assert json.loads(file.read_bytes().splitlines()[-1])["time_s"] == 3.0


@pytest.mark.parametrize(
    ("time_s", "text", "said"),
    [
        ("nan", "a", "needs a time"),
        ("1e300", "a", "needs a time"),
        ("", "a", "needs a time"),
        ("1", " \n", "needs a text of"),
        ("1", "a" * (MOST_TEXT + 1), "needs a text of"),
        ("1", "a\x00b", "needs a text of"),
        ("1", "right to left \u202e", "needs a text of"),
    ],
)
def test_an_invalid_note_is_rejected(tmp_path, time_s, text, said):
    with pytest.raises(ValueError, match=said):
        Notes(tmp_path, "lathe-z").add(time_s, text, "anna")
    assert list(tmp_path.iterdir()) == []


def test_without_a_folder_that_can_be_written_nothing_is_promised(tmp_path):
    with pytest.raises(ValueError, match="record\\.directory"):
        Notes(None, "lathe-z").add("1", "a", "anna")
    with pytest.raises(ValueError, match="cannot be written"):
        Notes(tmp_path / "none", "lathe-z").add("1", "a", "anna")
    assert Notes(None, "lathe-z").listed() == Notes(tmp_path / "none", "lathe-z").listed() == []
