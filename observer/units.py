"""Units: the one table of their suffixes, symbols, spellings and factors.

A name of the configuration ends in the suffix of its unit, as `t1_degC`. Recorders spell units in many ways.
Values convert to the base unit of their quantity: m, degC, rpm, W, N, s.
"""

from __future__ import annotations

import math
import re
import unicodedata
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

Values = TypeVar("Values", float, NDArray[np.float64])

ZERO_DEGC_K = 273.15
RAD_S_PER_RPM = math.pi / 30


class Unit(NamedTuple):
    """A unit; a value in the base unit is (value + `shift`) · `factor` / `divisor`.

    Attributes:
        name: The name that pint understands.
        base: Name of the base unit of its quantity; empty if there is none.
        factor: Base units in `divisor` of this unit.
        divisor: Keeps decimal factors exact.
        shift: Added before the factor, as of °F.
        suffixes: Ends of names in this unit, the one of the configuration first.
        symbol: By default the first suffix.
        words: For sentences; by default the symbol.
        spellings: Those of recorders, in lower case.
        si: Exponents, factor and offset in SI base units, for units of results; None for a unit of inputs
            only.
    """

    name: str
    base: str = ""
    factor: float = 1.0
    divisor: float = 1.0
    shift: float = 0.0
    suffixes: str = ""
    symbol: str = ""
    words: str = ""
    spellings: str = ""
    si: dict[str, str] | None = None

    @property
    def suffix(self) -> str:
        """The end of names in this unit, empty without one."""
        return self.suffixes.partition(" ")[0]

    @property
    def shown(self) -> str:
        """The unit as people write it: its symbol, else its suffix, else its name."""
        return self.symbol or self.suffix or self.name

    @property
    def in_words(self) -> str:
        """The unit in a sentence."""
        return self.words or self.shown

    @property
    def size(self) -> float:
        """The size of the unit in base units, without its shift."""
        return self.factor / self.divisor

    def to_base(self, value: Values) -> Values:
        """Return a value, or an array of values, in the base unit, with the shift of temperatures."""
        return (value + self.shift) * self.factor / self.divisor


