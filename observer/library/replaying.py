"""A log through the live path."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from observer.align.aligner import commands_of, doubts, read_in
from observer.estimate.checkpoint import CheckpointFit
from observer.estimate.open_loop import OpenLoopGap
from observer.estimate.pipeline import MachineModel
from observer.estimate.replay import Progress, nut_paths, speeds, start_of, write_estimates
from observer.files.documents import write_json
from observer.files.folders import results_in
from observer.files.logs import Log
from observer.files.writer import TemporaryTable
from observer.frames import EstimateBlock, FrameBlock, NutPath
from observer.installation import Installation
from observer.library.packages import in_words
from observer.library.signals import SignalTable
from observer.report.collect import ReplaySamples
from observer.report.panels import Panel

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def quietly(_rows: int, _total: int) -> None:
    """Accept a progress report and show nothing: the default where a caller gives no `progress`."""


def _opposed(correlations: Mapping[str, float]) -> Iterator[str]:
    """Yield a sentence for each displacement sensor that moves against the growth predicted by the heat
    laws.
    """
    for name, correlation in correlations.items():
        yield (
            f"{name} moves against what the heat laws make of the screw (correlation {correlation:.2f}), so "
            "that sensors beside it are doubted: its sign is probably wrong; negate its values, as by the "
            "scale of its driver"
        )


@dataclass(frozen=True, eq=False, repr=False)
class Estimates(SignalTable):
    """The estimates of a whole log; signals are the columns of `estimates.csv`.

    The rows lie in a temporary file without a name, which vanishes with this object.

    Attributes:
        summary: The content of `summary.json`: rows, qualities, mean heats, reasons, doubts.
    """

    summary: Mapping[str, Any]
    _config: Installation
    _samples: ReplaySamples
    _stored: TemporaryTable

    def _row_blocks(self) -> Iterator[Any]:
        return self._stored.blocks()

    def _draw(self, figure: Figure) -> list[Panel]:
        from observer.report.pictures import draw_overview

        return draw_overview(figure, self._config, self._samples, self._title)

    @in_words
    def write(self, folder: str | Path, format: str = "csv", *, picture: bool = True) -> None:
        """Write `estimates.csv` (or `.parquet` by `format`), `summary.json` and `overview.png` into a
        folder.

        Args:
            folder: Is created if it is missing; files of the same names are replaced.
            format: `csv`, `csv.gz` or `parquet`.
            picture: Draw `overview.png`.

        Raises:
            UserError: The folder cannot be written; then it is as it was before.
        """
        with results_in(Path(folder)) as part:
            self._write_table(part / f"estimates.{format}")
            write_json(part / "summary.json", self.summary)
            if picture:
                self._write_picture(part / "overview.png")


def estimates_of_log(
    log: Log, config: Installation, machine: MachineModel, progress: Progress = quietly
) -> Estimates:
    """Return the estimates of a log.

    Args:
        log: The log, with the configuration's channels.
        config: The machine.
        machine: Its model, built from the same configuration.
        progress: Receives the number of rows done and their total.

    Raises:
        LogError: The temporary file has no room, or the log yields no estimate.
    """
    pipeline = machine.pipeline()
    start, kind_of_start = start_of(log, CheckpointFit.of(machine))
    samples = ReplaySamples(config, pipeline.layout)
    open_loop, paths = OpenLoopGap(machine.plant, machine.drive), list[Mapping[str, NutPath]]()
    read = set[str]()

    def follow(frames: FrameBlock, block: EstimateBlock) -> None:
        open_loop.take(frames)
        paths.append(frames.path)
        read.update(read_in(frames))
        samples.take(pipeline.inputs, block)

    with TemporaryTable() as sink:
        numbers = write_estimates(sink, log, machine.plan, pipeline, progress, start, follow)
    summary = {
        "log": log.path.name,
        "config": config.digest,
        **numbers,
        "nut_path": nut_paths(config, log),
        "speed_mean_rpm": speeds(config, log),
        "open_loop_rms_K": open_loop.rms_K,
        **({"open_loop_rms_um": moved} if (moved := open_loop.rms_um) else {}),
        "doubts": [*doubts(log, paths, config, read), *_opposed(open_loop.opposed)],
        "start": kind_of_start,
        "commands": commands_of(log),
    }
    return Estimates(sink.table, f"replay of {log.path.name}", summary, config, samples, sink)
