"""Draw the figures of docs/explanation/kims-figures.md: `make figures`.

The example of section 4 is a rod with both ends held at their temperature, one source at a_H = 0.1 L and one
sensor at b_T = 0.43 L. It is dimensionless: L = α = kA = 1, so times are τ = α t/L².
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import mpmath
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
sys.path.insert(0, str(ROOT))

import observer  # noqa: E402
from observer import installation  # noqa: E402
from observer.estimators import build_estimator  # noqa: E402
from observer.estimators.design.gains import kim_poles  # noqa: E402
from observer.frames import EstimateBlock, FloatArray, Inputs, Quality  # noqa: E402
from observer.model import simulate  # noqa: E402
from observer.model.build import build_plant  # noqa: E402
from observer.model.law import heat_law  # noqa: E402
from observer.model.plant import Plant  # noqa: E402
from observer.model.rod.modes import (  # noqa: E402  # noqa: E402
    Modes,
    Stretch,
    contributions,
    keep_by_ratio,
    keep_by_tail,
    modal_input,
    solve_modes,
    source_field,
)
from observer.model.rod.screw import End, Rod  # noqa: E402
from tests.reference.printed import kim_gains, kim_gains_printed  # noqa: E402
from tests.truth.bar import Bar, Mesh  # noqa: E402
from tests.truth.closed_forms import prescribed_rod  # noqa: E402
from tests.truth.rod import Heat  # noqa: E402
from tests.truth.rod import simulate as simulate_truth  # noqa: E402

BETA = 0.9995
SOURCE, SENSOR = 0.1, 0.43
ROD = Rod(1.0, 1.0, 1.0, 0.0, End(math.inf), End(math.inf))


def new_figure(columns: int, height: float = 3.4) -> tuple[Figure, list]:
    """An empty figure with `columns` axes side by side."""
    figure = Figure(figsize=(4.6 * columns, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure, list(np.atleast_1d(figure.subplots(1, columns)))


def save(figure: Figure, name: str) -> None:
    """Write a PNG beside this file, the same bytes for the same picture."""
    figure.savefig(HERE / name, dpi=110, metadata={"Software": None})


def modes_kept(place: float, rule: str = "kim") -> list[int]:
    """Numbers (from 1) of the modes kept for a source at `place`, by Kim's ratio or by the tail."""
    keep = {"kim": keep_by_ratio, "tail": keep_by_tail}[rule]
    return [i + 1 for i in keep(solve_modes(ROD, 60), Stretch(place, place), BETA)]


def field_after_step(modes: Modes, place: float, x: FloatArray, tau: float) -> FloatArray:
    """Rise (k,) at time τ after a source of 1 was switched on, by the given modes alone (Kim, eq. 14)."""
    amplitude = contributions(modes, Stretch(place, place)) * -np.expm1(-modes.decay_1_s * tau)
    return modes.theta(x) @ amplitude


def draw_truncation() -> None:
    """Kim's figures 3 and 4, and what his criterion keeps."""
    figure, (ratio, field) = new_figure(2)
    modes = solve_modes(ROD, 400)
    for place in (0.05, 0.1, 0.35, 0.5):
        share = contributions(modes, Stretch(place, place))
        present = np.flatnonzero(np.abs(share) > 1e-9 * np.abs(share).max())[:14]  # none with a node there
        s = np.sqrt(np.cumsum(share[present] ** 2))
        label = f"$a_H$ = {place} L: {len(modes_kept(place))} modes"
        ratio.semilogy(present[:-1] + 1, 1 - s[:-1] / s[1:], ".-", lw=0.8, label=label)
    ratio.axhline(1 - BETA, color="k", ls=":", lw=1)
    ratio.set(xlabel="N", ylabel=r"1 − $s_N/s_{N+1}$", xlim=(0.5, 16), ylim=(1e-5, 1))
    ratio.set_title(f"Kim's ratio, β = {BETA}")
    ratio.legend(fontsize=8)
    x = np.linspace(0, 1, 401)
    few = modes.take(np.arange(7))
    for tau in (0.005, 0.02, 0.1, 1.0):
        exact = field_after_step(modes, SOURCE, x, tau)
        line = field.plot(x, exact, lw=1, label=f"τ = {tau}")[0]
        field.plot(x[::20], field_after_step(few, SOURCE, x[::20], tau), "o", ms=3, color=line.get_color())
    field.plot(x, source_field(ROD, Stretch(SOURCE, SOURCE), x), "k:", lw=1, label="steady, closed form")
    field.set(xlabel="x/L", ylabel="rise per q/(kA/L)", title="lines 400 modes, dots the 7 kept")
    field.legend(fontsize=8)
    save(figure, "kim-truncation.png")


