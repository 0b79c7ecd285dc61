"""Draw the gallery: each shipped configuration as a drawing, and what its heat laws predict: `make figures`.

The programme is the same for all: two hours at constant speed, the nut to and fro over its stroke, then half
an hour of rest.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch, Rectangle

import observer
from observer import installation
from observer.config.machine import Config
from observer.files.logs import Log, read_log
from observer.files.writer import write_log
from observer.frames import FloatArray
from observer.model.rod.modes import mean_stretch

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
# Where each configuration is, and the speed that its machine runs at, rpm; 0 is a rod with a heater.
MACHINES = {
    "demo": ("config/demo.toml", 2000.0),
    "demo-housings": ("config/demo-housings.toml", 2000.0),
    "rig": ("tests/data/rig/config.toml", 1500.0),
    "kim-screw": ("config/kim-screw.toml", 500.0),
    "kim-rod": ("config/kim-rod.toml", 0.0),
    "kim-screw-one": ("config/kim-screw-one.toml", 500.0),
    "li-lathe-axis": ("config/li-lathe-axis.toml", 1000.0),
    "li-network": ("config/li-network.toml", 1000.0),
    "yu-dual-drive": ("config/yu-dual-drive.toml", 600.0),
    "kuznetsov-screw": ("config/kuznetsov-screw.toml", 600.0),
    "stepped-screw": ("config/stepped-screw.toml", 1500.0),
    "cooled-screw": ("config/cooled-screw.toml", 1500.0),
}
RUN_S, REST_S, STEP_S, THERE_AND_BACK_S = 7200.0, 1800.0, 5.0, 60.0
POWER_W = 50.0
SHOWN_MIN = (10.0, 30.0, 120.0, 150.0)
STEEL, HEAT, COLD, SENSOR, NUT = "#9aa5b1", "#d55e00", "#56b4e9", "#0072b2", "#e69f00"


def draw(name: str, target: Path) -> None:
    """A machine's drawing above its temperature and its thermal error along the screw."""
    place, speed_rpm = MACHINES[name]
    config = installation.load(ROOT / place)
    log = predicted(config, speed_rpm)
    figure = Figure(figsize=(9.6, 6.4), layout="constrained")
    FigureCanvasAgg(figure)
    figure.get_layout_engine().set(wspace=0.08, w_pad=0.1, h_pad=0.08)
    drawing, below = figure.add_gridspec(2, 1, height_ratios=(1.0, 1.9))
    sketch(figure.add_subplot(drawing), config)
    field, error = below.subgridspec(1, 2).subplots()
    along(field, log, "field", "degC", "temperature in °C")
    along(error, log, "error", "um", "thermal error in µm")
    error.legend(title="minutes", frameon=False, fontsize=8, title_fontsize=8, loc="upper left")
    said = f"{speed_rpm:.0f} rpm" if speed_rpm else f"{POWER_W:.0f} W"
    field.set_title(f"{said} for two hours, then half an hour of rest", fontsize=9, loc="left")
    figure.savefig(target, dpi=100, metadata={"Software": None})


def predicted(config: Any, speed_rpm: float) -> Log:
    """What `observer simulate` writes for the programme."""
    time_s = np.arange(0.0, RUN_S + REST_S + STEP_S, STEP_S)
    with tempfile.TemporaryDirectory() as scratch:
        program = Path(scratch) / "program.parquet"
        write_log(program, time_s, inputs(config, time_s, speed_rpm))
        run = observer.Machine(config, b"").simulate(program)
        run.write(scratch, "log.parquet")
        return read_log(Path(scratch) / "log.parquet")


def inputs(config: Config, time_s: FloatArray, speed_rpm: float) -> dict[str, FloatArray]:
    """A column for each channel but those of sensors."""
    runs = time_s < RUN_S
    share = np.abs(2.0 * (time_s / THERE_AND_BACK_S % 1.0) - 1.0)  # of the stroke, from its end and back
    columns = {}
    sensors = {sensor.channel for sensor in config.sensor}
    for channel in config.channels:
        if channel.endswith("_rpm"):
            columns[channel] = np.where(runs, speed_rpm, 0.0)
        elif channel.endswith("_m"):
            low, high = next(
                s.stroke_m or (0.0, config.screw.length_m)
                for s in config.source
                if s.position_channel == channel
            )
            columns[channel] = np.where(runs, low + (high - low) * share, low)
        elif channel.endswith("_W"):
            columns[channel] = np.where(runs, POWER_W, 0.0)
        elif channel not in sensors:
            columns[channel] = np.full_like(time_s, 20.0 if channel.startswith("coolant") else 25.0)
    return columns


