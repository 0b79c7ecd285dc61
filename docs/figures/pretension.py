"""Draw a pre-stretched screw's axial force over a day of work, true and found: `make figures`."""

from __future__ import annotations

from pathlib import Path

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from observer.report.panels import CATEGORIES
from tests.learning.stretched import STRETCHED, stretched

HERE = Path(__file__).parent
SEED, NUMBER = 64_000, 0


def draw(target: Path) -> None:
    """Force and thermal error in the middle, with a pre-tension that lasts and one that does not."""
    figure = Figure(figsize=(9.6, 5.6), layout="constrained")
    for column, (words, supports) in zip(
        figure.subplots(2, 2, sharex=True).T, STRETCHED.items(), strict=True
    ):
        one = stretched(SEED, NUMBER, supports)
        for axes, true, mean, sigma in (
            (column[0], one.force_N, one.found.force_N[:, 0], one.found.force_sigma_N[:, 0]),
            (column[1], one.error_um, one.found.error_um[:, -1], one.found.error_sigma_um[:, -1]),
        ):
            axes.fill_between(
                one.hours, mean - 1.96 * sigma, mean + 1.96 * sigma, color=CATEGORIES[0], alpha=0.2, lw=0.0
            )
            axes.plot(one.hours, mean, color=CATEGORIES[0], lw=1.0, label="found, with 95 %")
            axes.plot(one.hours, true, color="black", lw=1.0, label="true")
            axes.margins(x=0.0)
            axes.spines[["top", "right"]].set_visible(False)
        column[0].axhline(0.0, color="0.6", lw=0.8, ls=":")
        column[0].set_title(words, fontsize=9)
        column[0].set_ylabel("axial force, N")
        column[1].set_ylabel("thermal error at 1000 mm, µm")
        column[1].set_xlabel("hours")
    column[0].legend(frameon=False, loc="upper right", fontsize=8)
    FigureCanvasAgg(figure).print_png(str(target))


if __name__ == "__main__":
    draw(HERE / "pretension.png")