UNITS = (
    Unit("degC", "degC", suffixes="degC C", symbol="°C", si={"K": "1", "offset": "273.15"},
         spellings="degc c celsius degcelsius gradc gradcelsius degreec degreesc degreecelsius "
                   "degreescelsius centigrade tempc oc"),
    Unit("degF", "degC", divisor=1.8, shift=-32.0, suffixes="degF F", symbol="°F",
         spellings="degf f fahrenheit fahr degfahrenheit degfahr gradf gradfahrenheit degreef degreesf "
                   "degreefahrenheit degreesfahrenheit tempf of"),
    Unit("kelvin", "degC", shift=-ZERO_DEGC_K, suffixes="K", si={"K": "1"},
         spellings="k kelvin kelvins degk gradk degreek tempk"),
    Unit("0.1 degC", "degC", divisor=10.0, words="tenths of °C"),
    Unit("0.01 degC", "degC", divisor=100.0, words="hundredths of °C"),
    Unit("rpm", "rpm", suffixes="rpm", si={"rad": "1", "s": "-1", "factor": "0.10471975511965977"},
         spellings="rpm u/min 1/min min-1 min^-1 upm r/min rev/min /min umdr/min revolution/minute"),
    Unit("radian/second", "rpm", 1.0 / RAD_S_PER_RPM, symbol="rad/s", spellings="rad/s"),
    Unit("revolution/second", "rpm", 60.0, suffixes="Hz", symbol="revolution/second",
         words="revolutions a second", spellings="1/s hz rps rev/s u/s"),
    Unit("degree/second", "rpm", divisor=6.0, words="degrees a second", spellings="deg/s"),
    Unit("revolution/hour", "rpm", divisor=60.0, words="revolutions an hour"),
    Unit("m", "m", suffixes="m", spellings="m meter metre", si={"m": "1"}),
    Unit("mm", "m", divisor=1e3, suffixes="mm", spellings="mm millimeter", si={"m": "1", "factor": "1e-3"}),
    Unit("um", "m", divisor=1e6, suffixes="um", symbol="µm", spellings="μm um micron microns micrometer",
         si={"m": "1", "factor": "1e-6"}),
    Unit("inch", "m", 0.0254, suffixes="in", symbol="inch", words="inches",
         spellings='in inch inches " zoll'),
    Unit("cm", "m", divisor=1e2, suffixes="cm", spellings="cm"),
    Unit("W", "W", suffixes="W", spellings="w watt watts", si={"kg": "1", "m": "2", "s": "-3"}),
    Unit("kW", "W", 1e3, suffixes="kW", spellings="kw kilowatt"),
    Unit("mW", "W", divisor=1e3),  # spelt as the megawatt in lower case
    Unit("N", "N", suffixes="N", spellings="newton", si={"kg": "1", "m": "1", "s": "-2"}),
    Unit("kN", "N", 1e3),
    Unit("N*m", "N*m", suffixes="Nm", spellings="nm n·m n*m newtonmeter",
         si={"kg": "1", "m": "2", "s": "-2"}),
    Unit("s", "s", suffixes="s", spellings="s sec secs second seconds sek sekunde sekunden", si={"s": "1"}),
    Unit("ms", "s", divisor=1e3, suffixes="ms", spellings="ms msec millisecond milliseconds millisekunden"),
    Unit("us", "s", divisor=1e6, suffixes="us", spellings="us μs microsecond microseconds"),
    Unit("ns", "s", divisor=1e9, suffixes="ns", spellings="ns nanoseconds"),
    Unit("min", "s", 60.0, suffixes="min", spellings="min mins minute minutes minuten"),
    Unit("h", "s", 3600.0, suffixes="h", spellings="h hr hrs hour hours std stunde stunden"),
    Unit("d", "s", 86_400.0, spellings="d day days tag tage"),
    Unit("percent", "percent", symbol="%", spellings="% percent"),
    Unit("V", "V", suffixes="V", spellings="v volt volts"),
    Unit("mV", "V", divisor=1e3, suffixes="mV", spellings="mv mvolt mvolts millivolt millivolts"),
    Unit("A", "A", suffixes="A", spellings="a ampere amperes amps"),
    Unit("mA", "A", divisor=1e3, spellings="ma milliampere"),
    Unit("kWh", spellings="kwh"),
    Unit("ohm", spellings="ohm ohms ω"),
    Unit("bar", suffixes="bar", spellings="bar"),
    Unit("m/s", "m/s", suffixes="m_s", symbol="m/s"),
    Unit("mm/s", "m/s", divisor=1e3, spellings="millimeter/second"),
    Unit("mm/s^2", "m/s^2", divisor=1e3, spellings="millimeter/second^2"),
    Unit("W/m^2/K", suffixes="W_m2K", symbol="W/(m² K)"),
)  # fmt: skip
BY_NAME = {unit.name: unit for unit in UNITS}
BY_SUFFIX = {suffix: unit for unit in UNITS for suffix in unit.suffixes.split()}
SYMBOLS = {unit.suffix: unit.symbol for unit in UNITS if unit.suffix and unit.symbol}
"""The symbol of a unit by the suffix of names, where the two differ."""
_BY_SPELLING = {spelling: unit for unit in UNITS for spelling in unit.spellings.split()}
_DEGREE = re.compile(r"^(?:[Ââ]?[°º˚∘⁰]|\*|\?|\ufffd)\s*(?=[CcFfKk])|[°º˚∘⁰]")
"""A degree sign, one that was typed or decoded as another."""


def unit_of(name: str) -> str:
    """Return the suffix of the unit that ends a signal's name, as `degC` of `t1_degC`; empty if none of
    ours does.
    """
    stem, _, suffix = name.rpartition("_")
    unit = BY_SUFFIX.get(suffix)
    return suffix if stem and unit is not None and unit.si is not None and suffix == unit.suffix else ""


def symbol_of(name: str) -> str:
    """Return the symbol of the unit that ends a signal's name, as `°C` of `t1_degC`; empty if none of ours
    does.
    """
    suffix = unit_of(name)
    return BY_SUFFIX[suffix].shown if suffix else ""


def spelled(text: str) -> Unit | None:
    """Return the unit of which a text is a usual spelling, with any kind of degree sign; None for any
    other text.
    """
    plain = unicodedata.normalize("NFKC", _DEGREE.sub("deg", text.strip().strip("[]")))
    plain = _DEGREE.sub("deg", plain).casefold()
    return _BY_SPELLING.get(re.sub(r"[\s._]", "", plain))


def others_of(base: str) -> tuple[Unit, ...]:
    """Return the units that convert to a base unit, other than itself; empty for an empty name."""
    return tuple(unit for unit in UNITS if base and unit.base == base != unit.name)