@dataclass(frozen=True, slots=True)
class Gains:
    """The gains of Kim's example by both formulas, and the poles of the stored closed-form gains.

    `reached` has them with 80 digits, `in_double` as a routine in double precision gives them.
    """

    printed: FloatArray
    closed: FloatArray
    requested: FloatArray
    reached: FloatArray
    in_double: FloatArray


def example_gains() -> Gains:
    """Seven modes, one sensor, one heat, poles by rule (27)."""
    modes = solve_modes(ROD, 7)
    B, C = modal_input(modes, Stretch(SOURCE, SOURCE)), modes.theta(SENSOR)[0]
    poles = kim_poles(modes.decay_1_s, 1.0)
    L, k = kim_gains(modes.decay_1_s, B, C, poles)
    L_printed, k_printed = kim_gains_printed(modes.decay_1_s, B, C, poles)
    closed_loop = np.zeros((8, 8))
    closed_loop[:7, :7] = -np.diag(modes.decay_1_s) - np.outer(L, C)
    closed_loop[:7, 7] = B
    closed_loop[7, :7] = -k * C
    with mpmath.workdps(80):
        decay, L_exact, C_exact = (mpmath.diag(a.tolist()) for a in (modes.decay_1_s, L, C))
        exact = mpmath.matrix(closed_loop.tolist())
        exact[:7, :7] = -decay - L_exact * mpmath.ones(7) * C_exact
        exact[7, :7] = -mpmath.mpf(float(k)) * mpmath.ones(1, 7) * C_exact
        reached = np.array([complex(p) for p in mpmath.eig(exact, left=False, right=False)])
    stored = np.append(L_printed, k_printed), np.append(L, k)
    return Gains(*stored, poles, reached, np.linalg.eigvals(closed_loop))


def draw_gains() -> None:
    """The gains by both formulas, and the poles that they have."""
    gains = example_gains()
    figure, (sizes, plane) = new_figure(2)
    names = [f"$L_{i}$" for i in range(1, 8)] + ["$k$"]
    sizes.semilogy(names, np.abs(gains.closed), "o", mfc="none", ms=9, label="closed form")
    sizes.semilogy(names, np.abs(gains.printed), "x", label="printed formula (25)")
    sizes.set(title="size of the gains", ylabel="dimensionless")
    sizes.legend(fontsize=8)
    plane.plot(gains.requested, np.zeros(8), "o", mfc="none", ms=9, label="requested, rule (27)")
    plane.plot(gains.reached.real, gains.reached.imag, "x", label="of the stored gains, 80 digits")
    plane.plot(gains.in_double.real, gains.in_double.imag, ".", label="as double precision computes them")
    plane.set(title="poles, in units of α/L²", xlabel="real part", ylabel="imaginary part")
    plane.legend(fontsize=8)
    save(figure, "kim-gains.png")


@dataclass(frozen=True, slots=True)
class Run:
    """A run of the observer on the ball screw: true heats (m,), true field (K, g), and what was estimated."""

    heat_W: FloatArray
    field_degC: FloatArray
    plant: Plant
    estimate: EstimateBlock


