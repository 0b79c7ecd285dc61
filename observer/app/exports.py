"""Exports for a controller or for other programs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from observer.errors import ConfigError, LogError
from observer.estimate.replay import Progress
from observer.files.folders import results_in
from observer.frames import EstimateBlock, EstimateQuality, FloatArray
from observer.installation import Installation
from observer.library.given import channels_of

if TYPE_CHECKING:
    from observer.export.control_tables import ControlTable
    from observer.export.form import Form


class Exported(NamedTuple):
    """The files' names, and sentences about them."""

    names: Sequence[str]
    facts: Sequence[str]


def export(config: Installation, kind: str, output: Path, log: Path | None, progress: Progress) -> Exported:
    """Write a configuration's observer as a `kind` of code, or its plant.

    With a log the code's reference in Python runs over it, beside the configured estimator, into
    `reference.csv`. Raises `ConfigError` where a controller could not follow the model, or `LogError`.
    """
    _refuse_learnt(config)
    with results_in(output) as part:
        if kind in ("npz", "mat", "json"):
            return _matrices(config, kind, part)
        from observer.export.data import observer_form
        from observer.export.write import WRITERS, write_fmus

        form = observer_form(config)
        facts = [form.title, *form.facts]
        if kind == "fmu":
            from observer.export.model import model_form

            names, made = write_fmus(form, model_form(config), part)
            facts += made
        else:
            names = WRITERS[kind](form, part)
        if log is not None:
            facts += _reference(config, form, log, part, progress)
            names = [*names, "reference.csv"]
        return Exported(names, facts)


def _matrices(config: Installation, kind: str, part: Path) -> Exported:
    from observer.export import model

    found = model.plant_matrices(config)
    write = {"npz": model.write_npz, "mat": model.write_mat, "json": model.write_plant_json}
    states, inputs, outputs = (len(found[key]) for key in ("states", "inputs", "outputs"))
    facts = [f"{states} states, {inputs} inputs, {outputs} outputs; configuration {config.digest}"]
    return Exported([write[kind](found, part)], facts)


def _reference(config: Installation, form: Form, path: Path, part: Path, progress: Progress) -> list[str]:
    """Write the reduced observer's estimates of a log; return how far they are from the configured
    estimator's.
    """
    from observer.export.reference import columns_of, run, sampled
    from observer.files.writer import write_log

    samples = sampled(channels_of(path, config), config.channels, form.period_s)
    found = run(form, samples)
    write_log(part / "reference.csv", samples.time_s, columns_of(form, samples, found))
    block = _estimates(config, path, progress)
    at = np.clip(np.searchsorted(block.time_s, samples.time_s + 1e-6, side="right") - 1, 0, None)
    both = (found["quality"] == 0) & (block.quality[at] == EstimateQuality.GOOD)
    if not both.any():
        return [f"In {path.name} both are never good at the same step, so they cannot be compared."]
    facts = [f"Over {path.name}, {int(both.sum())} steps at which both are good, r.m.s. from the estimator:"]
    for name, other in (
        ("heat_W", block.heat_W),
        ("field_degC", block.field_degC),
        ("error_um", block.error_um),
    ):
        if name in found:
            apart = found[name][both] - other[at][both]
            facts.append(f"  {name}: {np.sqrt(np.mean(apart**2)):.3g}, at most {np.abs(apart).max():.3g}")
    return facts


def _estimates(config: Installation, path: Path, progress: Progress) -> EstimateBlock:
    """The estimates of a log by the configured estimator."""
    from observer.estimate.pipeline import MachineModel
    from observer.estimate.replay import estimates_of

    machine, log = MachineModel.of(config, learns=True), channels_of(path, config)
    blocks = [block for _, block in estimates_of(log, machine.plan, machine.pipeline(), progress)]
    return EstimateBlock.joined(blocks)


def export_table(
    config: Installation, control: str, axis: str, log: Path, output: Path, progress: Progress
) -> Exported:
    """Write the compensation of a log's end as the table that a control reads.

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
            f"{log}: its last estimate is {quality.label}, so no table can be made from it; give a log, "
            "or part "
            "of one, that ends with a good estimate (`observer replay` gives the reasons)"
        )
    table = _table(config, control, axis, block)
    with results_in(output) as part:
        (part / table.name).write_text(table.text, encoding="ascii")
    return Exported([table.name], table.facts)


def _table(config: Installation, control: str, axis: str, block: EstimateBlock) -> ControlTable:
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
            f"the error of {np.abs(last_um).max():.0f} um is beyond compensation.limit_um = "
            f"{plan.limit_um:g}; find the fault, or raise the limit"
        )
    left_um = float(np.abs(whole_um - last_um).max())
    if control == "linuxcnc":
        return control_tables.linuxcnc(plan.machine_m, last_um, title, axis).leaving(left_um)
    if control == "sinumerik":
        found = control_tables.sinumerik(plan.machine_m, last_um, title, axis, plan.reference)
        return found.leaving(left_um)
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
        f"the service has learnt parameters of this machine that the configuration lacks ({file}), and "
        "an export "
        "would omit them; write them into a configuration with `observer learned`, and export that"
    )
