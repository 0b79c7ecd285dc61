"""A machine by its configuration, with everything that can be done with it."""

from __future__ import annotations

import html
import shlex
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from observer.errors import UserError
from observer.estimate.pipeline import MachineModel
from observer.estimate.replay import Progress
from observer.files.documents import write_json
from observer.files.folders import results_in
from observer.history.history import Method, MethodOptions
from observer.installation import Installation, parse
from observer.installation import load as load_file
from observer.library.findings import (
    CheckFindings,
    FoundEffect,
    FoundValue,
    effects_in,
    values_in,
)
from observer.library.fitting import fitted, recent_runs, runs_of
from observer.library.given import GivenLog, as_log, as_program, as_several
from observer.library.heats import IdentifiedHeats, identified_heats
from observer.library.packages import in_words
from observer.library.predicting import ForecastRun, SimulatedRun, forecast_run, simulated_run
from observer.library.profiles import ReportGrid, profiles
from observer.library.replaying import Estimates, estimates_of_log, quietly

if TYPE_CHECKING:
    import control

    from observer.library.comparing import Comparison, GivenVariants
    from observer.library.exporting import ExportedFiles, ExportFormat
    from observer.library.placing import GivenCandidates, PlacedSensors, Quantity
    from observer.library.searching import SearchedLogs
    from observer.library.steady import SteadyScrew


