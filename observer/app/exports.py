"""What leaves for a controller or for other programs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from observer.errors import ConfigError
from observer.files.folders import results_in
from observer.installation import Installation


def export(config: Installation, kind: str, output: Path) -> tuple[Sequence[str], list[str]]:
    """Write a configuration's observer as a `kind` of code, or its plant; return the files' names and
    sentences about them.

    Raises `ConfigError` where a controller could not follow the model.
    """
    _refuse_learnt(config)
    with results_in(output) as part:
        if kind in ("npz", "mat", "json"):
            from observer.export import matrices

            found = matrices.plant_matrices(config)
            write = {"npz": matrices.write_npz, "mat": matrices.write_mat, "json": matrices.write_plant_json}
            states, inputs, outputs = (len(found[key]) for key in ("states", "inputs", "outputs"))
            facts = [f"{states} states, {inputs} inputs, {outputs} outputs; configuration {config.digest}"]
            return [write[kind](found, part)], facts
        from observer.export.data import observer_form
        from observer.export.write import WRITERS, write_fmus

        form = observer_form(config)
        facts = [form.title, *form.facts]
        if kind != "fmu":
            return WRITERS[kind](form, part), facts
        from observer.export.model import model_form

        names, made = write_fmus(form, model_form(config), part)
        return names, [*facts, *made]


def _refuse_learnt(config: Installation) -> None:
    """Raise `ConfigError` where the service has learnt what the configuration does not say."""
    from observer.estimate.checkpoint import CheckpointFit, UnfitError
    from observer.estimate.checkpoint import load as load_checkpoint
    from observer.estimate.pipeline import MachineModel

    file = config.checkpoint_file
    if file is None or not file.exists() or not config.estimator.learnt:
        return
    try:
        load_checkpoint(file, CheckpointFit.of(MachineModel.of(config, learns=True)))
    except UnfitError:
        return  # of another configuration, so nothing in force was learnt
    raise ConfigError(
        f"the service has learnt more of this machine than the configuration says ({file}), and an export "
        "would leave it out; write it into a configuration by `observer learned`, and export that"
    )