def ball_screw_run(steps: int = 60, *, default_bandwidth: bool = False) -> Run:
    """The screw of table 1 from rest at 500 rpm; the observer knows no heat law and starts from 0 W.

    The bandwidth is that of `config/kim-screw.toml`, or the one that is taken where none is given.
    """
    settings = installation.load(HERE.parents[1] / "config" / "kim-screw.toml")
    plant = build_plant(settings)
    design = settings.estimator
    if default_bandwidth:
        design = design.model_copy(update={"bandwidth_1_s": None})
    speed_rpm = np.array([500.0])
    heat_W = np.concatenate(
        [heat_law(source, settings.source, settings.screw.length_m)(speed_rpm) for source in settings.source]
    )
    blind = _inputs(plant, settings.estimator.period_s, steps, 20.0)
    still = simulate.start(plant, 20.0, np.zeros(len(heat_W)))
    _, rows = simulate.simulate(plant, still, blind._replace(law_W=np.tile(heat_W, (steps, 1))))
    seen = blind._replace(y_degC=rows[:, plant.rows.sensor_slice], usable=np.ones_like(blind.usable))
    estimator = build_estimator(plant, design)
    _, estimate = estimator.run(estimator.initial(), seen)
    return Run(heat_W, rows[:, plant.rows.field_slice], plant, estimate)


def _inputs(plant: Plant, period_s: float, steps: int, ambient_degC: float) -> Inputs:
    """Inputs without heats and without measurements."""
    n_x, m, s = len(plant.decay_1_s), len(plant.source_names), plant.rows.sensors
    z = np.full((steps, len(plant.known_names)), ambient_degC)
    return Inputs(
        time_s=period_s * np.arange(steps),
        dt_s=period_s * (np.arange(steps) > 0),
        y_degC=np.full((steps, s), np.nan),
        usable=np.zeros((steps, s), dtype=np.bool_),
        quality=np.full((steps, s), int(Quality.GOOD), dtype=np.int8),
        law_W=np.zeros((steps, m)),
        law_jump_W=np.zeros((steps, m)),
        z_start=z,
        z_end=z,
        moving_B=np.zeros((steps, 0, n_x)),
        moving_C=np.zeros((steps, 0, len(plant.rows.C))),
        degraded=np.zeros(steps, dtype=np.bool_),
        loss_1_s=np.zeros(steps),
        loss_degC=np.zeros(steps),
    )


def draw_ball_screw() -> None:
    """Kim's figures 8 to 10: heats and field of the ball screw, estimated."""
    run, slower = ball_screw_run(), ball_screw_run(default_bandwidth=True)
    figure, (heats, field) = new_figure(2)
    step = np.arange(len(run.estimate))
    for j, (name, mark) in enumerate(zip(run.plant.layout.sources, ".x+", strict=True)):
        label = name.replace("_", " ")
        line = heats.plot(step, run.estimate.heat_W[:, j], mark, ms=4, ls="-", lw=0.8, label=label)[0]
        heats.plot(step, slower.estimate.heat_W[:, j], "--", lw=0.8, color=line.get_color())
        heats.axhline(run.heat_W[j], color=line.get_color(), ls=":", lw=1)
    heats.axvline(20, color="0.8", lw=1)
    heats.set(xlabel="step of 20 s", ylabel="heat, W", title="heats; dashed: default bandwidth, dotted: true")
    heats.legend(fontsize=8)
    x_mm = 1000 * run.plant.layout.position_m
    for k in (5, 10, 20, 59):
        line = field.plot(x_mm, run.field_degC[k], lw=1, label=f"step {k}")[0]
        field.plot(x_mm, run.estimate.field_degC[k], "o", ms=3, color=line.get_color())
    field.set(xlabel="position, mm", ylabel="temperature, °C", title="lines true, dots estimated")
    field.legend(fontsize=8)
    save(figure, "kim-ball-screw.png")