@dataclass(frozen=True, eq=False, repr=False)
class Machine:
    """A machine and its sensors as a configuration describes them; `observer.load` reads one.

    A log is a path, an `observer.Log`, a dict of columns, or the result of `simulate`. It may also be a
    `pandas.DataFrame` with `time_s` as a column or as its index. Unusable input raises `observer.UserError`
    with one sentence that names the place and the remedy.
    """

    config: Installation
    """The configuration, checked; its fields are those of the file."""
    source: bytes
    """The text of the configuration's file."""
    file: str = "configuration"
    """Its name in errors."""

    def __repr__(self) -> str:
        machine = self.config.machine
        sensors = ", ".join(sensor.name for sensor in self.config.sensor)
        return f"<Machine {machine.name}, axis {machine.axis}: sensors {sensors}>"

    @classmethod
    def of_text(cls, text: str, file: str = "configuration") -> Machine:
        """Return the machine of a configuration's text (TOML). Raises `ConfigError`."""
        return cls(parse(tomllib.loads(text), file), text.encode(), file)

    @cached_property
    def _model(self) -> MachineModel:
        return MachineModel.of(self.config, learns=True)

    @in_words
    def replay(
        self,
        log: GivenLog,
        *,
        progress: Progress = quietly,
        accept_truncated: bool = False,
        accept_damaged: bool = False,
    ) -> Estimates:
        """Run a log through the path that live readings take, and return the estimates.

        For a file, `accept_truncated` drops a last row that was cut off, `accept_damaged` the rows of a
        recording with a wrong checksum. `progress` gets the number of rows done and their total. Raises
        `LogError` or `ConfigError`.
        """
        accept = {"accept_truncated": accept_truncated, "accept_damaged": accept_damaged}
        return estimates_of_log(as_log(log, self.config, accept=accept), self.config, self._model, progress)

    @in_words
    def simulate(
        self, program: GivenLog, *, start_degC: float | None = None, progress: Progress = quietly
    ) -> SimulatedRun:
        """Predict a run from the heat laws alone.

        The program is a log of the input channels; where it also holds the sensors' channels, their first
        values give the initial field, else `start_degC`, else the ambient. Raises `LogError`.
        """
        return simulated_run(as_program(program, self.config, "program"), self.config, start_degC, progress)

    @in_words
    def forecast(
        self,
        log: GivenLog,
        *,
        program: GivenLog | None = None,
        hours: float | None = None,
        progress: Progress = quietly,
        accept_truncated: bool = False,
        accept_damaged: bool = False,
    ) -> ForecastRun:
        """Forecast what follows a log: temperatures and thermal error, and when they settle.

        The next program is learnt from the log's end, or given as `program`, a log of the input channels
        that is repeated. `accept_truncated`, `accept_damaged` and `progress` are as for `replay`. Raises
        `LogError`.
        """
        accept = {"accept_truncated": accept_truncated, "accept_damaged": accept_damaged}
        next_program = None if program is None else as_program(program, self.config, "program")
        return forecast_run(
            as_log(log, self.config, accept=accept), self.config, next_program, hours, progress
        )

    @in_words
    def identify(
        self,
        log: GivenLog,
        method: Method = "smoother",
        *,
        report: ReportGrid | None = None,
        progress: Callable[[str], None] = lambda _text: None,
        accept_truncated: bool = False,
        accept_damaged: bool = False,
        **options: Any,
    ) -> IdentifiedHeats:
        """Estimate the heats of a whole log, each from all measurements before and after it.

        `options` are `regularisation`, `parameter_choice`, `order`, `gradient` and `seed`, as of `observer
        identify`. With a `report` the result also has temperatures and thermal error along the screw.
        `progress` gets the stage of the work; `accept_truncated` and `accept_damaged` are as for `replay`.
        Raises `LogError` or `UserError`.
        """
        method_options = MethodOptions(method, **options)
        method_options.check()
        if report is not None:
            report.check()
        progress("reading the log")
        accept = {"accept_truncated": accept_truncated, "accept_damaged": accept_damaged}
        measured = as_log(log, self.config, accept=accept)
        heats = identified_heats(measured, self.config, method_options, progress)
        if report is None:
            return heats
        progress("temperatures and thermal error")
        return replace(heats, _profiles=profiles(measured, self.config, heats, report))

    @in_words
    def calibrate(
        self, logs: GivenLog | Sequence[GivenLog], *, progress: Callable[[str], None] = lambda _text: None
    ) -> CalibrationResult:
        """Fit the parameters that the configuration declares free to a log, or to a list of logs.

        The last log, or the end of a single one, is held back. If the fitted values predict it worse than the
        configured ones, the result's machine keeps the configured ones. Raises `UserError`.
        """
        progress("reading logs")
        document, text = fitted(self.config, self.source, as_several(logs, self.config), progress)
        return CalibrationResult(self if text is None else self.of_text(text, self.file), document, text)

    @in_words
    def discover(
        self,
        logs: GivenLog | Sequence[GivenLog] | None = None,
        *,
        recent_s: float | None = None,
        progress: Callable[[str, float], None] = lambda _text, _share: None,
        alone: bool = False,
    ) -> DiscoveryResult:
        """Find the physical effect that the model lacks, and prove that the gap shrinks; some minutes.

        The last of several logs, or the end of a single one, is kept as proof. Instead of logs, `recent_s`
        takes the service's own recording of the last so many seconds. `progress` gets the stage of the work
        and the share done, 0 to 1. A second process does half of the work unless `alone`. Raises
        `ConfigError` or `LogError`.
        """
        from observer.library.searching import searched

        if (logs is None) == (recent_s is None):
            raise UserError("discover: give either logs or recent_s, and not both")
        progress("reading logs", 0.0)
        if recent_s is not None:
            runs, names = recent_runs(self.config, recent_s)
            words = f"--recent {recent_s / 3600.0:g}h"
        else:
            several = as_several(logs, self.config)
            runs = runs_of(several, self.config, convert_units=True)
            names = [log.path.name for log in several]
            words = shlex.join(str(log.path) for log in several)
        search = searched(self.config, self.source, runs, names, progress, in_process=alone)
        machines = {name: self.of_text(text, self.file) for name, text in search.texts.items()}
        return DiscoveryResult(machines, self.file, words, search)

    @in_words
    def learned(self) -> LearnedParameters:
        """Return the parameters that the service of this machine has learnt, from its checkpoint.

        Raises `ConfigError` where nothing is learnt or no checkpoint of this configuration exists.
        """
        from observer.library.learning import learned_parameters

        values, document, text = learned_parameters(self.config, self.source, self.file)
        return LearnedParameters(self.of_text(text, self.file), values, document, text)

    @in_words
    def settle(self, inputs: Mapping[str, float], *, program: GivenLog | None = None) -> SteadyScrew:
        """Return the steady state with constant inputs, or a program's means. Raises `UserError`."""
        from observer.library.steady import steady_screw

        return steady_screw(self.config, inputs, program)

    @in_words
    def compare(self, variants: GivenVariants, log: GivenLog | None = None, **options: Any) -> Comparison:
        """Compare variants over a log of inputs or, with `steady=True`, in their steady states.

        `minimise="error"` also finds mounting, preload and gap. Raises `UserError`.
        """
        from observer.library.comparing import compared

        return compared(self.config, self.source, variants, log, **options)

    @in_words
    def place(
        self,
        count: int | None = None,
        *,
        budget: float | None = None,
        candidates: GivenCandidates = None,
        by: Quantity = "all",
        keep: bool = False,
        spacing_m: float | None = None,
        progress: Callable[[str], None] = lambda _text: None,
    ) -> PlacedSensors:
        """Return the sets of up to `count` sensors in all, within a `budget`, that leave the smallest σ for
        their cost.

        `candidates` are a file, or tables as `[[candidate]]` of a configuration, which they replace. Without
        any they are nodes in the air and places on the screw, `spacing_m` apart. Sets are judged `by` the σ
        of `"heat"`, `"field"` or `"error"`, or by the geometric mean of all three. With `keep` the configured
        sensors stay, and count. Raises `UserError`.
        """
        from observer.library.placing import Choice, candidates_of, placed

        mountable = candidates_of(self.config, candidates, spacing_m)
        return placed(self.config, mountable, Choice(count, budget, by, keep), progress)

    @in_words
    def check(self) -> CheckFindings:
        """Return what the configuration means: modes, observability, poles, noise gain, warnings.

        Raises `UserError` where no estimator can be designed.
        """
        from observer.report.check import findings

        return CheckFindings(findings(self.config))

    @in_words
    def check_wires(self) -> dict[str, Any]:
        """Read each device once; return what `observer check --wires --json` prints. Raises `UserError`."""
        from observer.live.wire_doubts import wires_of

        return wires_of(self.config)

    @in_words
    def export(
        self,
        format: ExportFormat = "c99",
        *,
        log: GivenLog | None = None,
        progress: Progress = quietly,
        **options: Any,
    ) -> ExportedFiles:
        """Return the observer as code, the plant, or the compensation at a log's end, as files.

        `options` are `control`, `axis` and `single`, as of `observer export`. Raises `UserError`.
        """
        from observer.library.exporting import exported

        return exported(self.config, format, log, progress, **options)

    @in_words
    def state_space(self) -> control.StateSpace:
        """Return the plant as a continuous-time `control.StateSpace` with named inputs, outputs and states.

        Inputs are `heat_<source>_W` and the known temperatures in °C, outputs `sensor_<name>_degC` and, as in
        `estimates.csv`, `field_<mm>_degC` and `error_<mm>_um` (a `.` in a name is `_`). A nut that moves is
        spread over its stroke; losses that change with speed or temperature are left out. Raises
        `ConfigError` for supports with play, whose error is not a linear output.
        """
        from observer.config import untied
        from observer.model.build import build_plant
        from observer.model.generator import state_space

        return state_space(build_plant(untied(self.config)))


