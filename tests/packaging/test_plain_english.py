"""The check of names and sentences that `make lint` runs finds what it should, and nothing else."""

from __future__ import annotations

import ast

import pytest

from tests.plain_english import docstrings, named, problems, sentences


@pytest.mark.parametrize(
    "sentence",
    [
        "What has left the last hour is shown from the recordings.",
        "Of the errors, half is the film's.",
        "A drift by what nobody asked for.",
        "The answer is none.",
        "The key says it.",
        "word " * 31,
    ],
)
def test_a_sentence_that_needs_a_second_reading_is_found(sentence):
    assert list(problems(sentence.strip()))


@pytest.mark.parametrize(
    "sentence",
    [
        "Older data come from the recordings.",
        "Half of the error comes from the film coefficient.",
        "What is the air temperature?",
        "word " * 30,
    ],
)
def test_a_plain_sentence_is_not(sentence):
    assert not list(problems(sentence.strip()))


def test_only_prose_is_read_and_each_item_of_a_list_by_itself():
    page = (
        "# Of a title\n\nOne. Two\ngoes on.\n- Three\n- Four of\n  `code`.\n\n| of |\n```\nWhat runs\n```\n"
    )
    assert [text for _, text in sentences(page)] == ["One.", "Two goes on.", "Three", "Four of code."]
    assert [line for line, _ in sentences(page)] == [2, 2, 4, 5]


def test_every_name_that_a_file_defines_is_read():
    tree = ast.parse('class A:\n    """Text."""\n    def b(self, c):\n        d = e = 1\n        return f\n')
    assert [name for _, name in named(tree)] == ["A", "b", "self", "c", "d", "e"]
    assert list(docstrings(tree)) == [(2, "Text.")]