def printed_rule(tau: list[float], digits: int = 60) -> list[float]:
    """The heat that Kim's observer estimates at times τ after a heat of 1 was switched on, by poles (27),
    with so many digits: 1 and what the error's equation (24) makes of e(0) = (0, −1).
    """
    with mpmath.workdps(digits):
        decay = [(i * mpmath.pi) ** 2 for i in range(1, 8)]
        B, C = (
            [mpmath.sqrt(2) * mpmath.sin(i * mpmath.pi * x) for i in range(1, 8)]
            for x in (mpmath.mpf(SOURCE), mpmath.mpf(SENSOR))
        )
        rates = [*(-d for d in decay), mpmath.mpf(0)]
        poles = [-(3 * decay[-1] + i) for i in range(8)]
        seen = [*C, mpmath.fsum(b * c / d for b, c, d in zip(B, C, decay, strict=True))]
        g = [
            mpmath.fprod(own - p for p in poles)
            / (c * mpmath.fprod(own - other for other in rates if other != own))
            for own, c in zip(rates, seen, strict=True)
        ]
        k, error = g[7], mpmath.matrix(8, 8)
        for i in range(7):
            L = g[i] + B[i] / decay[i] * k
            for j in range(7):
                error[i, j] = -L * C[j]
            error[i, i] -= decay[i]
            error[i, 7], error[7, i] = B[i], -k * C[i]
        begin = mpmath.matrix([0] * 7 + [-1])
        return [1.0 + float((mpmath.expm(error * mpmath.mpf(t)) * begin)[7]) for t in tau]


HEAT_W = 50.0


class RodRun(NamedTuple):
    """The rod of figure 5, 50 W from the start: at each step (K,) the true temperature at the thermocouple
    and the true field (K, g), in closed form, and what was estimated.
    """

    sensor_degC: FloatArray
    field_degC: FloatArray
    estimates: observer.Estimates


def rod_run(steps: int = 41) -> RodRun:
    """`config/kim-rod.toml` on readings by the rod's Fourier series; the log says nothing of the heat."""
    machine = observer.load(ROOT / "config" / "kim-rod.toml")
    screw, config = machine.config.screw, machine.config
    bar = Bar(
        screw.length_m, screw.diameter_m, screw.conductivity_W_mK, screw.density_kg_m3,
        screw.specific_heat_J_kgK, 0.0,
    )  # fmt: skip
    time_s = config.estimator.period_s * np.arange(steps)
    x_m, at_m = screw.length_m * np.append(SENSOR, np.linspace(0.0, 1.0, 21)), screw.length_m * SOURCE
    rise = [np.zeros(22), *(prescribed_rod(bar, at_m, HEAT_W, x_m, t) for t in time_s[1:].tolist())]
    true_degC = 20.0 + np.array(rise)
    still = np.full(steps, 20.0)
    log = {"time_s": time_s, "t1_degC": true_degC[:, 0], "left_degC": still, "right_degC": still}
    estimates = machine.replay(log | {"heater_W": np.zeros(steps)})
    return RodRun(true_degC[:, 0], true_degC[:, 1:], estimates)


def draw_figure_5() -> None:
    """Kim's figure 5: heat, temperatures and their estimates, by his poles and by the default."""
    run = rod_run()
    figure, (printed, heat, field) = new_figure(3)
    tau = np.concatenate([[0.0], np.geomspace(1e-5, 0.03, 120)])
    printed.plot(tau, printed_rule(tau.tolist()), lw=1)
    printed.axhline(1.0, color="k", ls=":", lw=1)
    printed.set_yscale("symlog", linthresh=2.0)
    printed.set(xlabel="τ = α t/L²", ylabel="heat over the true heat", title="poles (27), in 60 digits")
    step = np.arange(len(run.sensor_degC))
    heat.plot(step, run.estimates["heat_heater_W"], "o", ms=3, mfc="none", label="estimated")
    heat.axhline(HEAT_W, color="k", lw=1, label="true")
    heat.set(xlabel="step of 120 s", ylabel="heat, W", title="heat, config/kim-rod.toml")
    heat.legend(fontsize=8)
    x_mm = np.linspace(0.0, 600.0, 21)
    for k in (5, 10, 20, 40):
        line = field.plot(x_mm, run.field_degC[k], lw=1, label=f"step {k}")[0]
        field.plot(x_mm, field_at(run.estimates, k), "o", ms=3, mfc="none", color=line.get_color())
    field.set(xlabel="position, mm", ylabel="temperature, °C", title="lines exact series, dots estimated")
    field.legend(fontsize=8)
    save(figure, "kim-figure-5.png")


