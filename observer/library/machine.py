"""A machine by its configuration, with everything that can be done with it.

Each method is one command of the shell, on objects in memory. Results are frozen, and `.write(folder)` writes
the files of the command. Methods block until the work is done, and packages that only one method needs are
imported by that method.
"""

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
    with one sentence that names the place and the remedy. `ConfigError` and `LogError` are kinds of it.

    A machine never changes: fits and searches return another one. Its plant is built once, when first needed.

    Attributes:
        config: The configuration, checked; its fields are those of the file.
        source: The bytes of the configuration's file, from which improved configurations are written with
            their comments.
        file: The configuration's name in errors.
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
        """Return the machine of a configuration that is given as text.

        Args:
            text: The content of a configuration file (TOML).
            file: Its name in errors.

        Raises:
            ConfigError: Keys are unknown, missing or out of range, or contradict each other; a sentence for
                each.
            tomllib.TOMLDecodeError: The text is not TOML.
        """
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

        A recording of the service starts from the checkpoint that lies beside it, so that it gives the
        estimates that were published. Any other log starts cold.

        Args:
            log: The log, with a column for each channel of the configuration; empty cells are missing
                readings.
            progress: Receives the number of rows done and their total, about once a block.
            accept_truncated: Drop a last row that was cut off, instead of refusing the file.
            accept_damaged: Drop the rows of a recording whose checksum is wrong, instead of refusing the
                file.

        Returns:
            A row for each step of the estimator, with the columns of `estimates.csv`.

        Raises:
            LogError: The file cannot be read, an input or every sensor has no value in any row, or a required
                temperature is beyond its limits throughout.
            ConfigError: No estimator can be designed for this configuration.
        """
        accept = {"accept_truncated": accept_truncated, "accept_damaged": accept_damaged}
        return estimates_of_log(as_log(log, self.config, accept=accept), self.config, self._model, progress)

    @in_words
    def simulate(
        self, program: GivenLog, *, start_degC: float | None = None, progress: Progress = quietly
    ) -> SimulatedRun:
        """Predict a run from the heat laws alone.

        The initial field comes from the program's sensor channels if it has any. It then is the field that
        fits their first values.

        Args:
            program: A log of the input channels; sensors' channels may be missing.
            start_degC: Uniform temperature of the screw at the start; None for the sensors' first values, and
                without these the ambient.
            progress: Receives the number of rows done and their total.

        Returns:
            A log of all channels with heats, field and thermal error; it can be given to the other methods.

        Raises:
            LogError: The program cannot be read, an input has no value in any row, or is beyond its limits
                throughout.
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

        Args:
            log: The log up to now; it is replayed first, and the forecast starts from its last estimate.
            program: A log of the input channels that is repeated from now on; None learns the program from
                the log's end.
            hours: Hours ahead, 0.05 to 24; None for `forecast.hours` of the configuration.
            progress: Receives the number of rows replayed and their total.
            accept_truncated: As for `replay`.
            accept_damaged: As for `replay`.

        Returns:
            Field and thermal error with σ over the time ahead, and the forecast in sentences.

        Raises:
            LogError: The log cannot be replayed, is shorter than one step, or has no program at its end.
            UserError: `hours` is out of range.
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

        Args:
            log: The log, as for `replay`.
            method: `smoother`, `tikhonov` or `conjugate-gradient`.
            report: Places and times at which temperatures and thermal error are wanted too; None for heats
                only.
            progress: Receives the stage of the work.
            accept_truncated: As for `replay`.
            accept_damaged: As for `replay`.
            options: `regularisation`, `parameter_choice`, `order`, `gradient` and `seed`, as of `observer
                identify`; what is left out is the method's default.

        Returns:
            The heats in W with σ, a row for each step of the estimator.

        Raises:
            UserError: An option is unknown, out of range, or belongs to another method.
            LogError: The log cannot be read, or the method cannot use it.
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
        configured ones, the result's machine keeps the configured ones.

        Args:
            logs: One log, or several of the same machine, each a run with its own initial field.
            progress: Receives the stage of the work, about every second.

        Raises:
            ConfigError: A key declared free does not exist.
            LogError: A log cannot be read, two are identical, they are too short, or they determine no
                parameter.
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

        The last of several logs, or the end of a single one, is kept as proof: it takes no part in fitting or
        choosing. A channel that was recorded in another unit is converted first, and reported as a suspect.

        Args:
            logs: One log or several of the same machine; None with `recent_s`.
            recent_s: Take the service's own recordings of the last so many seconds instead of logs.
            progress: Receives the stage of the work and the share done, 0 to 1.
            alone: Work in this process only. Otherwise a second process does half of the work; the result is
                the same.

        Raises:
            UserError: Both `logs` and `recent_s` are given, or neither.
            ConfigError: The configuration declares no parameter free, or the service records nothing.
            LogError: A log cannot be read, two are identical, or the logs are too short.
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

        The service may be running: its checkpoint file is replaced whole.

        Raises:
            ConfigError: `estimator.learn` names no parameter, `[checkpoint]` is missing, or no checkpoint of
                this configuration exists yet.
        """
        from observer.library.learning import learned_parameters

        values, document, text = learned_parameters(self.config, self.source, self.file)
        return LearnedParameters(self.of_text(text, self.file), values, document, text)

    @in_words
    def settle(self, inputs: Mapping[str, float], *, program: GivenLog | None = None) -> SteadyScrew:
        """Return the steady state with constant inputs, or with the mean inputs of a program.

        Args:
            inputs: Constant values by input channel, in the channel's unit. They replace the program's
                columns.
            program: A log of the input channels; None if `inputs` names each input that the model needs.

        Raises:
            ConfigError: An input is unknown, missing or implausible, or the machine never settles.
            LogError: The program cannot be read, or an input has no value in it.
        """
        from observer.library.steady import steady_screw

        return steady_screw(self.config, inputs, program)

    @in_words
    def compare(self, variants: GivenVariants, log: GivenLog | None = None, **options: Any) -> Comparison:
        """Compare variants of this machine over a log of inputs, or in their steady states.

        Args:
            variants: A variants' file (TOML), or its table: named overrides of the configuration.
            log: A log of the input channels, the cycle that each variant runs; None with `steady=True`.
            options: `steady=True` compares steady states. `minimise="error"` also finds mounting, preload and
                gap. `progress` receives the variant's name and the share done, 0 to 1.

        Raises:
            ConfigError: A variant is invalid or has no steady state, or there is no thermal error to
                minimise.
            LogError: The log cannot be read, or an input has no value in it.
            UserError: `minimise` is neither None nor `"error"`.
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
        """Return the sets of sensors that leave the smallest σ for their cost.

        Without any candidates they are nodes in the air and places on the screw. Every set contains a
        thermocouple, since an estimate starts from a temperature.

        Args:
            count: Largest number of sensors in all; None for any within the budget, else two more than heats.
            budget: Largest cost of a set; None for any.
            candidates: A file, or tables as `[[candidate]]` of a configuration, which they replace.
            by: The σ by which sets are judged: `"heat"`, `"field"`, `"error"`, or the geometric mean of all
                three.
            keep: The configured sensors stay in every set, and count.
            spacing_m: Distance of the places on the screw; None for 41 places. Only without candidates.
            progress: Receives the stage of the work.

        Raises:
            UserError: No set fulfils the limits, or the thermal error is asked for without an expansion
                coefficient.
            ConfigError: A candidate is invalid.
        """
        from observer.library.placing import Choice, candidates_of, placed

        mountable = candidates_of(self.config, candidates, spacing_m)
        return placed(self.config, mountable, Choice(count, budget, by, keep), progress)

    @in_words
    def check(self) -> CheckFindings:
        """Return what the configuration means: modes, observability, poles, noise gain, warnings.

        Raises:
            UserError: No estimator can be designed.
        """
        from observer.report.check import findings

        return CheckFindings(findings(self.config))

    @in_words
    def check_wires(self) -> dict[str, Any]:
        """Read each device once and return its readings, with doubts about how it is wired.

        This opens the buses that the drivers name. It must not run while the service uses the same serial
        port.

        Returns:
            The document that `observer check --wires --json` prints.

        Raises:
            UserError: A file that a driver names cannot be used. A device that cannot be reached is a
                finding.
        """
        from observer.service.wire_doubts import wires_of

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

        Args:
            format: `c99`, `st` or `fmu` for code, `npz`, `mat` or `json` for matrices, `table` for a control.
            log: For code, a log that the reference runs over beside the estimator. For a table, the log at
                whose end it holds.
            progress: Receives the number of rows done and their total.
            options: `control`, `axis` and `single`, as of `observer export`.

        Raises:
            UserError: An option is unknown, or a table is asked for without a log.
            ConfigError: A controller could not follow this model, or the service has learnt parameters that
                the configuration lacks.
            LogError: The log cannot be read, or the table's last estimate is not good.
        """
        from observer.library.exporting import exported

        return exported(self.config, format, log, progress, **options)

    @in_words
    def state_space(self) -> control.StateSpace:
        """Return the plant as a continuous-time `control.StateSpace` with named inputs, outputs and
        states.

        Inputs are `heat_<source>_W` and the known temperatures in °C. Outputs are `sensor_<name>_degC` and,
        as in `estimates.csv`, `field_<mm>_degC` and `error_<mm>_um`; a `.` in a name is `_`. A nut that moves
        is spread over its stroke. Losses that change with speed or temperature are left out.

        Raises:
            ConfigError: The supports have play, so the thermal error is not a linear output.
            UserError: The package `control` is not installed.
        """
        from observer.config.machine import untied
        from observer.model.build import build_plant
        from observer.model.generator import state_space

        return state_space(build_plant(untied(self.config)))


@dataclass(frozen=True, eq=False, repr=False)
class CalibrationResult:
    """The result of a calibration.

    Attributes:
        machine: Has the fitted values, or the configured ones where the fitted ones predict no better.
        document: The content of `calibration.json`.
    """

    machine: Machine
    document: Mapping[str, Any]
    _text: str | None

    @property
    def values(self) -> dict[str, FoundValue]:
        """The fitted parameters by their keys, with unit and 95 % interval.

        They are those of the fit even where the configured values are kept.
        """
        return values_in(self.document["calibrated"])

    @property
    def kept(self) -> str | None:
        """Why the configured values are kept, None where the fitted ones are better."""
        reason: str | None = self.document["kept"]
        return reason

    @in_words
    def write(self, folder: str | Path) -> None:
        """Write `calibration.json` into a folder, and `config.toml` where fitted values are better.

        Args:
            folder: Is created if it is missing; files of the same names are replaced.

        Raises:
            UserError: The folder cannot be written; then it is as it was before.
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
        machine: Has the learnt values.
        values: Value and σ by the parameter's key, both in the unit of the key.
        document: The content of `learned.json`.
    """

    machine: Machine
    values: Mapping[str, tuple[float, float]]
    document: Mapping[str, Any]
    _text: str

    @in_words
    def write(self, folder: str | Path) -> None:
        """Write `config.toml` and `learned.json` into a folder.

        Args:
            folder: Is created if it is missing; files of the same names are replaced.

        Raises:
            UserError: The folder cannot be written; then it is as it was before.
        """
        with results_in(Path(folder)) as part:
            (part / "config.toml").write_text(self._text, encoding="utf-8")
            write_json(part / "learned.json", self.document)

    def __repr__(self) -> str:
        return "\n".join(f"{key} = {value:.5g} ± {sigma:.2g}" for key, (value, sigma) in self.values.items())


@dataclass(frozen=True, eq=False, repr=False)
class DiscoveryResult:
    """The result of a search; printed, it describes itself in sentences.

    It holds the fitted models in memory, so the report is drawn only by `write`.
    """

    _machines: Mapping[str, Machine]
    _file: str
    _logs: str
    _search: SearchedLogs

    @property
    def verdict(self) -> str:
        """The verdict: `named`, `none`, `unknown`, `ambiguous` or `not_identifiable`.

        `none`: the model lacks nothing. `unknown`: no effect of the library explains the gap. `ambiguous`:
        several explain it equally well. `not_identifiable`: the logs excite too little to decide.
        """
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
        """The effects that were named, each with its parameters; empty unless the verdict is `named`."""
        return effects_in(self.document["effects"])

    @property
    def values(self) -> dict[str, FoundValue]:
        """The parameters calibrated beside the effects, by their keys, with unit and 95 % interval."""
        return values_in(self.document["calibrated"])

    @property
    def document(self) -> Mapping[str, Any]:
        """The content of `result.json`, without the next command."""
        return self._search.document

    @property
    def sentences(self) -> tuple[str, ...]:
        """The result in words, the verdict first, then its evidence and what to do about it."""
        from observer.report.wording import as_sentences

        return tuple(as_sentences(self._search.discovery, self._search.document))

    @in_words
    def write(self, folder: str | Path, *, report: bool = True) -> dict[str, Any]:
        """Write the files of `observer discover` into a folder.

        These are `result.json`, `report.html` and, if there is one, `config.toml` or `candidate.toml`. A
        proposed test cycle is written as a log that the machine can run.

        Args:
            folder: Is created if it is missing; files of the same names are replaced.
            report: Draw the report, which takes some seconds.

        Returns:
            The content of `result.json`, with the next command.

        Raises:
            UserError: The folder cannot be written; then it is as it was before.
        """
        with results_in(Path(folder)) as part:
            return self._search.write(part, self._logs, self._file, str(folder), report=report)

    def __repr__(self) -> str:
        return "\n".join(self.sentences)

    def _repr_html_(self) -> str:
        return "".join(f"<p>{html.escape(sentence)}</p>" for sentence in self.sentences)


def load(path: str | Path) -> Machine:
    """Read a configuration file (TOML) and return its machine.

    Raises:
        ConfigError: The file is missing, is not TOML, or is invalid; a sentence for each problem that names
            the file, the key and the remedy.
    """
    return Machine(load_file(Path(path)), Path(path).read_bytes(), str(path))


def discover(
    machine: Machine | str | Path, logs: GivenLog | Sequence[GivenLog], **options: Any
) -> DiscoveryResult:
    """Find the physical effect that a machine's model lacks; the same as `load(machine).discover(logs)`.

    Args:
        machine: A machine, or the path of its configuration.
        logs: One log or several, the last of which is kept as proof.
        options: Those of `Machine.discover`.

    Raises:
        ConfigError: The configuration is invalid, or declares no parameter free.
        LogError: A log cannot be read, two are identical, or the logs are too short.
    """
    return (machine if isinstance(machine, Machine) else load(machine)).discover(logs, **options)
