"""The catalogue of `observer init`: screws, steels, thermocouple modules, sources of the nut's position."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from drivers.places import CAN_INPUTS, MODBUS_INPUTS
from observer.installation import typed
from observer.units import BY_NAME


@dataclass(frozen=True, slots=True)
class CatalogueScrew:
    """A ball screw by nominal diameter and lead.

    The pitch circle is 0.2 balls above nominal and the groove one ball deep (ISO 3408-2 for diameters and
    leads). Torque, masses and conductances are usual for a preloaded nut and a pair of angular contact
    bearings of that size. They are priors of an estimator that finds the heats itself, not data of a maker.

    Attributes:
        lead_mm: Lead.
        root_mm: Diameter between the grooves: nominal less 0.8 times the usual ball of that size.
        nut_mm: Length of the nut.
        torque_Nm: Friction torque of the preloaded nut.
        bearing_W_rpm: Heat of a bearing per speed.
        nut_kg: Mass of a flanged nut (outer diameters of DIN 69051-5).
        housing_kg: Mass of a fixed bearing's unit.
        housing_W_K: Conductance from the bearing's rings to its housing.
    """

    lead_mm: float
    root_mm: float
    nut_mm: float
    torque_Nm: float
    bearing_W_rpm: float
    nut_kg: float
    housing_kg: float
    housing_W_K: float


SCREWS = {
    "16x5": CatalogueScrew(5.0, 13.5, 42.0, 0.05, 0.002, 0.23, 0.4, 2.5),
    "20x5": CatalogueScrew(5.0, 17.5, 52.0, 0.10, 0.003, 0.41, 0.6, 3.5),
    "25x5": CatalogueScrew(5.0, 22.5, 55.0, 0.15, 0.004, 0.47, 1.4, 5.0),
    "25x10": CatalogueScrew(10.0, 21.2, 75.0, 0.20, 0.004, 0.59, 1.4, 5.0),
    "32x5": CatalogueScrew(5.0, 29.5, 58.0, 0.20, 0.005, 0.82, 2.2, 7.0),
    "32x10": CatalogueScrew(10.0, 26.9, 95.0, 0.30, 0.005, 1.2, 2.2, 7.0),
    "40x5": CatalogueScrew(5.0, 37.5, 62.0, 0.25, 0.006, 1.3, 3.3, 10.0),
    "40x10": CatalogueScrew(10.0, 34.9, 100.0, 0.40, 0.006, 1.9, 3.3, 10.0),
    "40x20": CatalogueScrew(20.0, 34.9, 110.0, 0.40, 0.006, 2.0, 3.3, 10.0),
    "50x10": CatalogueScrew(10.0, 44.9, 110.0, 0.60, 0.008, 2.8, 6.5, 13.0),
    "63x10": CatalogueScrew(10.0, 57.9, 120.0, 0.90, 0.010, 3.9, 10.0, 18.0),
    "80x10": CatalogueScrew(10.0, 74.9, 125.0, 1.20, 0.012, 4.8, 18.0, 25.0),
}
"""By nominal diameter and lead in mm."""


_DIAMETERS_MM, _LEADS_MM = (6.0, 200.0), (0.5, 120.0)
"""Of the ball screws that are made."""


def size_of(name: str) -> tuple[float, float]:
    """Return nominal diameter and lead in mm by a screw's name, such as `40x12`.

    Raises:
        ValueError: The name has another form, or a size that no ball screw has.
    """
    diameter, _, lead = name.partition("x")
    try:
        size = float(diameter), float(lead)
    except ValueError:
        size = math.nan, math.nan
    for value, (low, high) in zip(size, (_DIAMETERS_MM, _LEADS_MM), strict=True):
        if not low <= value <= high:
            raise ValueError("give nominal diameter x lead in mm, as stamped on the nut, such as 40 x 12")
    return size


def screw_of(name: str) -> CatalogueScrew:
    """Return the screw of a size: of the catalogue, or scaled by diameter from the nearest there.

    Torque, masses and conductances grow with powers of the diameter that fit the catalogue.

    Raises:
        ValueError: The name is not a size.
    """
    if name in SCREWS:
        return SCREWS[name]
    diameter_mm, lead_mm = size_of(name)
    sizes = {listed: size_of(listed) for listed in SCREWS}
    nearest = min(sizes, key=lambda n: (abs(sizes[n][0] - diameter_mm), abs(sizes[n][1] - lead_mm)))
    nearest_screw, ratio = SCREWS[nearest], diameter_mm / sizes[nearest][0]
    return CatalogueScrew(
        lead_mm,
        round(diameter_mm - (sizes[nearest][0] - nearest_screw.root_mm) * min(1.0, ratio), 1),
        round(nearest_screw.nut_mm * ratio),
        round(nearest_screw.torque_Nm * ratio**2.5, 3),
        round(nearest_screw.bearing_W_rpm * ratio, 4),
        round(nearest_screw.nut_kg * ratio**2, 2),
        round(nearest_screw.housing_kg * ratio**2.5, 1),
        round(nearest_screw.housing_W_K * ratio**1.5, 1),
    )


@dataclass(frozen=True, slots=True)
class Steel:
    """A screw's steel, near room temperature; the attributes are those of `[screw]`."""

    conductivity_W_mK: float
    density_kg_m3: float
    specific_heat_J_kgK: float
    expansion_1_K: float


