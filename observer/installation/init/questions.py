"""The questions of `observer init`: an answer comes from an option, from the terminal, or by default."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from observer.errors import UserError
from observer.installation.init.catalogue import CONTROLS, MODULES, SCREWS, STEELS


@dataclass(frozen=True, slots=True)
class Answers:
    """One machine's answers; lengths count from the screw's left end.

    `ambient` is a temperature in °C, or `"input"`: the module's next input after the sensors.
    """

    machine: str
    axis: str
    screw: str
    steel: str
    length_m: float
    stroke_m: tuple[float, float]
    sensors_m: tuple[float, ...]
    module: str
    module_at: str
    ambient: str
    control: str
    control_at: str = ""
    counts_per_m: float | None = None
    node_id: int | None = None
    position_register: int | None = None
    speed_register: int | None = None
    dbc: str = ""
    position_signal: str = ""
    speed_signal: str = ""


Ask = Callable[[str, str | None], str]
"""Asks a question with its default and returns what was typed."""


@dataclass(frozen=True, slots=True)
class Question:
    """One field of `Answers`: its prompt, how the answer is parsed, its default, and when it is asked."""

    name: str
    prompt: str
    parse: Callable[[str], Any]
    default: str | None = None
    of: tuple[str, ...] = ()
    """The controls it is asked for; empty for all."""

    @property
    def option(self) -> str:
        """The command-line option for it."""
        return f"--{self.name.replace('_', '-')}"


def one_of(names: Mapping[str, object]) -> Callable[[str], str]:
    """A parser of one of a few names."""

    def read(given: str) -> str:
        if given not in names:
            raise ValueError(f"{given!r} is not known; give one of {', '.join(names)}")
        return given

    return read


def metres(given: str) -> tuple[float, ...]:
    """Parse lengths separated by commas or blanks."""
    try:
        return tuple(float(part) for part in given.replace(",", " ").split())
    except ValueError:
        raise ValueError(f"{given!r} are not lengths in metres; write them as 0.05,0.5,0.95") from None


def stroke(given: str) -> tuple[float, float]:
    """Read two lengths, the smaller first."""
    ends = metres(given)
    if len(ends) != 2 or not ends[0] < ends[1]:
        raise ValueError(
            f"{given!r} is not a stroke; write both ends in metres, the smaller first: 0.15,0.80"
        )
    return ends[0], ends[1]


def number(given: str) -> float:
    """Read a number other than 0."""
    try:
        value = float(given)
    except ValueError:
        raise ValueError(f"{given!r} is not a number") from None
    if not 1e-9 < abs(value) < 1e15:
        raise ValueError(f"{given!r} is out of range")
    return value


def whole(given: str) -> int:
    """Read a whole number, also as 0x1F4."""
    try:
        return int(given[:12], 0)
    except ValueError:
        raise ValueError(f"{given!r} is not a whole number") from None


def perhaps(given: str) -> int | None:
    """Read a whole number, or none."""
    return whole(given) if given else None


_MODULES = "; ".join(f"{name}: {module.title}" for name, module in MODULES.items())
_CONTROLS = "; ".join(f"{name}: {control}" for name, control in CONTROLS.items())
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
    Question("module_at", "Its address (192.168.0.20, /dev/ttyUSB0 or can0)", str),
    Question("ambient", "Air: °C, or input for the module's next input", str, "input"),
    Question("control", f"Where the position comes from ({_CONTROLS})", one_of(CONTROLS), "none"),
    Question(
        "control_at",
        "Its address (192.168.0.21, can0, /dev/ttyACM0, opc.tcp://192.168.0.21:4840, http://192.168.0.21:5000)",
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
    Question("position_signal", f"Signal of the position ({_SIGNALS})", str, of=_NAMED),
    Question("speed_signal", "Signal of the screw's speed in rpm, if there is one", str, "", of=_NAMED),
)
"""In the order in which they are asked."""


def agreed(given: Mapping[str, str | None], ask: Ask | None, check: Callable[[Answers], object]) -> Answers:
    """Complete the answers until they fit together; whoever is asked may correct them.

    Raises the `UserError` of `check` if nobody can be asked or the answers are unchanged; else as `answers`.
    """
    said: dict[str, str] = {}
    trouble = ""

    def once_more(prompt: str, default: str | None) -> str:
        nonlocal trouble
        prompt, trouble = trouble + prompt, ""
        assert ask is not None
        return ask(prompt, default)

    while True:
        before = dict(said)
        try:
            check(found := answers(given, None if ask is None else once_more, said))
        except UserError as error:
            if ask is None or said == before:
                raise
            trouble = f"{error}\nOnce more; Enter keeps your answer.\n"
        else:
            return found


def answers(given: Mapping[str, str | None], ask: Ask | None, said: dict[str, str] | None = None) -> Answers:
    """Complete what was not given by asking or, if nobody can be asked, by defaults.

    Earlier answers in `said` are offered as defaults and updated. Raises `UserError` for an invalid answer
    and, if nobody can be asked, for a missing one.
    """
    said = {} if said is None else said
    found: dict[str, Any] = {}
    missing = []
    for question in QUESTIONS:
        option = given.get(question.name)
        if question.of and found.get("control") not in question.of:
            if option is not None:
                raise UserError(
                    f"{question.option}: belongs to --control {' or '.join(question.of)}, not to "
                    f"{found.get('control')}; leave it out"
                )
            continue
        if option is None and ask is not None:
            found[question.name] = _asked(question, ask, said)
            continue
        if option is None and question.default is None:
            missing.append(question.option)
            continue
        found[question.name] = _parsed(question, question.default or "" if option is None else option)
    if missing:
        raise UserError(f"init: no terminal to ask at; give {', '.join(missing)}")
    return Answers(**found)


def _parsed(question: Question, given: str) -> Any:
    try:
        return question.parse(given)
    except ValueError as error:
        raise UserError(f"{question.option}: {error}") from None


def _asked(question: Question, ask: Ask, said: dict[str, str]) -> Any:
    """Ask a question until the answer is valid."""
    prompt, default = question.prompt, said.get(question.name, question.default)
    while True:
        typed = ask(prompt, default).strip()
        try:
            value = question.parse(typed)
        except ValueError as error:
            prompt = f"{error}\n{question.prompt}"
        else:
            said[question.name] = typed
            return value
