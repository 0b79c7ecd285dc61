"""What leaves for a controller or for other programs."""

from __future__ import annotations

from pathlib import Path

from observer.errors import ConfigError
from observer.files.folders import results_in
from observer.installation import Installation


def export(config: Installation, kind: str, output: Path) -> tuple[list[str], list[str]]:
    """Write a configuration's observer as a `kind` of code; return the files' names and sentences about it.

    Raises `ConfigError` where a controller could not follow the model.
    """
    from observer.export.data import observer_form
    from observer.export.write import WRITERS

    _refuse_learnt(config)
    form = observer_form(config)
    with results_in(output) as part:
        names = WRITERS[kind](form, part)
    return names, [form.title, *form.facts]


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
