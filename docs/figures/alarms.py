"""Draw a heat that falls with its preload, what the service knows of it, and its alarm: `make figures`."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from campaigns.alarms.months import Story, months
from campaigns.alarms.trial import SEED
from observer.config.publishing import AlarmSettings
from observer.quality import bands
from observer.report.panels import CATEGORIES

HERE = Path(__file__).parent
STORY = Story(lost=0.75, loses_h=200.0)


def draw(target: Path, seed: int = SEED) -> None:
    """The true heat and the one that is known of, over what was learnt, by hours of running."""
    settings, band = AlarmSettings(), bands.nothing_known()
    rows, reported_h = list[tuple[float, float, float, float]](), math.nan
    for sample in months(STORY, seed):
        band = bands.learnt(band, sample.window, settings.learn_h, settings.deadband)
        if band.running_h < settings.learn_h:
            continue
        if band.side < 0 and math.isnan(reported_h):
            reported_h = sample.running_h
        limit = max(math.log1p(settings.deadband), bands.SIGMAS * bands.sigma_of(band))
        known = math.exp(bands.more_than_usual(band))
        rows.append((sample.running_h, sample.factor, known, math.exp(-limit)))
    hours, true, known_of, limits = np.array(rows).T
    figure = Figure(figsize=(8.0, 3.6), layout="constrained")
    axes = figure.subplots()
    axes.plot(hours, known_of, color=CATEGORIES[0], lw=1.0, label="the heat as it is known")
    axes.plot(hours, true, color=CATEGORIES[1], lw=1.5, label="true")
    axes.plot(hours, limits, color="0.4", lw=0.8, ls="--", label="limit of heat_low")
    axes.axvline(reported_h, color="0.4", lw=0.8)
    axes.annotate(" heat_low", (reported_h, 1.05), color="0.3")
    axes.axhline(0.5, color="0.8", lw=0.8, zorder=0)
    axes.set_xlim(settings.learn_h, STORY.begins_h + STORY.loses_h + 20.0)
    axes.set_ylim(0.0, 1.35)
    axes.set_xlabel("hours of running")
    axes.set_ylabel("heat over the usual")
    axes.legend(loc="lower left", frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    FigureCanvasAgg(figure).print_png(str(target))


if __name__ == "__main__":
    draw(HERE / "alarms-preload.png")
