"""Draw the figures of docs/explanation/heat-history.md and print its table: `make figures`.

The logs are simulated by the finite volumes of `tests/truth`, which share no code with the product.
"""

from __future__ import annotations

import sys
import time
import tracemalloc
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parents[1]))

from observer import installation  # noqa: E402
from observer.config.machine import EstimatorSettings  # noqa: E402
from observer.frames import FloatArray  # noqa: E402
from observer.history.history import HeatHistory, MethodOptions  # noqa: E402
from observer.history.identify import heat_history  # noqa: E402
from observer.history.tikhonov import (  # noqa: E402
    BENDS,
    Regularised,
    by_discrepancy,
    by_gcv,
    by_ico,
    by_l_curve,
    trials,
)
from observer.library.heats import identified_heats  # noqa: E402
from observer.library.profiles import ReportGrid, profiles  # noqa: E402
from observer.model.build import build_plant  # noqa: E402
from observer.report.panels import (  # noqa: E402
    CATEGORIES,
    QUIET,
    Z95,
)
from observer.report.profiles import draw_profiles  # noqa: E402
from tests.reference.heat_cases import FAR_M, NEAR_M, HeatCase, lathe_case, li_experiment, standing_case  # noqa: E402
from tests.reference.service_path import inputs_of  # noqa: E402

STEPS, STEP_S = 300, 20.0
LI = HERE.parents[1] / "config" / "li-lathe-axis.toml"
METHODS: dict[str, dict[str, Any]] = {
    "smoother": {},
    "Tikhonov, order 1, α as configured": {"method": "tikhonov", "regularisation": 1.0},
    "Tikhonov, order 1, GCV": {"method": "tikhonov", "parameter_choice": "gcv"},
    "Tikhonov, order 1, discrepancy": {"method": "tikhonov", "parameter_choice": "discrepancy"},
    "Tikhonov, order 1, L-curve": {"method": "tikhonov", "parameter_choice": "l-curve"},
    "Tikhonov, order 1, ICO": {"method": "tikhonov", "parameter_choice": "ico"},
    "Tikhonov, order 0, GCV": {"method": "tikhonov", "order": 0, "parameter_choice": "gcv"},
    "Tikhonov, order 0, discrepancy": {"method": "tikhonov", "order": 0, "parameter_choice": "discrepancy"},
    "Tikhonov, order 0, L-curve": {"method": "tikhonov", "order": 0, "parameter_choice": "l-curve"},
    "Tikhonov, order 0, ICO (Li, as printed)": {"method": "tikhonov", "order": 0, "parameter_choice": "ico"},
    "conjugate gradients, order 1": {"method": "conjugate-gradient"},
    "conjugate gradients, order 0": {"method": "conjugate-gradient", "order": 0},
    "conjugate gradients, step by step (Lathe, as printed)": {
        "method": "conjugate-gradient",
        "gradient": "central-differences",
    },
}


@dataclass(frozen=True, slots=True)
class Row:
    """One line of the table: errors (m,) rms over all logs, seconds and megabytes for one log."""

    method: str
    error_W: FloatArray
    seconds: float
    peak_MB: float


def found(case: HeatCase, seed: int, options: dict[str, Any]) -> HeatHistory:
    """A history by the method that the options name, with the noise of one seed."""
    settings = EstimatorSettings()
    return heat_history(case.plant, settings, [case.inputs(seed)], MethodOptions(**options))


def error_W(case: HeatCase, seeds: range, options: dict[str, Any]) -> FloatArray:
    """The errors (m,) of the method that the options name, rms over all noisy logs."""
    errors = [found(case, seed, options).heat_W - case.heat_W for seed in seeds]
    return np.asarray(np.sqrt(np.mean(np.stack(errors)[:, 2:-2] ** 2, axis=(0, 1))))


def compare(case: HeatCase, seeds: range) -> list[Row]:
    """All methods on the same noisy logs."""
    return [_row(case, seeds, name, options) for name, options in METHODS.items()]


def _row(case: HeatCase, seeds: range, name: str, options: dict[str, Any]) -> Row:
    found(case, seeds[0], options)
    started = time.process_time()
    off_W = error_W(case, seeds, options)
    seconds = (time.process_time() - started) / len(seeds)
    tracemalloc.start()
    found(case, seeds[0], options)
    peak_MB = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    return Row(name, off_W, seconds, peak_MB)


