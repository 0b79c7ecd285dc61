"""The reader of console blocks itself."""

from pathlib import Path

import pytest

from tests.docs.console import Command, bounded, commands, matches


def test_reads_commands_continuations_and_output(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# Page\n\n```console\n$ echo a \\\n    b\na b\n$ true\n```\n\n```text\n$ never\n```\n")
    assert commands(page) == [Command("page.md", 4, "echo a b", "a b"), Command("page.md", 7, "true", "")]


def test_refuses_a_block_without_a_prompt(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("```console\nobserver check\n```\n")
    with pytest.raises(ValueError, match=r"page\.md:2"):
        commands(page)


@pytest.mark.parametrize(
    ("expected", "printed", "same"),
    [
        ("modes 7", "modes 7\n", True),
        ("modes 7", "modes 8\n", False),
        ("modes …", "modes 8\n", True),
        ("first\n…\nlast", "first\na\nb\nlast\n", True),
        ("first\n…\nlast", "first\na\nb\n", False),
        ("first", "first\nsecond\n", False),
    ],
)
def test_compares_output_with_ellipses(expected: str, printed: str, same: bool) -> None:
    assert matches(expected, printed) is same


@pytest.mark.parametrize(
    ("text", "ends"),
    [
        ("observer run --config c.toml", False),
        ("timeout 5 observer run --config c.toml", True),
        ("observer demo --seconds 3", True),
        ("observer check --config c.toml", True),
    ],
)
def test_knows_what_runs_for_ever(text: str, ends: bool) -> None:
    assert bounded(Command("page.md", 1, text, "")) is ends
