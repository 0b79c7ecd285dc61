"""The catalogue of `observer init`: screws, steels, thermocouple modules, sources of the nut's position."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import partial
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field

from drivers.places import CAN_INPUTS, MODBUS_INPUTS
from observer.installation import typed


@dataclass(frozen=True, slots=True)
class CatalogueScrew:
    """A ball screw by nominal diameter and lead.

    `root_mm` is the diameter between the grooves: nominal less 0.8 times the usual ball of that size (pitch
    circle 0.2 balls above nominal, groove one ball deep; ISO 3408-2 for diameters and leads). Torque and
    bearing heat are usual of a preloaded nut and a pair of angular contact bearings at that size: priors of
    an estimator that finds the heats itself, not data of a maker.
    """

    lead_mm: float
    root_mm: float
    nut_mm: float
    torque_Nm: float
    bearing_W_rpm: float


SCREWS = {
    "16x5": CatalogueScrew(5.0, 13.5, 42.0, 0.05, 0.002),
    "20x5": CatalogueScrew(5.0, 17.5, 52.0, 0.10, 0.003),
    "25x5": CatalogueScrew(5.0, 22.5, 55.0, 0.15, 0.004),
    "25x10": CatalogueScrew(10.0, 21.2, 75.0, 0.20, 0.004),
    "32x5": CatalogueScrew(5.0, 29.5, 58.0, 0.20, 0.005),
    "32x10": CatalogueScrew(10.0, 26.9, 95.0, 0.30, 0.005),
    "40x5": CatalogueScrew(5.0, 37.5, 62.0, 0.25, 0.006),
    "40x10": CatalogueScrew(10.0, 34.9, 100.0, 0.40, 0.006),
    "40x20": CatalogueScrew(20.0, 34.9, 110.0, 0.40, 0.006),
    "50x10": CatalogueScrew(10.0, 44.9, 110.0, 0.60, 0.008),
    "63x10": CatalogueScrew(10.0, 57.9, 120.0, 0.90, 0.010),
    "80x10": CatalogueScrew(10.0, 74.9, 125.0, 1.20, 0.012),
}
"""By nominal diameter and lead in mm."""


@dataclass(frozen=True, slots=True)
class Steel:
    """A screw's steel, near room temperature."""

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
    """A thermocouple module: its name, period of new values, and noise."""

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

CONTROLS = ("canopen", "modbus", "can", "opcua", "mtconnect", "none")
"""A source of the nut's position."""


def _typed(read: Callable[[str], Any]) -> BeforeValidator:
    """Parses typed text; a value passes unchanged."""
    return BeforeValidator(lambda given: read(given) if isinstance(given, str) else given)


def _air(text: str) -> object:
    """A temperature, or the word for an input of the module."""
    word = text.strip().lower()
    return word if word == "input" else typed.degC(text)


def _ascending(ends: tuple[float, float]) -> tuple[float, float]:
    if not ends[0] < ends[1]:
        raise ValueError("give both ends, the smaller first, such as 150 800 mm")
    return ends


def _one_of(names: Collection[str]) -> AfterValidator:
    def known(given: str) -> str:
        if given not in names:
            raise ValueError(f"not known; give one of {', '.join(names)}")
        return given

    return AfterValidator(known)


@dataclass(frozen=True, slots=True)
class OfControl:
    """The controls for which a question is asked."""

    names: tuple[str, ...]


_BY_NAME = OfControl(("can", "opcua", "mtconnect"))
_BY_COUNT = OfControl(("canopen", "modbus"))
_MODBUS = OfControl(("modbus",))


class Answers(BaseModel):
    """One machine's answers, in the order in which they are asked; lengths count from the screw's left end.

    `ambient` is a temperature in °C, or `"input"`: the module's next input after the sensors.
    """

    model_config = ConfigDict(validate_assignment=True)

    machine: Annotated[str, _typed(typed.key_name)] = "machine"
    axis: Annotated[str, _typed(typed.key_name)] = "x"
    screw: Annotated[str, _typed(typed.screw_name), _one_of(SCREWS)] = "40x10"
    steel: Annotated[str, _one_of(STEELS)] = "bearing"
    length_m: Annotated[float, _typed(typed.length_m), Field(gt=1e-9)]
    stroke_m: Annotated[
        tuple[float, float], _typed(partial(typed.places_m, count=2)), AfterValidator(_ascending)
    ]
    sensors_m: Annotated[tuple[float, ...], _typed(typed.places_m)]
    module: Annotated[str, _one_of(MODULES)] = "wago_750_458"
    module_at: str
    ambient: Annotated[float | Literal["input"], _typed(_air)] = "input"
    control: Annotated[str, _one_of(CONTROLS)] = "none"
    control_at: Annotated[str, OfControl((*_BY_COUNT.names, *_BY_NAME.names))]
    node_id: Annotated[int, OfControl(("canopen",))]
    counts_per_m: Annotated[float, _typed(typed.number), _BY_COUNT]
    position_register: Annotated[int, _MODBUS] = 0
    speed_register: Annotated[int | None, _MODBUS] = None
    dbc: Annotated[str, OfControl(("can",))]
    position_signal: Annotated[str, _BY_NAME]
    speed_signal: Annotated[str, _BY_NAME] = ""

    @property
    def has_speed(self) -> bool:
        """Whether the control reports the screw's speed."""
        return self.speed_register is not None or bool(self.speed_signal)