STEELS = {
    "bearing": Steel(46.0, 7810.0, 475.0, 11.8e-6),  # 100Cr6, SUJ2, induction hardened through
    "case": Steel(44.0, 7830.0, 470.0, 11.7e-6),  # SCM415, SCM420, 16MnCr5
    "carbon": Steel(49.0, 7850.0, 480.0, 11.7e-6),  # S55C, Cf53, 50CrMo4
    "stainless": Steel(27.0, 7700.0, 460.0, 10.4e-6),  # X46Cr13, 440C
}
"""By family; within a family the conductivity differs by a tenth and the rest by a few per cent."""


@dataclass(frozen=True, slots=True)
class Module:
    """A thermocouple module.

    Attributes:
        title: Maker and type.
        inputs: Number of its inputs.
        period_s: Interval of new values.
        noise_K: Standard deviation of a reading.
    """

    title: str
    inputs: int
    period_s: float
    noise_K: float


MODULES = {
    "wago_750_458": Module("WAGO 750-458", MODBUS_INPUTS["wago_750_458"], 0.5, 0.1),
    "icpdas_m7018": Module("ICP DAS M-7018", MODBUS_INPUTS["icpdas_m7018"], 1.0, 0.1),
    "micro800_tc2": Module("Rockwell 2080-TC2", MODBUS_INPUTS["micro800_tc2"], 0.5, 0.1),
    "css_canmod_temp": Module("CSS CANmod.temp", CAN_INPUTS["css_canmod_temp"], 0.2, 0.4),
    "peak_mu_thermocouple1": Module("PEAK MU-Thermocouple1", CAN_INPUTS["peak_mu_thermocouple1"], 0.3, 0.1),
}

OTHER = "other"
"""The answer for a module, a bus or a mounting that is not in the list."""
CONTROLS = ("canopen", "modbus", "can", "opcua", "mtconnect", "none", OTHER)
"""A source of the nut's position; `other` is a bus that no driver speaks."""
MOUNTINGS = {"fixed-supported": "L-II", "fixed-fixed": "L-III", "fixed-free": "L-IV", "floating": "L-I"}
"""By the words of a drawing, as `[supports] mounting` has them."""
TYPES = ("int16", "uint16", "int32", "uint32", "float32", "float64")


def _typed(read: Callable[[str], Any]) -> BeforeValidator:
    """Return a validator that parses typed text; other values pass unchanged."""
    return BeforeValidator(lambda value: read(value) if isinstance(value, str) else value)


def _air(text: str) -> object:
    """Return a temperature in °C, or the word `input` for an input of the module."""
    word = text.strip().lower()
    return word if word == "input" else typed.degC(text)


