"""The steady state of a machine, by its heat laws alone."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from observer.files.documents import write_json
from observer.files.folders import results_in
from observer.files.writer import TableWriter
from observer.installation import Installation
from observer.library.cases import CaseFigures, as_document, steady_case
from observer.library.given import GivenLog, as_program
from observer.library.packages import in_words
from observer.model.settle import check_inputs

if TYPE_CHECKING:
    from matplotlib.axes import Axes

STEADY = "steady state"


@dataclass(frozen=True, eq=False, repr=False)
class SteadyScrew:
    """The steady state of a machine.

    Attributes:
        figures: Temperatures, heats, thermal error and force.
        document: The content of `steady.json`.
    """

    figures: CaseFigures
    document: Mapping[str, Any]
    _title: str

    def __repr__(self) -> str:
        return f"<SteadyScrew: {self._title}; largest error {self.figures.largest_error_um:.3g} µm>"

    @in_words
    def plot(self) -> list[Axes]:
        """Draw the picture that the command writes, as a figure of pyplot, and return its axes.

        Raises:
            UserError: matplotlib is not installed.
        """
        from observer.report.comparison import draw_cases
        from observer.report.pictures import shown

        with shown() as figure:
            return draw_cases(figure, [self.figures], self._title, STEADY)

    @in_words
    def write(self, folder: str | Path) -> None:
        """Write `steady.csv` (one row), `steady.json` and `steady.png` into a folder.

        Args:
            folder: Is created if it is missing; files of the same names are replaced.

        Raises:
            UserError: The folder cannot be written; then it is as it was before.
        """
        from observer.report.comparison import draw_cases
        from observer.report.pictures import written

        with results_in(Path(folder)) as part:
            with TableWriter(part / "steady.csv") as sink:
                sink.write({name: np.array([value]) for name, value in self.figures.columns.items()})
            write_json(part / "steady.json", self.document)
            with written(part / "steady.png") as figure:
                draw_cases(figure, [self.figures], self._title, STEADY)


def steady_screw(config: Installation, inputs: Mapping[str, float], program: GivenLog | None) -> SteadyScrew:
    """Return the steady state of a machine with constant inputs, or with the mean inputs of a program.

    Args:
        config: The machine.
        inputs: Constant values by input channel; they replace the program's columns.
        program: A log of the other inputs; None if `inputs` has all that the model needs.

    Raises:
        ConfigError: An input is unknown, missing or beyond its limits, or the machine never settles.
        LogError: The program cannot be read, or an input has no value in it.
    """
    check_inputs(config, inputs, "inputs")
    log = None if program is None else as_program(program, config, "program", spare=inputs)
    figures = steady_case(STEADY, config, inputs, log).figures
    inputs_and_log = {"inputs": dict(inputs), "log": None if log is None else log.path.name}
    title = f"{config.machine.name}, axis {config.machine.axis}: where it settles"
    return SteadyScrew(figures, inputs_and_log | as_document(figures), title)