def field_at(estimates: observer.Estimates, k: int) -> FloatArray:
    """The field (g,) estimated at a step."""
    names = [n for n in estimates.signals if n.startswith("field_") and n.endswith("_degC")]
    return np.array([estimates[n][k] for n in names])


SPEEDS_RPM, STAGE_STEPS = (500.0, 1000.0, 250.0), 50
TRUE_TORQUE_NM = 0.45


class SpeedsRun(NamedTuple):
    """The ball screw at several speeds: the nut's true heat (K,), the true field (K, g), the estimates."""

    heat_W: FloatArray
    field_degC: FloatArray
    estimates: observer.Estimates


def speeds_run() -> SpeedsRun:
    """`config/kim-screw-one.toml` on readings of a finite-volume screw that rubs half as much again."""
    machine = observer.load(ROOT / "config" / "kim-screw-one.toml")
    config, screw = machine.config, machine.config.screw
    period_s = config.estimator.period_s
    speed_rpm = np.repeat(SPEEDS_RPM, STAGE_STEPS)
    time_s = period_s * np.arange(len(speed_rpm) + 1)
    heat_W = math.pi / 30.0 * speed_rpm * TRUE_TORQUE_NM * 0.3 / screw.length_m
    bar = Bar(
        screw.length_m, screw.diameter_m, screw.conductivity_W_mK, screw.density_kg_m3,
        screw.specific_heat_J_kgK, config.surface.convection_W_m2K,
    )  # fmt: skip
    mesh = Mesh(screw.length_m, 500)
    inside = (mesh.centres_m > 0.1) & (mesh.centres_m < 0.4)
    ends = [np.eye(len(inside))[i] for i in (0, -1)]
    heats = [Heat(inside / inside.sum(), heat_W), *(Heat(end, heat_W / 3.0) for end in ends)]
    x_m = np.append(0.215, np.linspace(0.0, screw.length_m, 21))
    true = simulate_truth(bar, mesh, time_s, heats, x_m).temperature_degC[..., 0]
    log = {"time_s": time_s, "t1_degC": true[:, 0], "screw_speed_rpm": np.append(speed_rpm[0], speed_rpm)}
    return SpeedsRun(np.append(heat_W[0], heat_W), true[:, 1:], machine.replay(log))


def draw_speeds() -> None:
    """One unknown and one thermocouple, at three speeds."""
    run = speeds_run()
    figure, (heats, field) = new_figure(2)
    step = np.arange(len(run.heat_W))
    for name, part in (("nut", 1.0), ("left_bearing", 1 / 3)):
        line = heats.plot(step, part * run.heat_W, lw=1)[0]
        ink = {"mfc": "none", "color": line.get_color()}
        heats.plot(step, run.estimates[f"heat_{name}_W"], "o", ms=3, label=name.replace("_", " "), **ink)
    heats.set(xlabel="step of 60 s", ylabel="heat, W", title="500, 1000, 250 rpm; lines true, dots estimated")
    heats.legend(fontsize=8)
    x_mm = np.linspace(0.0, 500.0, 21)
    for stage, speed_rpm in enumerate(SPEEDS_RPM, 1):
        k = stage * STAGE_STEPS
        line = field.plot(x_mm, run.field_degC[k], lw=1, label=f"{speed_rpm:.0f} rpm, step {k}")[0]
        field.plot(x_mm, field_at(run.estimates, k), "o", ms=3, mfc="none", color=line.get_color())
    field.set(xlabel="position, mm", ylabel="temperature, °C", title="lines finite volumes, dots estimated")
    field.legend(fontsize=8)
    save(figure, "kim-speeds.png")


def main() -> None:
    """Draw all figures."""
    draw_truncation()
    draw_gains()
    draw_figure_5()
    draw_ball_screw()
    draw_speeds()


if __name__ == "__main__":
    main()