def _places_or_none(text: str) -> tuple[float, ...]:
    return () if text.strip().lower() == "none" else typed.places_m(text)


def _mass_kg(text: str) -> float:
    kg = typed.number(text.lower().removesuffix("kg"))
    if not 0.02 <= kg <= 2000.0:
        raise ValueError("give a mass in kg, such as 1.9")
    return kg


def _ascending(ends: tuple[float, float]) -> tuple[float, float]:
    if not ends[0] < ends[1]:
        raise ValueError("give both ends, the smaller first, such as 150 800 mm")
    return ends


def _sized(name: str) -> str:
    size_of(name)
    return name


def _side(text: str) -> str:
    word = text.strip().lower()
    return _SIDES.get(word, word)


def _function(text: str) -> str:
    word = text.strip().lower()
    return {"3": "holding", "03": "holding", "4": "input", "04": "input"}.get(word, word)


def _number_type(text: str) -> str:
    word = text.strip().lower()
    return {"float": "float32", "real": "float32", "int": "int16", "word": "uint16", "dint": "int32"}.get(
        word, word
    )


def _transport(text: str) -> str:
    word = text.strip().lower()
    return {"rtu": "rtu-over-tcp", "modbus tcp": "tcp"}.get(word, word)


def _code(text: str) -> str:
    word = text.strip().replace(",", ".")
    try:
        if word:
            int(word, 0) if word.lower().startswith("0x") else float(word)
    except ValueError:
        raise ValueError("give the number that stands for an open input, such as 32767 or 0x7FFF") from None
    return word


def _shown_at_ends(text: str) -> tuple[float, float] | None:
    """Return the readings at the left and the right end, m, None for an empty text.

    Raises `ValueError` where a reading or the unit is missing, or both readings are the same.
    """
    if not text.strip():
        return None
    match = re.fullmatch(
        r"\s*([+-]?\d+(?:[.,]\d+)?)\s*(mm|m)?[\s;]+(?:to |bis |and |und )?([+-]?\d+(?:[.,]\d+)?)\s*(mm|m)\s*",
        text,
    )
    if match is None:
        raise ValueError("give both readings with their unit, that of the left end first, such as 0 650 mm")
    left, right = (BY_NAME[match[4]].to_base(float(match[k].replace(",", "."))) for k in (1, 3))
    if left == right:
        raise ValueError("both readings are the same; give that of the left end, then that of the right")
    return round(left, 9), round(right, 9)


def _one_of(names: Collection[str]) -> AfterValidator:
    def checked_name(text: str) -> str:
        if text not in names:
            raise ValueError(f"not in the list; give one of {', '.join(names)}")
        return text

    return AfterValidator(checked_name)


@dataclass(frozen=True, slots=True)
class BelongsTo:
    """A condition on earlier answers that a question needs.

    Attributes:
        question: An earlier question, or a property of `Answers`.
        answers: The answers after which it is asked.
    """

    question: str
    answers: tuple[str, ...]

    def reason_to_skip(self, earlier_answers: Answers) -> str:
        """Return why the question is not asked after these answers, in words for an error; empty where it
        is asked.
        """
        answer = getattr(earlier_answers, self.question)
        if {answer} & set(self.answers) if isinstance(answer, str) else set(answer) & set(self.answers):
            return ""
        return f"belongs to {_CALLED.get(self.question, option(self.question))} {' or '.join(self.answers)}"


_CALLED = {"wire": "a module on", "described_on": "--module other on", "reads_pairs": "registers of type"}


@dataclass(frozen=True, slots=True)
class Housing:
    """A body that may carry a thermocouple.

    Attributes:
        node: its name in the configuration.
        source: the source whose place on the screw it touches.
        air_W_K: conductance to the air, W/K per kg^(2/3), for a film of about 10 W/m²K.
    """

    node: str
    source: str
    air_W_K: float