@dataclass(frozen=True, eq=False, repr=False)
class CalibrationResult:
    """The result of a calibration.

    Attributes:
        machine: has the fitted values, or the configured ones where the fitted ones predict no better.
        document: the content of `calibration.json`.
    """

    machine: Machine
    document: Mapping[str, Any]
    _text: str | None

    @property
    def values(self) -> dict[str, FoundValue]:
        """The fitted parameters by their keys, with unit and 95 % interval."""
        return values_in(self.document["calibrated"])

    @property
    def kept(self) -> str | None:
        """Why the configured values are kept, None where the fitted ones are better."""
        reason: str | None = self.document["kept"]
        return reason

    @in_words
    def write(self, folder: str | Path) -> None:
        """Write `calibration.json` into a folder, and `config.toml` where a fitted value is better than the
        configured one. Raises `UserError`.
        """
        with results_in(Path(folder)) as part:
            if self._text is not None:
                (part / "config.toml").write_text(self._text, encoding="utf-8")
            write_json(part / "calibration.json", self.document)

    def __repr__(self) -> str:
        lines = [f"{key} = {value}" for key, value in self.values.items()]
        return "\n".join(lines if self.kept is None else [*lines, self.kept])

    def _repr_html_(self) -> str:
        return f"<pre>{html.escape(repr(self))}</pre>"


