"""Draw what each tolerance has in the σ of heats, field and thermal error of a machine: `make figures`."""

from __future__ import annotations

from pathlib import Path
from typing import Any, get_args

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from observer.config.estimator import Learnable
from observer.report.panels import CATEGORIES
from observer.report.sensitivity import tolerances
from tests.learning.machines import CONFIG, config_of

HERE = Path(__file__).parent
SAID = {
    "as configured": "all as configured", "end_W_K": "ends' losses known", "convection": "film known",
    "lag_s": "lags known", "offset_K": "offsets known", "ambient_K": "air known",
    "position_m": "places known", "all": "everything known",
}  # fmt: skip
QUANTITIES = ("heats, W", "field, K", "thermal error, µm")


def sigmas(row: dict[str, Any]) -> tuple[float, float, float]:
    """The σ of a row of `check`: of the heats their rms."""
    heat_W = np.sqrt(np.mean(np.square(list(row["heat_sigma_W"].values()))))
    return float(heat_W), row["field_sigma_K"], row["error_sigma_um"]


def draw(target: Path) -> None:
    """σ over the standard shift, as delivered, and the least that any linear filter could have."""
    learns = f"\n[estimator]\nlearn = {sorted(set(get_args(Learnable)) - {'law'})}\n".replace("'", '"')
    delivered, least = (
        {row["key"]: sigmas(row) for row in tolerances(config_of(CONFIG, more))["tolerances"]}
        for more in ("", learns)
    )
    figure = Figure(figsize=(9.0, 3.4), layout="constrained")
    y = np.arange(len(SAID))[::-1]
    for i, (axes, title) in enumerate(zip(figure.subplots(1, 3, sharey=True), QUANTITIES, strict=True)):
        axes.barh(y, [delivered[key][i] for key in SAID], color=CATEGORIES[0], label="as delivered")
        bound = [least[key][i] for key in SAID]
        axes.plot(bound, y, "|", ms=14, mew=2, color=CATEGORIES[1], label="everything learnt: the least")
        axes.set_title(f"σ of {title}", fontsize="medium")
        axes.spines[["top", "right"]].set_visible(False)
        axes.set_yticks(y, list(SAID.values()))
    heats = figure.axes[0]
    heats.axvline(1.5 * delivered["all"][0], color="0.4", lw=0.8, ls="--")
    heats.annotate("1.5 × known", (1.5 * delivered["all"][0], -0.75), fontsize="x-small", color="0.4")
    handles, names = heats.get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=2, frameon=False)
    for key in SAID:
        print(key, *(f"{a:.3g} ({b:.3g})" for a, b in zip(delivered[key], least[key], strict=True)))
    FigureCanvasAgg(figure).print_png(str(target))


if __name__ == "__main__":
    draw(HERE / "tolerances.png")