HOUSINGS = {
    "nut": Housing("nut_body", "nut", 0.4),
    "left": Housing("left_housing", "left_bearing", 0.45),
    "right": Housing("right_housing", "right_bearing", 0.45),
}
"""By the word for each; of a bearing's housing the air stands for the bed under its foot, too."""
NUT_FILM_W_m2K = 700.0
"""Between nut and screw, over the thread: a grease film of 0.2 mm, and the balls."""
BODY_J_kgK = 470.0
"""Of steel and of cast iron."""
TYPICAL_MASS, TYPICAL_LINK = 0.2, 0.4
"""How well a typical mass, and a typical conductance, are known, relative."""


_SIDES = {"upper": "left", "top": "left", "lower": "right", "bottom": "right"}
"""On a vertical axis the upper bearing counts as left."""


def _housings(text: str) -> tuple[str, ...]:
    """Return the typed names of `HOUSINGS`, in their order. Raises `ValueError` for an unknown one."""
    words = [_SIDES.get(word, word) for word in text.lower().replace(",", " ").split() if word != "and"]
    if words in ([], ["none"]):
        return ()
    if words == ["all"]:
        return tuple(HOUSINGS)
    if unknown := [word for word in words if word not in HOUSINGS]:
        raise ValueError(f"{unknown[0]} is not known; give some of {', '.join(HOUSINGS)}, or none")
    return tuple(name for name in HOUSINGS if name in words)


def option(name: str) -> str:
    """Return the command-line option of a field of `Answers`, such as `--sensors-m`."""
    return f"--{name.replace('_', '-')}"


_BY_NAME = BelongsTo("control", ("can", "opcua", "mtconnect"))
_BY_COUNT = BelongsTo("control", ("canopen", "modbus"))
_MODBUS = BelongsTo("control", ("modbus",))
_DESCRIBED = BelongsTo("described_on", ("modbus",))


