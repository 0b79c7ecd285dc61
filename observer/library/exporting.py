"""Exports for a controller or for other programs."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from observer.errors import ConfigError, LogError, UserError, check_choice
from observer.estimate.replay import Progress
from observer.files.folders import results_in
from observer.files.logs import Log
from observer.frames import EstimateBlock, EstimateQuality, FloatArray
from observer.installation import Installation
from observer.library.given import GivenLog, as_log

if TYPE_CHECKING:
    from observer.export.control_tables import ControlTable
    from observer.export.form import Form

ExportFormat = Literal["c99", "st", "fmu", "npz", "mat", "json", "table"]
Control = Literal["linuxcnc", "klipper", "sinumerik"]


@dataclass(frozen=True, slots=True, repr=False)
class ExportedFiles:
    """Files for a controller or another program.

    Attributes:
        files: Their content by file name.
        facts: Sentences about them: gains, features of the service that the export lacks, and agreement with
            the estimator over a log.
    """

    files: Mapping[str, bytes]
    facts: tuple[str, ...]

    def write(self, folder: str | Path) -> None:
        """Write the files into a folder.

        Args:
            folder: Is created if it is missing; files of the same names are replaced.

        Raises:
            UserError: The folder cannot be written; then it is as it was before.
        """
        with results_in(Path(folder)) as part:
            for name, data in self.files.items():
                (part / name).write_bytes(data)

    def __repr__(self) -> str:
        return "\n".join([*self.facts, ", ".join(self.files)])


def exported(
    config: Installation,
    format: ExportFormat,
    log: GivenLog | None,
    progress: Progress,
    *,
    control: Control = "linuxcnc",
    axis: str = "X",
    single: bool = False,
) -> ExportedFiles:
    """Return a configuration's observer as code, its plant, or the compensation at a log's end as a table.

    With a log, the code's reference in Python runs over it beside the configured estimator, and
    `reference.csv` has the outputs of the reference.

    Args:
        config: The machine.
        format: Language or file type.
        log: Needed for a table, optional for code, unused for matrices.
        progress: Receives the number of rows estimated and their total.
        control: The control whose format a table has.
        axis: The control's name of the axis, letters and digits; for a table.
        single: REAL instead of LREAL in structured text.

    Raises:
        ConfigError: A controller could not follow the model, the service has learnt parameters that the
            configuration lacks, or the error is beyond `compensation.limit_um`.
        LogError: The log cannot be read, or a table's last estimate is not good.
        UserError: An option is unknown or belongs to another format.
    """
    check_choice("format", format, get_args(ExportFormat))
    check_choice("control", control, get_args(Control))
    if single and format != "st":
        raise UserError("export: --single belongs to --format st; leave it out, as C99 has a macro for it")
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]{0,31}", axis):
        raise UserError(
            f"export: --axis {axis!r} is not the name of an axis; give letters and digits, such as X"
        )
    if format == "table":
        if log is None:
            raise UserError("export: --format table needs --log; give the log at whose end the table holds")
        return _control_table(config, control, axis, as_log(log, config), progress)
    _refuse_learnt(config)
    with TemporaryDirectory() as folder:
        part = Path(folder)
        if format in ("npz", "mat", "json"):
            names, facts = _matrices(config, format, part)
        else:
            names, facts = _code(config, f"{format}-single" if single else format, log, part, progress)
        return ExportedFiles({name: (part / name).read_bytes() for name in names}, tuple(facts))


def _code(
    config: Installation, kind: str, log: GivenLog | None, part: Path, progress: Progress
) -> tuple[list[str], list[str]]:
    """Write the observer as code into a folder; return the names of the files and sentences about them."""
    from observer.export.data import observer_form
    from observer.export.write import WRITERS, write_fmus

    form = observer_form(config)
    facts = [form.title, *form.facts]
    if kind == "fmu":
        from observer.export.model import model_form

        names, written = write_fmus(form, model_form(config), part)
        facts += written
    else:
        names = WRITERS[kind](form, part)
    if log is None:
        return [*names], facts
    return [*names, "reference.csv"], [*facts, *_reference(config, form, as_log(log, config), part, progress)]


def _matrices(config: Installation, kind: str, part: Path) -> tuple[list[str], list[str]]:
    """Write the plant's matrices into a folder; return the name of the file and a sentence about it."""
    from observer.export import model

    matrices = model.plant_matrices(config)
    write = {"npz": model.write_npz, "mat": model.write_mat, "json": model.write_plant_json}
    states, inputs, outputs = (len(matrices[key]) for key in ("states", "inputs", "outputs"))
    facts = [f"{states} states, {inputs} inputs, {outputs} outputs; configuration {config.digest}"]
    return [write[kind](matrices, part)], facts


