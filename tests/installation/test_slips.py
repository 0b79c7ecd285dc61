"""A slip in a configuration is reported with its line, what is wrong with it, and how to write it."""

from __future__ import annotations

import tomllib

import pytest

from observer.errors import UserError
from observer.installation.examine import examine
from observer.installation.first_configuration import answers
from observer.installation.first_template import filled
from observer.report.check import doubts

MODULE = """
[drivers.module]
kind = "modbus_tcp"
host = "127.0.0.1"
port = 5020

[drivers.module.channels.t1_degC]
register = 0
function = "input"
type = "float32"
fault_codes = { 0x7FFF = "open_circuit" }
"""
GIVEN = {
    "machine": "vmc-3",
    "length_m": "1.1",
    "stroke_m": "150 850 mm",
    "sensors_m": "300 mm",
    "module_at": "h",
    "ambient": "21",
}


def configuration() -> str:
    """The text of a good configuration, with a module by its registers."""
    head, _, below = filled(answers(GIVEN, None)).partition("[drivers.thermocouples]")
    return f"{head}{below[below.index('[publish]') :]}{MODULE}"


def complaint(tmp_path, written: str, slip: str) -> str:
    """What is said about a configuration with a slip in place of what is written."""
    text = configuration()
    assert written in text
    path = tmp_path / "slip.toml"
    path.write_text(text.replace(written, slip, 1), encoding="utf-8")
    with pytest.raises(UserError) as refused:
        examine(path)
    return str(refused.value)


def test_the_configuration_without_a_slip_is_good(tmp_path):
    path = tmp_path / "good.toml"
    path.write_text(configuration(), encoding="utf-8")
    assert [words for words in doubts(examine(path)) if "register" in words] == []


DIAMETER, LENGTH, STROKE = "diameter_m = 0.0349", "length_m = 1.1", "stroke_m = [0.15, 0.85]"
NAME, FOLDER, FUNCTION = 'name = "vmc-3"', 'directory = "recordings"', 'function = "input"'