class Answers(BaseModel):
    """The answers for one machine, in the order of the questions; lengths count from the screw's left end.

    Assigning text to a field parses it as typed by a person and raises `pydantic.ValidationError`.

    Without an answer to `sensors_m` there must be `housings` that carry thermocouples. Those are the module's
    first inputs. The answer to `ambient` may be `"input"`: the module's next input after the sensors. If the
    module is not in the list, `first_register` and the answers after it locate its values. The control's
    readings with the nut at both ends of its stroke are `shown_at_ends_m`, left end first.
    """

    model_config = ConfigDict(validate_assignment=True)

    machine: Annotated[str, _typed(typed.key_name)] = "machine"
    axis: Annotated[str, _typed(typed.key_name)] = "x"
    screw: Annotated[str, _typed(typed.screw_name), AfterValidator(_sized)] = "40x10"
    steel: Annotated[str, _one_of(STEELS)] = "bearing"
    length_m: Annotated[float, _typed(typed.length_m), Field(gt=1e-9)]
    stroke_m: Annotated[
        tuple[float, float], _typed(partial(typed.places_m, count=2)), AfterValidator(_ascending)
    ]
    mounting: Annotated[str, _one_of((*MOUNTINGS, "unknown"))] = "unknown"
    fixed_end: Annotated[
        str,
        _typed(_side),
        _one_of(("left", "right")),
        BelongsTo("mounting", ("fixed-supported", "fixed-free")),
    ] = "left"
    housings: Annotated[tuple[str, ...], _typed(_housings)] = ()
    nut_kg: Annotated[float | None, _typed(_mass_kg), BelongsTo("housings", ("nut",))] = None
    housing_kg: Annotated[float | None, _typed(_mass_kg), BelongsTo("housings", ("left", "right"))] = None
    sensors_m: Annotated[tuple[float, ...], _typed(_places_or_none)] = ()
    module: Annotated[str, _one_of((*MODULES, OTHER))] = "wago_750_458"
    module_bus: Annotated[str, _one_of(("modbus", OTHER)), BelongsTo("module", (OTHER,))] = "modbus"
    module_at: Annotated[str, BelongsTo("module_bus", ("modbus",))]
    transport: Annotated[
        str, _typed(_transport), _one_of(("tcp", "rtu-over-tcp")), BelongsTo("wire", ("ethernet",))
    ] = "tcp"
    module_unit: Annotated[int, Field(ge=0, le=255), BelongsTo("wire", ("ethernet", "serial"))] = 1
    function: Annotated[str, _typed(_function), _one_of(("holding", "input")), _DESCRIBED] = "input"
    first_register: Annotated[int, Field(ge=0, le=0xFFFF), _DESCRIBED] = 0
    type: Annotated[str, _typed(_number_type), _one_of(TYPES), _DESCRIBED] = "int16"
    word_order: Annotated[str, _one_of(("big", "little")), BelongsTo("reads_pairs", TYPES[2:])] = "big"
    degrees_per_count: Annotated[float | None, _typed(typed.number), Field(ge=1e-9, le=1e3), _DESCRIBED] = (
        None
    )
    step: Annotated[int | None, Field(ge=1, le=1000), _DESCRIBED] = None
    inputs: Annotated[int, Field(ge=1, le=64), _DESCRIBED] = 8
    fault_code: Annotated[str, _typed(_code), _DESCRIBED] = ""
    ambient: Annotated[float | Literal["input"], _typed(_air)] = "input"
    control: Annotated[str, _one_of(CONTROLS)] = "none"
    control_at: Annotated[str, BelongsTo("control", (*_BY_COUNT.answers, *_BY_NAME.answers))]
    node_id: Annotated[int, BelongsTo("control", ("canopen",))]
    counts_per_m: Annotated[float, _typed(typed.number), _BY_COUNT]
    position_register: Annotated[int, _MODBUS] = 0
    position_type: Annotated[str, _typed(_number_type), _one_of(TYPES), _MODBUS] = "int32"
    position_word_order: Annotated[str, _one_of(("big", "little")), _MODBUS] = "big"
    speed_register: Annotated[int | None, _MODBUS] = None
    dbc: Annotated[str, BelongsTo("control", ("can",))]
    position_signal: Annotated[str, _BY_NAME]
    speed_signal: Annotated[str, _BY_NAME] = ""
    shown_at_ends_m: Annotated[
        tuple[float, float] | None,
        _typed(_shown_at_ends),
        BelongsTo("control", (*_BY_COUNT.answers, *_BY_NAME.answers)),
    ] = None

    @property
    def thermocouples(self) -> tuple[str, ...]:
        """The names of all thermocouples, in the order of the module's inputs: bodies first, then the
        screw.
        """
        on_screw = (f"t{n}" for n in range(1, len(self.sensors_m) + 1))
        return (*(HOUSINGS[name].node for name in self.housings), *on_screw)

    @property
    def has_speed(self) -> bool:
        """Whether the control reports the screw's speed."""
        return self.speed_register is not None or bool(self.speed_signal)

    @property
    def described_on(self) -> str:
        """The bus of a module outside the list, empty for a listed one."""
        return self.module_bus if self.module == OTHER else ""

    @property
    def reads_pairs(self) -> str:
        """The type of a described module's numbers, empty for a module of the list."""
        return self.type if self.described_on == "modbus" else ""

    @property
    def wire(self) -> str:
        """The kind of the module's wire: `ethernet`, `serial` or `can`; empty for a bus without a driver."""
        if self.module in CAN_INPUTS or (self.module == OTHER and self.module_bus == OTHER):
            return "can" if self.module in CAN_INPUTS else ""
        return "serial" if typed.is_serial(getattr(self, "module_at", "")) else "ethernet"

    @property
    def reader(self) -> Module:
        """The module that reads the thermocouples; for one outside the list, with the noise of its step."""
        if self.module != OTHER:
            return MODULES[self.module]
        step_K = 0.0 if self.type.startswith("float") else self.scale
        return Module("a module by its registers", self.inputs, 0.5, max(0.1, round(0.3 * step_K, 2)))

    @property
    def scale(self) -> float:
        """The degrees per count of a described module; without an answer 1 for floats and 0.1 for
        integers.
        """
        return self.degrees_per_count or (1.0 if self.type.startswith("float") else 0.1)