def along(axes: Axes, log: Log, quantity: str, unit: str, label: str) -> None:
    """A quantity over the position, at some times."""
    names = [n for n in log.channels if n.startswith(f"{quantity}_") and n.endswith(f"_{unit}")]
    position_m = [float(n.split("_")[1]) / 1000.0 for n in names]
    columns = [log.channels.index(n) for n in names]
    for i, minute in enumerate(SHOWN_MIN):
        row = log.values[int(np.searchsorted(log.time_s, 60.0 * minute)), columns]
        rest = minute * 60.0 > RUN_S
        axes.plot(
            position_m, row, color=COLD if rest else HEAT, alpha=1.0 if rest else 0.4 + 0.2 * (i + 1),
            linestyle="--" if rest else "-", label=f"{minute:.0f}{' (at rest)' if rest else ''}",
        )  # fmt: skip
    axes.set_xlabel("position in m")
    axes.set_ylabel(label)
    axes.spines[["top", "right"]].set_visible(False)


def sketch(axes: Axes, config: Config) -> None:
    """The screw with its nut, heats and sensors, to scale along its length."""
    length_m = config.screw.length_m
    for piece in config.screw.pieces:
        of_screw = 0.24 / config.screw.diameter_m
        for across, paint in (
            (piece.diameter_m * of_screw, {"color": STEEL, "lw": 0, "hatch": "////", "ec": "white"}),
            (0.0 if config.screw.uniform else piece.bore_m * of_screw, {"color": "white", "lw": 0}),
        ):
            if across:
                axes.add_patch(
                    Rectangle((piece.from_m, -across / 2), piece.to_m - piece.from_m, across, **paint)
                )
    for source in config.source:
        if source.shape == "nut":
            low, high = source.stroke_m or (0.0, length_m)
            middle, nut_m = 0.5 * (low + high), source.length_m or 0.08
            axes.annotate(
                "", (high, -0.62), (low, -0.62), arrowprops={"arrowstyle": "<->", "color": NUT, "lw": 1.5}
            )
            axes.add_patch(
                FancyBboxPatch(
                    (middle - nut_m / 2, -0.36), nut_m, 0.72, boxstyle="round,pad=0,rounding_size=0.01",
                    facecolor="none", edgecolor=NUT, lw=2,
                )
            )  # fmt: skip
            axes.text(
                middle, -0.70, f"{source.name}, stroke {1000 * (high - low):.0f} mm", ha="center", va="top"
            )
        elif (place_m := mean_stretch(source, config.screw)) and source.shape != "node":
            x_m = 0.5 * (place_m.a_m + place_m.b_m)
            axes.annotate(
                source.name.replace("_", " "), (x_m, -0.14), (x_m, -0.72),
                arrowprops={"arrowstyle": "->", "color": HEAT, "lw": 2}, ha="center", va="top", color=HEAT,
            )  # fmt: skip
    for sensor in config.sensor:
        if sensor.position_m is not None:
            axes.plot(sensor.position_m, 0.24, "v", color=SENSOR, ms=8, clip_on=False)
            axes.text(sensor.position_m, 0.42, sensor.name, ha="center", color=SENSOR)
    beside = [s.name for s in config.sensor if s.position_m is None]
    axes.set_title(
        f"{config.machine.name}, axis {config.machine.axis}: {1000 * length_m:.0f} mm long, "
        f"{1000 * config.screw.diameter_m:.0f} mm thick"
        + (f"; sensors on bodies: {', '.join(beside)}" if beside else ""),
        loc="left", fontsize=10,
    )  # fmt: skip
    axes.set_xlim(-0.04 * length_m, 1.04 * length_m)
    axes.set_ylim(-1.1, 0.7)
    axes.axis("off")


if __name__ == "__main__":
    for machine in sys.argv[1:] or MACHINES:
        draw(machine, HERE / f"gallery-{machine}.png")
