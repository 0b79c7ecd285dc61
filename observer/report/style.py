"""One look for all pictures: colours for the colour-blind too, quiet axes, time in a fitting unit."""

from __future__ import annotations

from typing import Any

import numpy as np

from observer.frames import FloatArray

INK, QUIET, FAINT = "#1b1f24", "#6b7280", "#e2e5e9"
CATEGORIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#444444")
"""Okabe & Ito (2008), without yellow, which is lost on white."""
QUALITY = ("#cfe8dc", "#E69F00", "#D55E00", "#444444")
"""Of a sensor, by rising severity."""
ESTIMATE_QUALITY = ("#cfe8dc", "#9ecae9", *QUALITY[1:])
"""The same of an estimate, which may also be starting."""
FIELD_MAP = "inferno"
ORDERED_MAP = "viridis"

RC: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 11.0,
    "text.color": INK,
    "axes.edgecolor": "#b6bcc5",
    "axes.labelcolor": INK,
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 12.0,
    "axes.titleweight": "bold",
    "axes.titlepad": 7.0,
    "grid.color": FAINT,
    "grid.linewidth": 0.8,
    "legend.frameon": False,
    "legend.fontsize": 10.5,
    "legend.handlelength": 1.5,
    "lines.linewidth": 1.6,
    "xtick.color": QUIET,
    "ytick.color": QUIET,
    "xtick.labelsize": 10.0,
    "ytick.labelsize": 10.0,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}


def colour(index: int) -> str:
    """Return the colour of a category; they repeat after seven."""
    return CATEGORIES[index % len(CATEGORIES)]


def ordered_colours(count: int) -> list[Any]:
    """Return colours of rising lightness for things in an order, such as positions."""
    import matplotlib as mpl  # noqa: PLC0415 - slow to import

    return list(mpl.colormaps[ORDERED_MAP](np.linspace(0.08, 0.8, count)))


def elapsed(time_s: FloatArray) -> tuple[FloatArray, str]:
    """Return the time since the first sample and its unit: s, min or h, whichever reads best."""
    since_s = time_s - time_s[0]
    span_s = float(since_s[-1])
    for unit, seconds, up_to_s in (("s", 1.0, 300.0), ("min", 60.0, 4 * 3600.0)):
        if span_s <= up_to_s:
            return since_s / seconds, unit
    return since_s / 3600.0, "h"


def duration_text(seconds: float) -> str:
    """Return a duration as a person says it."""
    minutes, rest = divmod(round(seconds), 60)
    if minutes < 5:
        return f"{seconds:.0f} s"
    hours, minutes = divmod(minutes + (rest >= 30), 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min"
