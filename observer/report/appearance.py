"""Shared by pictures, reports and the page: the colours of temperature, units, and axes.

Time is horizontal. Position is vertical in time charts and horizontal in the others.
"""

from __future__ import annotations

from typing import Any

from observer.units import SYMBOLS

TEMPERATURE_COLOURS = (
    "#000004", "#0b0724", "#210c4a", "#3d0965", "#57106e", "#71196e", "#8a226a", "#a32c61", "#bc3754",
    "#d24644", "#e45a31", "#f1731d", "#f98e09", "#fcac11", "#f9cb35", "#f2ea69", "#fcffa4",
)  # fmt: skip
"""From cold to hot: inferno (van der Walt and Smith, 2015), at sixteenths."""
MM_PER_M = 1000.0
"""Positions are shown in mm."""


def document() -> dict[str, Any]:
    """Return colours, symbols of units and the factor to mm for the page's script, as plain data."""
    return {"temperature": list(TEMPERATURE_COLOURS), "symbols": SYMBOLS, "mm_per_m": MM_PER_M}
