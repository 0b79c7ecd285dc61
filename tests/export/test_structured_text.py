"""The exported structured text parses, and its tree run by an interpreter does what the reference does."""

from __future__ import annotations

from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from observer.errors import ConfigError
from observer.export.data import observer_form
from observer.export.form import Form
from observer.export.structured_text import structured_text
from observer.export.write import twincat_file, write_st
from tests.export.made import apart, by_python, faulty, nut_machine
from tests.export.st_interpreter import Block, parsed
from tests.logs.machines import machine, table


def by_text(form: Form, text: str, inputs: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    block, rows = Block(text), []
    labels = next(slot.labels for slot in form.slots if slot.name == "reading")
    names = {slot.name.lower(): slot.name for slot in form.of("output")}
    for row in inputs:
        given = dict(zip(labels, row["reading"], strict=True))
        given |= {f"{name}_fresh": value for name, value in zip(labels, row["fresh"], strict=True)}
        given |= {name: value for name, value in row.items() if name not in ("reading", "fresh")}
        found = block.step(given)
        rows.append({names[name]: np.array(value, float) for name, value in found.items()})
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


@pytest.mark.parametrize("make", [machine, nut_machine])
def test_the_text_is_equal_to_python(make: Any) -> None:
    form = observer_form(make())
    inputs = faulty(form, 1500)
    assert not apart(by_python(form, inputs), by_text(form, structured_text(form), inputs))


@pytest.mark.parametrize("real", ["LREAL", "REAL"])
def test_it_parses_without_an_error(real: str) -> None:
    text = structured_text(observer_form(nut_machine()), real)
    assert not parsed(text).has_error
    assert parsed(text.replace("END_FOR", "END_FORR", 1)).has_error, "the grammar would notice"
    assert ("LREAL" in text) == (real == "LREAL")


def test_lines_are_short_enough_for_any_editor() -> None:
    text = structured_text(observer_form(nut_machine()))
    assert max(map(len, text.splitlines())) <= 200
    assert text.isascii()


@pytest.mark.parametrize("make", [machine, nut_machine])
def test_the_file_for_twincat_holds_the_same_declaration_and_body(make: Any, tmp_path: Path) -> None:
    names = write_st(observer_form(make()), tmp_path)
    assert names == ["FB_BallscrewObserver.st", "FB_BallscrewObserver.TcPOU", "README.md"]
    block = ElementTree.parse(tmp_path / names[1]).getroot().find("POU")
    assert block is not None
    assert block.get("Name") == "FB_BallscrewObserver"
    declaration, body = block.findtext("Declaration", ""), block.findtext("Implementation/ST", "")
    assert f"{declaration}{body}END_FUNCTION_BLOCK\n" == (tmp_path / names[0]).read_text()
    assert declaration.endswith("END_VAR\n")
    assert "END_VAR" not in body


def test_a_bracket_that_would_end_the_xml_text_survives() -> None:
    text = "FUNCTION_BLOCK b\nVAR\nEND_VAR\nx := a[b[1]]>2;\nEND_FUNCTION_BLOCK\n"
    [body] = ElementTree.fromstring(twincat_file("b", text)).iter("ST")
    assert body.text == "x := a[b[1]]>2;\n"


def test_a_name_that_the_block_needs_is_rejected() -> None:
    sensors = table()["sensor"]
    sensors[0]["channel"] = "quality"
    with pytest.raises(ConfigError, match="rename the channel"):
        structured_text(observer_form(machine(sensor=sensors)))
