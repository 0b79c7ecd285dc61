"""The questions of `observer init`: what is not given as an option is asked, or takes its usual value."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from observer.errors import UserError
from observer.installation.init.answers import Answers
from observer.installation.init.screws import SCREWS, STEELS
from observer.installation.init.wires import CONTROLS, MODULES

Ask = Callable[[str, str | None], str]
"""Puts a question with its usual answer, and returns what was typed."""


@dataclass(frozen=True, slots=True)
class Question:
    """One answer: the field of `Answers`, the words, how it is read, its usual value, and when it is put."""

    name: str
    words: str
    read: Callable[[str], Any]
    usual: str | None = None
    of: tuple[str, ...] = ()
    """The controls that it belongs to; of none, it is always put."""

    @property
    def option(self) -> str:
        """The option that answers it."""
        return f"--{self.name.replace('_', '-')}"


def one_of(names: Mapping[str, object]) -> Callable[[str], str]:
    """Reads one of a few names."""

    def read(given: str) -> str:
        if given not in names:
            raise ValueError(f"{given!r} is not known; give one of {', '.join(names)}")
        return given

    return read


def metres(given: str) -> tuple[float, ...]:
    """Read lengths parted by commas or blanks."""
    try:
        return tuple(float(part) for part in given.replace(",", " ").split())
    except ValueError:
        raise ValueError(f"{given!r} are no lengths in metres; write them as 0.05,0.5,0.95") from None


def stroke(given: str) -> tuple[float, float]:
    """Read two lengths, the smaller first."""
    ends = metres(given)
    if len(ends) != 2 or not ends[0] < ends[1]:
        raise ValueError(f"{given!r} is no stroke; write both ends in metres, the smaller first: 0.15,0.80")
    return ends[0], ends[1]


def number(given: str) -> float:
    """Read a number other than 0."""
    try:
        value = float(given)
    except ValueError:
        raise ValueError(f"{given!r} is no number; mend it") from None
    if not 1e-9 < abs(value) < 1e15:
        raise ValueError(f"{given!r} is out of range; mend it")
    return value


def whole(given: str) -> int:
    """Read a whole number, also as 0x1F4."""
    try:
        return int(given[:12], 0)
    except ValueError:
        raise ValueError(f"{given!r} is no whole number; mend it") from None


def perhaps(given: str) -> int | None:
    """Read a whole number, or none."""
    return whole(given) if given else None


_MODULES = "; ".join(f"{name}: {module.called}" for name, module in MODULES.items())
_CONTROLS = "; ".join(f"{name}: {control.called}" for name, control in CONTROLS.items())
_NAMED = ("can", "opcua", "mtconnect")
_SIGNALS = "can: AxisStatus.NutPosition; opcua: a node, ns=2;s=X.Position; mtconnect: a data item, Xpos"

QUESTIONS = (
    Question("machine", "Name of the machine", str, "machine"),
    Question("axis", "Its axis", str, "x"),
    Question("screw", f"Screw, diameter x lead in mm ({', '.join(SCREWS)})", one_of(SCREWS), "40x10"),
    Question("steel", f"Its steel ({', '.join(STEELS)})", one_of(STEELS), "bearing"),
    Question("length_m", "Length between the bearings, m", number),
    Question("stroke_m", "Stroke of the nut's middle from the left bearing, m (as 0.15,0.80)", stroke),
    Question("sensors_m", "Places of the thermocouples from there, m (as 0.05,0.5,0.95)", metres),
    Question("module", f"Module that reads them ({_MODULES})", one_of(MODULES), "wago_750_458"),
    Question("module_at", "Where it is (192.168.0.20, /dev/ttyUSB0 or can0)", str),
    Question("ambient", "Air: °C, or input for the module's next input", str, "input"),
    Question("control", f"Where the position comes from ({_CONTROLS})", one_of(CONTROLS), "none"),
    Question(
        "control_at",
        "Where that is (192.168.0.21, can0, /dev/ttyACM0, opc.tcp://192.168.0.21:4840, http://192.168.0.21:5000)",
        str,
        of=("canopen", "modbus", "can", "opcua", "mtconnect"),
    ),
    Question("node_id", "The drive's CANopen node", whole, of=("canopen",)),
    Question("counts_per_m", "Its counts per metre of nut travel", number, of=("canopen", "modbus")),
    Question(
        "position_register", "First register of the position, from 0 (40001 is 0)", whole, "0", of=("modbus",)
    ),
    Question("speed_register", "Register of the speed in rpm, if there is one", perhaps, "", of=("modbus",)),
    Question("dbc", "DBC file", str, of=("can",)),
    Question("position_signal", f"What tells the position ({_SIGNALS})", str, of=_NAMED),
    Question("speed_signal", "What tells the screw's speed in rpm, if anything does", str, "", of=_NAMED),
)
"""In the order in which they are put."""


def agreed(given: Mapping[str, str | None], ask: Ask | None, check: Callable[[Answers], object]) -> Answers:
    """Fill in what was not given, until all fits together: whoever is asked may mend what he has said.

    Raises the `UserError` of `check` with nobody to ask, or where the same is said again; else as `answers`.
    """
    said: dict[str, str] = {}
    trouble = ""

    def once_more(words: str, usual: str | None) -> str:
        nonlocal trouble
        words, trouble = trouble + words, ""
        assert ask is not None
        return ask(words, usual)

    while True:
        before = dict(said)
        try:
            check(found := answers(given, None if ask is None else once_more, said))
        except UserError as error:
            if ask is None or said == before:
                raise
            trouble = f"{error}\nOnce more; Enter keeps what you have said.\n"
        else:
            return found


def answers(given: Mapping[str, str | None], ask: Ask | None, said: dict[str, str] | None = None) -> Answers:
    """Fill in what was not given: by asking, or, with nobody to ask, by what is usual.

    What was `said` before is offered in place of what is usual, and what is said now is put there. Raises
    `UserError` for an answer that will not do, and, with nobody to ask, for one that is missing.
    """
    said = {} if said is None else said
    found: dict[str, Any] = {}
    missing = []
    for question in QUESTIONS:
        told = given.get(question.name)
        if question.of and found.get("control") not in question.of:
            if told is not None:
                raise UserError(
                    f"{question.option}: belongs to --control {' or '.join(question.of)}, not to "
                    f"{found.get('control')}; leave it out"
                )
            continue
        if told is None and ask is not None:
            found[question.name] = _asked(question, ask, said)
            continue
        if told is None and question.usual is None:
            missing.append(question.option)
            continue
        found[question.name] = _read(question, question.usual or "" if told is None else told)
    if missing:
        raise UserError(f"init: there is nobody to ask here; give {', '.join(missing)}")
    return Answers(**found)


def _read(question: Question, told: str) -> Any:
    try:
        return question.read(told)
    except ValueError as error:
        raise UserError(f"{question.option}: {error}") from None


def _asked(question: Question, ask: Ask, said: dict[str, str]) -> Any:
    """Put a question until the answer will do."""
    words, usual = question.words, said.get(question.name, question.usual)
    while True:
        typed = ask(words, usual).strip()
        try:
            value = question.read(typed)
        except ValueError as error:
            words = f"{error}\n{question.words}"
        else:
            said[question.name] = typed
            return value