@pytest.mark.parametrize(
    ("written", "slip", "repaired"),
    [
        (DIAMETER, "diameter_m = 0,0349", "decimal point, not a comma: write diameter_m = 0.0349"),
        (DIAMETER, "diameter_m = 34.9 mm", "the unit is in the key's name; write the number alone"),
        (DIAMETER, "diameter_m = 34,9 mm", "write diameter_m = 0.0349"),
        (DIAMETER, "diameter_m = .0349", "write diameter_m = 0.0349"),
        (DIAMETER, "diameter_m = 3,49·10^-2", "write diameter_m = 3.49e-2"),
        (NAME, 'name = "vmc-3', f"write {NAME}"),
        (NAME, 'name = vmc-3"', f"write {NAME}"),
        (NAME, "name = vmc-3", f"write {NAME}"),
        (NAME, "name = “vmc-3”", f"plain quotes, minus and blanks of the keyboard: write {NAME}"),
        (NAME, "name = „vmc-3“", f"write {NAME}"),
        (LENGTH, "length_m = 1.1,", f"a line ends without comma or semicolon: write {LENGTH}"),
        (LENGTH, "length_m = 1.1;", f"write {LENGTH}"),
        (LENGTH, "length_m: 1.1", f"a key and its value are joined by =: write {LENGTH}"),
        (LENGTH, "length_m == 1.1", f"write {LENGTH}"),
        (LENGTH, "length m = 1.1", f"a name has no blanks: write {LENGTH}"),
        (LENGTH, "length_m = 1.1 // between", "a comment begins with #"),
        (LENGTH, "length_m\u00a0= 1.1", f"write {LENGTH}"),
        (LENGTH, "length_m =", "the value behind = is missing"),
        (LENGTH, "length_m", "write a key, = and its value"),
        (LENGTH, "length_m = 1.1\nlength_m = 1.2", "length_m is given in line 9 already"),
        (STROKE, "stroke_m = (0.15, 0.85)", f"write {STROKE}"),
        (STROKE, "stroke_m = 0.15, 0.85", f"write {STROKE}"),
        (STROKE, "stroke_m = [0.15; 0.85]", f"write {STROKE}"),
        (STROKE, "stroke_m = [0.15, 0.85", f"write {STROKE}"),
        (STROKE, "stroke_m = [0,15, 0,85]", "with decimal points write [0.15, 0.85]"),
        (STROKE, "stroke_m = [0,05, 0,85]", "write stroke_m = [0.05, 0.85]"),
        ("[page]", "[page", "a table's name stands in square brackets: write [page]"),
        ("[page]", "[screw]\nlength_m = 1.0\n[page]", "line 8 has [screw] already"),
        ("[[sensor]]", '[sensor]\nname = "t0"\n[[sensor]]', "write [[sensor]] each time"),
        ("[[sensor]]", "[sensor]", "there may be several of this table; write [[sensor]]"),
        (FOLDER, 'directory = "C:\\Users\\rec"', 'write / in paths: write directory = "C:/Users/rec"'),
        (FOLDER, 'directory = "C:\\temp"', "by a backslash and the letter behind it; write /"),
        (FOLDER, "directory = /var/lib", 'write directory = "/var/lib"'),
        ("[page]", "[integrity]\nenabled = True\n[page]", "write enabled = true"),
        ("[page]", "[integrity]\nenabled = ja\n[page]", "write enabled = true"),
        ("[page]", '[integrity]\nenabled = "nein"\n[page]', "valid boolean, not 'nein'; write false"),
        ("register = 0", "register = 0064", "write register = 64"),
        ("register = 0", "register = 64h", "write register = 0x64"),
        ("register = 0", 'register = "64"', "not '64'; write 64"),
        ("register = 0", "register = 400101", 'write register = 100 and function = "holding"'),
        (FUNCTION, "function = 3", 'write "holding", which is function 3'),
        (FUNCTION, 'function = "04"', 'write "input", which is function 4'),
        ('type = "float32"', 'type = "REAL"', 'write "float32"'),
        (FUNCTION, f'{FUNCTION}\nbyte_order = "little"', 'word_order = "little", or byte_order = "CDAB"'),
        ('{ 0x7FFF = "open_circuit" }', '{\n0x7FFF = "open_circuit" }', "in braces stands in one line"),
        ('{ 0x7FFF = "open_circuit" }', "{ 0x7FFF = open_circuit }", "text stands in quotes, at both ends"),
        ("channels.t1_degC]", "channels.t1_°C]", 'write [drivers.module.channels."t1_°C"]'),
        ('host = "127.0.0.1"', "host = 127.0.0.1", 'write host = "127.0.0.1"'),
        ('host = "127.0.0.1"', 'host = "127.0.0.1:5020"', 'write "127.0.0.1", and port = 5020'),
        ("port = 5020", 'port = "5020"', "not '5020'; write 5020"),
    ],
)  # fmt: skip
def test_a_slip_is_named_with_its_line_and_its_repair(written, slip, repaired, tmp_path):
    found = complaint(tmp_path, written, slip)
    assert repaired in found
    assert "\n" not in found


def test_a_proposed_line_is_one_that_the_parser_accepts(tmp_path):
    found = complaint(tmp_path, DIAMETER, "diameter_m = 0,0349 m   # look")
    proposed = found.rpartition("write ")[2]
    assert tomllib.loads(proposed) == {"diameter_m": 0.0349}


@pytest.mark.parametrize(
    ("number", "register", "function"),
    [(40001, 0, "holding"), (30101, 100, "input"), (49999, 9998, "holding")],
)
def test_a_registers_number_of_a_manual_is_doubted_with_the_one_on_the_wire(
    number, register, function, tmp_path
):
    path = tmp_path / "manual.toml"
    path.write_text(configuration().replace("register = 0", f"register = {number}"), encoding="utf-8")
    (words,) = [words for words in doubts(examine(path)) if "register" in words]
    assert f"drivers.module.channels.t1_degC.register = {number}" in words
    assert f'write register = {register} and function = "{function}"' in words


def test_a_file_that_an_editor_marked_as_utf8_is_read(tmp_path):
    path = tmp_path / "marked.toml"
    path.write_text(configuration(), encoding="utf-8-sig")
    examine(path)


def test_a_file_in_another_encoding_is_refused_with_its_line(tmp_path):
    path = tmp_path / "ansi.toml"
    path.write_bytes(
        configuration().replace('name = "vmc-3"', 'name = "vmc-3"  # Fräse', 1).encode("latin-1", "replace")
    )
    with pytest.raises(UserError, match=r"ansi.toml: line 5 .* save it as UTF-8"):
        examine(path)