@dataclass(frozen=True, slots=True)
class Weights:
    """Errors of order 0 over its weight α, (n,) each, and where each rule puts it."""

    alpha: FloatArray
    error_W: FloatArray
    residual_K: FloatArray
    chosen: dict[str, float]


def weights(case: HeatCase, seed: int) -> Weights:
    """The nut's error and the residual over α for Li's own regularisation, and the rules' choices."""
    equation = Regularised(case.plant, EstimatorSettings(), [case.inputs(seed)], 0)
    alpha, errors, residuals = np.logspace(-6, 8, 43), [], []
    for a in alpha:
        found = equation.solve(float(a))
        errors.append(np.sqrt(np.mean((found.heat - case.heat_W)[2:-2, 0] ** 2)))
        residuals.append(np.sqrt(np.nanmean(found.residual**2)))
    trial, alphas = equation.trial, trials(equation.top)
    chosen = {
        "ICO": by_ico(trial, equation.top, seed)[0],
        "L-curve": by_l_curve(trial, trials(equation.top, BENDS)),
        "GCV": by_gcv(trial, alphas), "discrepancy": by_discrepancy(trial, alphas),
    }  # fmt: skip
    return Weights(alpha, np.array(errors), np.array(residuals), chosen)


def draw_methods() -> None:
    """The nut's heat by each method, and what the choice of α costs."""
    case = standing_case(STEPS, STEP_S)
    figure, (heats, choice) = _new_figure(2, 3.9)
    minutes = case.time_s / 60.0
    shown = (
        ("Tikhonov, order 0, ICO (Li, as printed)", CATEGORIES[4], 0.7),
        ("Tikhonov, order 0, GCV", CATEGORIES[3], 1.0),
        ("conjugate gradients, order 1", CATEGORIES[2], 1.0),
    )
    for name, colour, width in shown:
        heats.plot(minutes, found(case, 1, METHODS[name]).heat_W[:, 0], color=colour, lw=width, label=name)
    _with_band(heats, minutes, found(case, 1, {}), 0, CATEGORIES[0], "smoother, 95 %")
    heats.plot(minutes, case.heat_W[:, 0], "k:", lw=1.2, label="true")
    heats.set(xlabel="min", ylabel="W", title="Heat of the nut", ylim=(-15, 65))
    heats.legend(fontsize=7.5, loc="upper right")
    shown = weights(case, 1)
    choice.loglog(shown.alpha, shown.error_W, color=CATEGORIES[0], label="error of the nut's heat, W")
    choice.loglog(shown.alpha, shown.residual_K, color=CATEGORIES[1], label="unexplained temperature, K")
    for i, (name, alpha) in enumerate(shown.chosen.items()):
        choice.axvline(alpha, color=QUIET, lw=0.8, ls=(0, (4, 2)))
        choice.text(alpha, 30.0 / 2.2**i, f" {name}", fontsize=8, color=QUIET)
    choice.set(xlabel="α", title="Order 0: what each rule chooses", ylim=(0.05, 60))
    choice.legend(fontsize=7.5, loc="lower left")
    _save(figure, "heat-history-methods.png")


def draw_lathe() -> None:
    """Two near sensors and two far ones, by conjugate gradients and by the smoother."""
    figure, axes = _new_figure(2, 3.6)
    for ax, places, title in zip(
        axes, (NEAR_M, FAR_M), ("at the bearings", "beyond the rear one"), strict=True
    ):
        case = lathe_case(places)
        hours = case.time_s / 3600.0
        printed, smoothed = found(case, 1, METHODS["conjugate gradients, order 0"]), found(case, 1, {})
        for j, name in enumerate(("front", "rear")):
            _with_band(ax, hours, smoothed, j, CATEGORIES[j], f"{name}, smoother, 95 %")
            label = f"{name}, conjugate gradients"
            ax.plot(hours, printed.heat_W[:, j], color=CATEGORIES[j], lw=1.0, ls=(0, (4, 2)), label=label)
            ax.plot(hours, case.heat_W[:, j], "k:", lw=1.2, label="true" if j else None)
        ax.set(xlabel="h", ylabel="W", title=f"Two sensors {title}", ylim=(-320, 420))
    axes[1].legend(fontsize=7, loc="lower right", ncols=2)
    _save(figure, "heat-history-lathe.png")


