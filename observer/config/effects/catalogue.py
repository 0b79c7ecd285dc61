"""The library: every effect class of the modules here. A configuration may also name external classes."""

from __future__ import annotations

import functools
import operator
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, SerializeAsAny, ValidatorFunctionWrapHandler, WrapValidator

from observer.config.effects import bodies, film, heat, sensing
from observer.config.effects.base import EffectTable
from observer.config.outside import entry_names, is_outside, outside

LIBRARY: tuple[type[EffectTable], ...] = tuple(
    effect
    for module in (film, bodies, heat, sensing)
    for effect in vars(module).values()
    if isinstance(effect, type) and issubclass(effect, EffectTable) and effect.__module__ == module.__name__
)
"""In the order of the files, which is that of the reference."""
BY_KIND = {effect.named(): effect for effect in LIBRARY}
KINDS = tuple(BY_KIND)


def effect_class(kind: str) -> type[EffectTable]:
    """Return the class of an effect.

    Args:
        kind: A kind of the library, `module:Class`, or the name of an entry point.

    Raises:
        ValueError: If no class has this kind, if it cannot be imported, or if it is no subclass of
            `EffectTable`.
    """
    if kind in BY_KIND:
        return BY_KIND[kind]
    if not is_outside(kind, "effects"):
        kinds = ", ".join((*KINDS, *entry_names("effects")))
        raise ValueError(f'"{kind}" is no effect; give one of {kinds}, or "module:Class"')
    effect = outside(kind, "effects")
    if not (isinstance(effect, type) and issubclass(effect, EffectTable)):
        raise ValueError(f"{kind} is no effect; name a subclass of observer.config.effects.base.EffectTable")
    return effect


def _from_outside(value: Any, validate_library: ValidatorFunctionWrapHandler) -> EffectTable:
    """Validate an effect's table by the external class that its `kind` names, or by a class of the
    library.
    """
    kind = value.get("kind") if isinstance(value, dict) else getattr(value, "kind", None)
    if kind not in BY_KIND and is_outside(kind, "effects"):
        return effect_class(kind).model_validate(value)
    effect: EffectTable = validate_library(value)
    return effect


if TYPE_CHECKING:
    Effect = EffectTable
else:
    Effect = Annotated[
        functools.reduce(operator.or_, LIBRARY),
        Field(discriminator="kind"),
        WrapValidator(_from_outside),
        SerializeAsAny(),
    ]


def offset_of(sensor: str, offset_K: float) -> EffectTable:
    """Return the effect of a sensor that reads `offset_K` too much."""
    return sensing.SensorBias(kind="sensor_bias", target=sensor, offset_K=offset_K)
