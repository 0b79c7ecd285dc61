"""What merely multiplies a source's heat, set apart from what gives it its course."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from observer.config import Config
from observer.effects.terms import Body
from observer.frames import FloatArray
from observer.model.realise import terms_of
from observer.tables.sections import Source, owner


def unit_laws(config: Config) -> tuple[Config, FloatArray]:
    """Return the configuration with heat laws of strength 1, and the strengths (m,) it had."""
    divided = {t.source for t in terms_of(config) if isinstance(t, Body) and t.heated > 0.0}
    sources = [s.model_copy(update=dict.fromkeys(_linear_in(s, divided), 1.0)) for s in config.source]
    strength = [_strength(source, config, divided) for source in config.source]
    return config.model_copy(update={"source": tuple(sources)}), np.array(strength)


def _linear_in(source: Source, divided: Collection[str]) -> tuple[str, ...]:
    """The parameters that only multiply a source's law; of `divided` ones the share does more than that."""
    share = () if source.name in divided else ("share",)
    if source.torque_Nm is not None and source.nut_torque_Nm is None:
        return ("scale", *share, "torque_Nm")
    if source.law in ("torque_Nm", "bearing", "nut_friction"):
        return ("scale", *share)
    if source.heat_W_rpm is not None:
        return ("scale", "heat_W_rpm")
    return ("scale", "heat_ratio") if source.law == "heat_of" else ("scale",)


def _strength(source: Source, config: Config, divided: Collection[str]) -> float:
    """What the law of strength 1 is to be multiplied by."""
    if source.law == "heat_of":
        other = _strength(owner(source, config.source), config, divided)
        return source.scale / (source.heat_ratio or 1.0) * other
    return math.prod(float(getattr(source, key)) for key in _linear_in(source, divided))