def draw_li() -> None:
    """Li's experiment at three speeds, identified with the shipped configuration."""
    figure, axes = _new_figure(2, 3.6)
    settings = installation.load(LI)
    plant = build_plant(settings)
    for i, speed_m_min in enumerate((5.0, 10.0, 15.0)):
        truth = li_experiment(settings, speed_m_min / 60.0, seed=3)
        inputs = inputs_of(settings, plant, truth.log)
        history = heat_history(plant, settings.estimator, inputs, MethodOptions())
        minutes = truth.log.time_s / 60.0
        for ax, j in zip(axes, (0, 2), strict=True):
            _with_band(ax, minutes, history, j, CATEGORIES[i], f"{speed_m_min:.0f} m/min")
            ax.plot(minutes, truth.heat_W[:, j], "k:", lw=1.2, label=None if i < 2 else "true")
    for ax, name in zip(axes, ("Nut", "Motor bearing"), strict=True):
        ax.set(xlabel="min", ylabel="W", title=name)
    axes[0].legend(fontsize=8)
    _save(figure, "heat-history-li.png")


def draw_report() -> None:
    """What `observer identify --every-m 0.042` draws of an hour at 15 m/min."""
    settings = installation.load(LI)
    log = li_experiment(settings, 15.0 / 60.0, seed=105, run_s=3700.0, end_s=3600.0).log
    heats = identified_heats(log, settings, MethodOptions(), lambda _text: None)
    figure = Figure(figsize=(9.8, 7.0))
    FigureCanvasAgg(figure)
    draw_profiles(figure, profiles(log, settings, heats, ReportGrid(0.042)))
    _save(figure, "heat-history-report.png")


def _with_band(ax: Axes, x: FloatArray, history: HeatHistory, j: int, colour: str, label: str) -> None:
    heat, reach = history.heat_W[:, j], Z95 * history.heat_sigma_W[:, j]
    ax.fill_between(x, heat - reach, heat + reach, color=colour, alpha=0.18, lw=0)
    ax.plot(x, heat, color=colour, lw=1.3, label=label)


def _new_figure(columns: int, height: float) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(4.9 * columns, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, list(figure.subplots(1, columns))


def _save(figure: Figure, name: str) -> None:
    figure.savefig(HERE / name, dpi=110, metadata={"Software": None})


def print_table() -> None:
    """The page's table."""
    for row in compare(standing_case(STEPS, STEP_S), range(1, 11)):
        errors = " / ".join(f"{e:.2g}" for e in row.error_W)
        print(f"| {row.method} | {errors} | {1e3 * row.seconds:.0f} | {row.peak_MB:.0f} |")


def print_moving() -> None:
    """The page's table of long logs with a moving nut: bias and rms of its heat, seconds of a core."""
    settings = installation.load(LI)
    plant = build_plant(settings)
    for speed_m_min in (5.0, 15.0):
        truths = [
            li_experiment(settings, speed_m_min / 60.0, seed, run_s=9000.0, end_s=15000.0)
            for seed in (101, 102)
        ]
        for method in ("smoother", "tikhonov", "conjugate-gradient"):
            bias, stray, begin_s = [], [], time.process_time()
            for truth in truths:
                inputs = inputs_of(settings, plant, truth.log)
                history = heat_history(plant, settings.estimator, inputs, MethodOptions(method))
                true_W = truth.heat_W[120:18_000, 0]
                error_W = history.heat_W[120:18_000, 0] - true_W
                bias.append(abs(error_W.mean()) / true_W.mean())
                stray.append(np.sqrt(np.mean(error_W**2)) / true_W.mean())
            seconds = (time.process_time() - begin_s) / len(truths)
            shown = f"{100 * max(bias):.2g} | {100 * np.mean(stray):.2g} | {seconds:.2g}"
            print(f"| {speed_m_min:.0f} | {method} | {shown} |")


if __name__ == "__main__":
    draw_methods()
    draw_lathe()
    draw_li()
    draw_report()
    print_table()
    print_moving()