def _reference(config: Installation, form: Form, log: Log, part: Path, progress: Progress) -> list[str]:
    """Write the reduced observer's estimates of a log; return how far they are from the configured
    estimator's.
    """
    from observer.export.reference import columns_of, run, sampled
    from observer.files.writer import write_log

    samples = sampled(log, config.channels, form.period_s)
    outputs = run(form, samples)
    write_log(part / "reference.csv", samples.time_s, columns_of(form, samples, outputs))
    block = _estimates(config, log, progress)
    at = np.clip(np.searchsorted(block.time_s, samples.time_s + 1e-6, side="right") - 1, 0, None)
    both = (outputs["quality"] == 0) & (block.quality[at] == EstimateQuality.GOOD)
    if not both.any():
        return [f"In {log.path.name} both are never good at the same step, so they cannot be compared."]
    steps = f"Over {log.path.name}, {int(both.sum())} steps at which both are good"
    facts = [f"{steps}, r.m.s. from the estimator:"]
    for name, other in (
        ("heat_W", block.heat_W),
        ("field_degC", block.field_degC),
        ("error_um", block.error_um),
    ):
        if name in outputs:
            apart = outputs[name][both] - other[at][both]
            facts.append(f"  {name}: {np.sqrt(np.mean(apart**2)):.3g}, at most {np.abs(apart).max():.3g}")
    return facts


def _estimates(config: Installation, log: Log, progress: Progress) -> EstimateBlock:
    """The estimates of a log by the configured estimator."""
    from observer.estimate.pipeline import MachineModel
    from observer.estimate.replay import estimates_of

    machine = MachineModel.of(config, learns=True)
    blocks = [block for _, block in estimates_of(log, machine.plan, machine.pipeline(), progress)]
    return EstimateBlock.joined(blocks)


def _control_table(
    config: Installation, control: Control, axis: str, log: Log, progress: Progress
) -> ExportedFiles:
    """Return the compensation at a log's end as the table that a control reads.

    Raises `ConfigError` without an expansion coefficient, and `LogError` where the last estimate is not good.
    """
    if config.screw.expansion_1_K is None:
        raise ConfigError(
            "screw.expansion_1_K is missing, so there is no thermal error to compensate; give it"
        )
    block = _estimates(config, log, progress)
    quality = EstimateQuality(int(block.quality[-1]))
    if quality != EstimateQuality.GOOD:
        raise LogError(
            f"{log.path}: its last estimate is {quality.label}, so no table can be made from it; give a log, "
            "or part of one, that ends with a good estimate (`observer replay` gives the reasons)"
        )
    table = _table(config, control, axis, block)
    return ExportedFiles({table.name: table.text.encode("ascii")}, tuple(table.facts))


def _table(config: Installation, control: Control, axis: str, block: EstimateBlock) -> ControlTable:
    """Return the compensation at the end of a log as the table of a control.

    A Klipper table is fitted over all good estimates instead. Raises `ConfigError` where the error is beyond
    `compensation.limit_um`.
    """
    from observer.control.compensation import plan_of, table_of, within_gradient
    from observer.export import control_tables
    from observer.model.build import grid_of

    plan, grid_m, machine = plan_of(config), grid_of(config), config.machine
    title = f"{machine.name}, axis {machine.axis}, configuration {config.digest}, at {block.time_s[-1]:.3f} s"
    title = title.encode("ascii", "replace").decode("ascii")

    def table_um(error_um: FloatArray) -> FloatArray:
        return table_of(plan, grid_m, error_um)

    whole_um = table_um(block.error_um[-1])
    last_um = within_gradient(plan, whole_um)
    if float(np.abs(last_um).max()) > plan.limit_um:
        raise ConfigError(
            f"the error of {np.abs(last_um).max():.0f} µm is beyond compensation.limit_um = "
            f"{plan.limit_um:g} µm; find the cause, or raise the limit"
        )
    left_um = float(np.abs(whole_um - last_um).max())
    if control == "linuxcnc":
        return control_tables.linuxcnc(plan.machine_m, last_um, title, axis).leaving(left_um)
    if control == "sinumerik":
        table = control_tables.sinumerik(plan.machine_m, last_um, title, axis, plan.reference)
        return table.leaving(left_um)
    good = block.quality == EstimateQuality.GOOD
    sensor_m = np.array([s.position_m or 0.0 for s in config.sensor])
    at_degC = np.array([np.interp(sensor_m, grid_m, field) for field in block.field_degC[good]])
    error_um = np.array([table_um(error)[plan.reference] for error in block.error_um[good]])
    return control_tables.klipper(tuple(s.name for s in config.sensor), at_degC, error_um, title)


def _refuse_learnt(config: Installation) -> None:
    """Raise `ConfigError` where the service has learnt parameters that the configuration lacks."""
    from observer.estimate.checkpoint import CheckpointFit, UnfitError
    from observer.estimate.checkpoint import load as load_checkpoint
    from observer.estimate.pipeline import MachineModel

    file = config.checkpoint_file
    if file is None or not file.exists() or not config.learnt:
        return
    try:
        load_checkpoint(file, CheckpointFit.of(MachineModel.of(config, learns=True)))
    except UnfitError:
        return  # of another configuration, so nothing in force was learnt
    raise ConfigError(
        f"the service has learnt parameters of this machine that the configuration lacks ({file}), and an "
        "export would omit them; write them into a configuration with `observer learned`, and export that"
    )
