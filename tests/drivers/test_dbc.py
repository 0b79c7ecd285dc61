"""DBC files with faults: what is used is read, and a fault in it is named with its line."""

from __future__ import annotations

from pathlib import Path

import can
import pytest

from drivers.can import CanSettings
from drivers.dbc import dbc_problems, load_decoder

UNDEFINED = Path("tests/data/can/attribute-without-definition.dbc")
TEXT = UNDEFINED.read_text()
SIGNAL = ' SG_ T : 0|16@1- (0.1,0) [-50|200] "degC" A'
FRAME = can.Message(arbitration_id=256, is_extended_id=False, data=bytes.fromhex("E600000000000000"))


@pytest.fixture
def signals(tmp_path):
    def write(text):
        path = tmp_path / "rig.dbc"
        path.write_text(text)
        place = {"message": "Good", "signal": "T"}
        table = CanSettings(
            kind="can", interface="virtual", channel="x", dbc=path, channels={"t_degC": place}
        )
        return table.signals("rig")

    return write


@pytest.mark.parametrize(
    "addition",
    [
        "",
        'BO_ 257 Other: 8 A\n SG_ X : 0|99@1- (0.1,0) [-50|200] "degC" A\n',
        'BO_ 257 Other: 8 A\n SG_ X : 0|16@9 (0.1,0 [-50|200] "degC" A\n',
        'BO_ 257 Other: 8 A\n SG_ X : 0|16@1- (0.1,0) [-50|200] "deg\n',
        "BO_ 257 Other: 4000000000 A\n",
        'CM_ BO_ 257 "never closed;\n',
        "VAL_ 257 X zero 1;\n",
    ],
)
def test_a_fault_outside_the_used_messages_does_not_matter(signals, addition):
    values, faults = load_decoder(signals(TEXT + addition))(FRAME)
    assert values == {"t_degC": pytest.approx(23.0)}
    assert faults == {}


def test_the_kind_of_number_is_read_beside_a_fault_elsewhere(signals):
    text = TEXT.replace("0|16@1-", "0|32@1-").replace("(0.1,0)", "(1,0)") + "SIG_VALTYPE_ 256 T : 1;\n"
    frame = can.Message(arbitration_id=256, is_extended_id=False, data=bytes.fromhex("0000BC4100000000"))
    assert load_decoder(signals(text))(frame) == ({"t_degC": 23.5}, {})


@pytest.mark.parametrize(
    ("text", "line", "cause"),
    [
        (TEXT.replace("(0.1,0)", "(0.1,)"), 6, "Invalid syntax"),
        (TEXT.replace("0|16@1", "60|16@1"), 6, "does not fit in message Good"),
        (
            TEXT.replace(SIGNAL, SIGNAL + "\n" + SIGNAL.replace("T", "U").replace("0|", "8|")),
            7,
            "overlapping",
        ),
        (TEXT.replace("Good: 8 A", "Good: 4000000000 A"), 5, "larger than 1785 bytes"),
        (TEXT.replace("0|16@1", "4000000000|16@1"), 6, "larger than 1785 bytes"),
        (TEXT.replace("0|16@1", "0|4000000000@1"), 6, "larger than 1785 bytes"),
        (TEXT + "SIG_VALTYPE 256 T : 1;\n", 8, "SIG_VALTYPE 256"),
        (TEXT + "SIG_VALTYPE_ x256 T : 1;\n", 8, "Invalid syntax"),
    ],
)
def test_a_fault_in_a_used_message_is_named_with_line_and_cause(signals, text, line, cause):
    (problem,) = dbc_problems(signals(text))
    assert f"rig.dbc: line {line} cannot be read" in problem
    assert cause in problem
    assert problem.endswith("correct this line")
    assert "export" not in problem


def test_all_messages_are_offered_where_one_is_misspelt(signals):
    (problem,) = dbc_problems(signals(TEXT.replace("Good", "Goof")))
    assert problem.endswith('no message "Good"; the file has Goof')
