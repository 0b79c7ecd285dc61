"""The heats over a whole log at once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from observer.align.aligner import doubts, frames_of_log, read_in, refuse_implausible
from observer.align.plausibility import RATE_K_S
from observer.config.machine import Output
from observer.errors import LogError, UserError
from observer.estimate.pipeline import MachineModel
from observer.estimate.replay import heat_columns, history_summary, inputs_of, nut_paths, speeds
from observer.files.documents import write_json
from observer.files.folders import results_in
from observer.files.logs import Log
from observer.files.writer import arrow_table
from observer.frames import Inputs
from observer.history.history import HeatHistory, MethodOptions
from observer.history.identify import heat_history, refuse_diverged
from observer.history.tolerances import changes_within
from observer.installation import Installation
from observer.library.packages import in_words
from observer.library.signals import SignalTable
from observer.report.panels import Panel

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from observer.report.profiles import Profiles


@dataclass(frozen=True, eq=False, repr=False)
class IdentifiedHeats(SignalTable):
    """The heats over a log, each from all of its measurements: `heat_<source>_W` and
    `heat_<source>_sigma_W`.

    Attributes:
        summary: The content of `summary.json`: mean and peak heats in W, residuals in K, warnings, doubts.
    """

    summary: Mapping[str, Any]
    _config: Installation
    _history: HeatHistory
    _blocks: Sequence[Inputs]
    _profiles: Profiles | None = None

    def _draw(self, figure: Figure) -> list[Panel]:
        from observer.report.pictures import draw_heat_history

        by = f"by {self.summary['method']}"
        return draw_heat_history(figure, self._config, self._history, self._blocks, self._title, by)

    @in_words
    def write(self, folder: str | Path, format: str = "csv", *, picture: bool = True) -> None:
        """Write `heat.csv` (or `.parquet` by `format`), `summary.json` and `heat.png` into a folder.

        With a report also `report.csv`, a row for each time and place, and `report.png`.

        Args:
            folder: Is created if it is missing; files of the same names are replaced.
            format: `csv`, `csv.gz` or `parquet`.
            picture: Draw `heat.png`.

        Raises:
            UserError: The folder cannot be written; then it is as it was before.
        """
        from observer.library.profiles import write_report

        with results_in(Path(folder)) as part:
            self._write_table(part / f"heat.{format}")
            write_json(part / "summary.json", self.summary)
            if picture:
                self._write_picture(part / "heat.png")
            if self._profiles is not None:
                write_report(self._profiles, part)


def identified_heats(
    log: Log, config: Installation, options: MethodOptions, progress: Callable[[str], None]
) -> IdentifiedHeats:
    """Estimate the heats of a whole log, each from all measurements before and after it.

    σ includes the configured tolerances; the part of them that the log determines is removed from the
    readings first.

    Args:
        log: The log, with the configuration's channels.
        config: The machine.
        options: The method with its options.
        progress: Receives the stage of the work.

    Raises:
        LogError: The method cannot use this log, a temperature is beyond its limits throughout, or no sensor
            has a value while all inputs are known.
    """
    # no field is reported, so the inputs of a long log need not carry its rows
    ends_only = Output(positions_m=(0.0, config.screw.length_m))
    machine = MachineModel.of(config.model_copy(update={"output": ends_only}))
    refuse_implausible(log, config)
    frames = list(frames_of_log(log, machine.plan))
    blocks = inputs_of(frames, machine.drive)
    read = set[str]().union(*map(read_in, frames))
    log_doubts = doubts(log, [block.path for block in frames], config, read)
    stage = f"heats by {options.method}, and their σ"
    progress(stage)
    try:
        history = heat_history(
            machine.plant, config.estimator, blocks, options, partial(changes_within, machine.config, blocks),
            lambda step: progress(f"{stage}: {step}"),
        )  # fmt: skip
        refuse_diverged(history, blocks, config.screw.capacity_J_K * RATE_K_S, options.method)
    except UserError as error:
        raise LogError(f"{log.path}: {error}") from None
    layout, shown = machine.layout, machine.shown.heats
    history = replace(history, heat_W=shown(history.heat_W), heat_sigma_W=shown(history.heat_sigma_W))
    details: dict[str, Any] = {
        "config": config.digest,
        "method": options.method,
        "nut_path": nut_paths(config, log),
        "speed_mean_rpm": speeds(config, log),
        "doubts": log_doubts,
    }
    summary, table = (
        history_summary(layout, history, log, details),
        arrow_table(heat_columns(layout, history)),
    )
    return IdentifiedHeats(table, f"heats in {log.path.name}", summary, config, history, tuple(blocks))