@dataclass(frozen=True, eq=False, repr=False)
class LearnedParameters:
    """The parameters that a service has learnt.

    Attributes:
        machine: has the learnt values.
        values: value and σ by the parameter's key.
        document: the content of `learned.json`.
    """

    machine: Machine
    values: Mapping[str, tuple[float, float]]
    document: Mapping[str, Any]
    _text: str

    @in_words
    def write(self, folder: str | Path) -> None:
        """Write `config.toml` and `learned.json` into a folder. Raises `UserError`."""
        with results_in(Path(folder)) as part:
            (part / "config.toml").write_text(self._text, encoding="utf-8")
            write_json(part / "learned.json", self.document)

    def __repr__(self) -> str:
        return "\n".join(f"{key} = {value:.5g} ± {sigma:.2g}" for key, (value, sigma) in self.values.items())


@dataclass(frozen=True, eq=False, repr=False)
class DiscoveryResult:
    """The result of a search; printed, it describes itself in sentences."""

    _machines: Mapping[str, Machine]
    _file: str
    _logs: str
    _search: SearchedLogs

    @property
    def verdict(self) -> str:
        """The verdict: `named`, `none`, `unknown`, `ambiguous` or `not_identifiable`."""
        return str(self.document["verdict"])

    @property
    def machine(self) -> Machine | None:
        """The machine with the effects that were named, None unless the verdict is `named`."""
        return self._machines.get("config.toml")

    @property
    def candidate(self) -> Machine | None:
        """The machine with the effect that explains most of an unknown gap, None without one."""
        return self._machines.get("candidate.toml")

    @property
    def effects(self) -> tuple[FoundEffect, ...]:
        """The effects that were named, each with its parameters."""
        return effects_in(self.document["effects"])

    @property
    def values(self) -> dict[str, FoundValue]:
        """The parameters calibrated beside the effects, by their keys."""
        return values_in(self.document["calibrated"])

    @property
    def document(self) -> Mapping[str, Any]:
        """The content of `result.json`, without the next command."""
        return self._search.document

    @property
    def sentences(self) -> tuple[str, ...]:
        """The result in words."""
        from observer.report.wording import as_sentences

        return tuple(as_sentences(self._search.discovery, self._search.document))

    @in_words
    def write(self, folder: str | Path, *, report: bool = True) -> dict[str, Any]:
        """Write `result.json`, `report.html` and, if there is one, `config.toml` or `candidate.toml` into a
        folder.

        Returns the content of `result.json`, with the next command. Raises `UserError`.
        """
        with results_in(Path(folder)) as part:
            return self._search.write(part, self._logs, self._file, str(folder), report=report)

    def __repr__(self) -> str:
        return "\n".join(self.sentences)

    def _repr_html_(self) -> str:
        return "".join(f"<p>{html.escape(sentence)}</p>" for sentence in self.sentences)


def load(path: str | Path) -> Machine:
    """Read a configuration file (TOML) and return its machine.

    Raises `ConfigError`, a sentence for each problem that names the file, the key and the remedy.
    """
    return Machine(load_file(Path(path)), Path(path).read_bytes(), str(path))


def discover(
    machine: Machine | str | Path, logs: GivenLog | Sequence[GivenLog], **options: Any
) -> DiscoveryResult:
    """Find the physical effect that a machine's model lacks; the same as `load(machine).discover(logs)`.

    Raises `ConfigError` or `LogError`.
    """
    return (machine if isinstance(machine, Machine) else load(machine)).discover(logs, **options)
