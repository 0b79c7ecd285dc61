"""The parameters of a configuration that a log may fit: their names, units, bounds and natural scales.

A key is a dotted path, a source or node going by its name and a link by those of its ends:
`source.nut.torque_Nm`, `surface.convection_W_m2K`, `node.nut_body.capacity_J_K`, `link.nut-nut_body.factor`.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from observer.config.machine import Config
from observer.config.sections import Source
from observer.errors import ConfigError

FILM = "surface.convection_W_m2K"


class ParameterInfo(NamedTuple):
    """Prior knowledge of a kind of parameter.

    Attributes:
        unit: Unit of its values, `1` for a ratio.
        scale: A change that matters, in that unit.
        low: Lower bound.
        high: Upper bound.
    """

    unit: str
    scale: float
    low: float
    high: float


PARAMETERS: dict[str, dict[str, ParameterInfo]] = {
    "surface": {
        "convection_W_m2K": ParameterInfo("W/m2K", 5.0, 0.0, 1000.0),
        "factor": ParameterInfo("1", 0.5, 1e-3, 100.0),
    },
    "boundary": {"coefficient_W_m2K": ParameterInfo("W/m2K", 50.0, 1e-3, 1e5)},
    "screw": {
        "diameter_m": ParameterInfo("m", 0.01, 1e-3, 1.0),
        "conductivity_W_mK": ParameterInfo("W/mK", 10.0, 1.0, 1000.0),
        "density_kg_m3": ParameterInfo("kg/m3", 1000.0, 500.0, 25_000.0),
        "specific_heat_J_kgK": ParameterInfo("J/kgK", 100.0, 50.0, 5000.0),
        "expansion_1_K": ParameterInfo("1/K", 2e-6, 1e-7, 1e-4),
    },
    "supports": {
        "stiffness_first_N_m": ParameterInfo("N/m", 5e7, 1e5, 1e12),
        "stiffness_second_N_m": ParameterInfo("N/m", 5e7, 1e5, 1e12),
        "preload_N": ParameterInfo("N", 500.0, 0.0, 1e6),
        "gap_m": ParameterInfo("m", 5e-6, 0.0, 1e-2),
    },
    "bed": {"expansion_1_K": ParameterInfo("1/K", 2e-6, 1e-9, 1e-4)},
    "source": {
        "torque_Nm": ParameterInfo("Nm", 0.1, 0.0, 1000.0),
        "share": ParameterInfo("1", 0.25, 0.0, 1.0),
        "heat_W_rpm": ParameterInfo("W/rpm", 0.005, 0.0, 100.0),
        "scale": ParameterInfo("1", 0.5, 0.0, 100.0),
    },
    "node": {"capacity_J_K": ParameterInfo("J/K", 500.0, 1e-3, 1e9)},
    "link": {"factor": ParameterInfo("1", 0.5, 1e-2, 100.0)},
    "sensor": {"shows": ParameterInfo("1", 0.25, 0.02, 2.0)},
}
"""By the first part of the key, then by its last."""
NAMED: dict[str, Callable[[Any], str]] = {
    "source": lambda source: source.name,
    "node": lambda node: node.name,
    "link": lambda link: "-".join(link.between),
    "sensor": lambda sensor: sensor.name,
}
"""Tables of which there are several, and what each of them goes by."""


def candidates(config: Config) -> tuple[str, ...]:
    """Return every key of this configuration that may be free, in the order of the tables.

    A link with the same ends as another has no key. Displacement sensors add expansion and supports, and a
    sensor with `shows` adds that.
    """
    keys = ["surface.factor" if config.surface.law else FILM]
    for side in ("left", "right"):
        if getattr(config.boundary, side).kind == "convective":
            keys += [f"boundary.{side}.{key}" for key in PARAMETERS["boundary"]]
    moved = any(sensor.kind == "displacement" for sensor in config.sensor)
    keys += [f"screw.{key}" for key in PARAMETERS["screw"] if moved or key != "expansion_1_K"]
    if moved and config.supports is not None and config.supports.mounting == "L-III":
        keys += [
            f"supports.{key}" for key in PARAMETERS["supports"] if getattr(config.supports, key) is not None
        ]
    if moved and config.bed is not None:
        keys += [f"bed.{key}" for key in PARAMETERS["bed"]]
    for source in config.source:
        keys += [f"source.{source.name}.{key}" for key in _law_keys(source)]
    keys += [f"node.{node.name}.capacity_J_K" for node in config.node]
    links = [link.key for link in config.link]
    keys += [f"{key}.factor" for key in links if links.count(key) == 1]
    for sensor in config.sensor:
        if sensor.shows != 1.0 or sensor.shows_tolerance is not None:
            keys.append(f"sensor.{sensor.name}.shows")
    return tuple(keys)


def thermal_only(config: Config) -> Config:
    """Return the configuration without its displacement sensors.

    Free parameters that only these show are removed. A configuration without such sensors is returned
    unchanged.
    """
    thermal = tuple(sensor for sensor in config.sensor if sensor.kind == "temperature")
    if len(thermal) == len(config.sensor):
        return config
    config = config.model_copy(update={"sensor": thermal})
    if (free := config.calibrate.free) is None:
        return config
    fittable = set(candidates(config))
    remaining = tuple(key for key in free if key in fittable) or None
    return config.model_copy(update={"calibrate": config.calibrate.model_copy(update={"free": remaining})})


def free_keys(config: Config) -> tuple[str, ...]:
    """Return the keys that the configuration declares free, each once.

    Without `[calibrate] free` these are the base film coefficient, if there is one, and the scale of each
    heat law.

    Raises:
        ConfigError: If a key cannot be free, or nothing is left to fit.
    """
    if config.calibrate.free is None:
        surface = config.surface
        film = ("surface.factor",) if surface.law else (FILM,) if surface.convection_W_m2K > 0 else ()
        keys = film + tuple(f"source.{s.name}.scale" for s in config.source if s.law is not None)
    else:
        keys = tuple(dict.fromkeys(config.calibrate.free))
    _refuse_unknown(config, keys)
    if not keys:
        raise ConfigError("calibrate: nothing is free to be fitted; name keys in [calibrate] free")
    return keys


def lawless(config: Config) -> str | None:
    """Return a warning that names the heats without a law; None where every heat has one.

    A prediction takes such heats as 0 W, because only an estimator could find them.
    """
    without = [s.name for s in config.source if s.law is None]
    if not without:
        return None
    sources = "no heat has" if len(without) == len(config.source) else f"{', '.join(without)}: without"
    return (
        f"{sources} a law, so a prediction takes it as 0 W and its effect on the screw counts as the "
        "model's error; give speed_channel with torque_Nm (a nut) or heat_W_rpm (a bearing), or power_channel"
    )


def free_problems(config: Config) -> list[str]:
    """Return why keys in `[calibrate] free` cannot be free, a sentence with a remedy for each."""
    return list(_unknown(config, dict.fromkeys(config.calibrate.free or ())))


def info_of(key: str) -> ParameterInfo:
    """Return the prior knowledge of a parameter by its key, such as `source.nut.scale`.

    Raises:
        KeyError: If no parameter of this kind may be free.
    """
    parts = key.split(".")
    return PARAMETERS[parts[0]][parts[-1]]


def get(config: Config, key: str) -> float:
    """Return a parameter's value, in the unit of its key.

    Raises:
        ConfigError: If the key cannot be free in this configuration.
    """
    _refuse_unknown(config, (key,))
    head, *middle, last = key.split(".")
    owner: Any = getattr(config, head)
    if head in NAMED:
        owner = next(item for item in owner if NAMED[head](item) == ".".join(middle))
    elif head == "boundary":
        owner = getattr(owner, middle[0])
    return float(getattr(owner, last))


def replaced(config: Config, values: Mapping[str, float]) -> Config:
    """Return the configuration with other values, validated again.

    Args:
        config: The configuration.
        values: New values by key, in the units of the keys.

    Raises:
        ConfigError: If a key cannot be free, or a value is out of its range.
    """
    _refuse_unknown(config, values)
    moved = with_values(config, {key: float(value) for key, value in values.items()})
    return config.remade(moved.model_dump(exclude_unset=True, by_alias=True))


def with_values(config: Config, values: Mapping[str, float]) -> Config:
    """Return the configuration with other values, without validation: thousands are made in a fit.

    Args:
        config: The configuration.
        values: New values by key. A name that does not exist changes nothing.
    """
    for key, value in values.items():
        head, *middle, last = key.split(".")
        if head in NAMED:
            name, named = ".".join(middle), NAMED[head]
            section: Any = tuple(
                item.model_copy(update={last: value}) if named(item) == name else item
                for item in getattr(config, head)
            )
        elif head == "boundary":
            end = getattr(config.boundary, middle[0]).model_copy(update={last: value})
            section = config.boundary.model_copy(update={middle[0]: end})
        else:
            section = getattr(config, head).model_copy(update={last: value})
        config = config.model_copy(update={head: section})
    return config


def bounds_of(config: Config, key: str) -> tuple[float, float]:
    """Return lower and upper bound of a parameter in a fit, widened to include the configured value."""
    kind, value = info_of(key), get(config, key)
    return min(kind.low, value), max(kind.high, value)


def scale_of(config: Config, key: str) -> float:
    """Return the natural scale of a parameter, in its unit.

    It is the value's magnitude, or a fifth of its kind's scale if that is larger.
    """
    return max(abs(get(config, key)), 0.2 * info_of(key).scale)


def _law_keys(source: Source) -> tuple[str, ...]:
    if source.torque_Nm is not None:
        return ("torque_Nm", "share", "scale")
    if source.heat_W_rpm is not None:
        return ("heat_W_rpm", "scale")
    if source.law in ("bearing", "nut_friction"):
        return ("share", "scale")
    return ("scale",) if source.law else ()


def _refuse_unknown(config: Config, keys: Iterable[str]) -> None:
    for problem in _unknown(config, keys):
        raise ConfigError(problem)


def _unknown(config: Config, keys: Iterable[str]) -> Iterator[str]:
    """Why keys cannot be free, a sentence each."""
    fittable = candidates(config)
    for key in keys:
        if key not in fittable:
            close = difflib.get_close_matches(key, fittable, n=1, cutoff=0.8)
            remedy = f"did you mean {close[0]}?" if close else f"choose among {', '.join(fittable)}"
            table = key.partition(".")[0]
            if table in ("bed", "supports") and getattr(config, table) is None:
                remedy = f"it has no [{table}]; give one, with a value to start from"
            yield f'calibrate: free: "{key}" cannot be fitted in this configuration; {remedy}'


def rounded(value: float) -> float:
    """Return a value with five significant digits, as it is written into a configuration."""
    return float(f"{value:.5g}")
