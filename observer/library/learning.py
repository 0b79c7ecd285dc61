"""The parameters that a service has learnt, from its checkpoint."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from observer.errors import ConfigError
from observer.estimate.checkpoint import CheckpointFit, UnfitError
from observer.estimate.checkpoint import load as load_checkpoint
from observer.estimate.pipeline import MachineModel
from observer.fit.tolerance import learnt_changes
from observer.installation import Installation, with_effects, write_back
from observer.library.fitting import provenance, text_of


def learned_parameters(
    config: Installation, source: bytes, place: str
) -> tuple[dict[str, tuple[float, float]], dict[str, Any], str]:
    """Return the learnt parameters with σ, the content of `learned.json`, and the configuration with them.

    Args:
        config: The machine, with `estimator.learn` and `[checkpoint]`.
        source: The bytes of its configuration's file.
        place: The file's path, named in errors.

    Returns:
        Value and σ by the parameter's key; the document; and the text of a configuration. In it the
            tolerances are those that remain, and learnt offsets of sensors are effects.

    Raises:
        ConfigError: Nothing is learnt, the service keeps no checkpoint, or no checkpoint of this
            configuration exists.
    """
    machine, file = MachineModel.of(config, learns=True), config.checkpoint_file
    if (learning := machine.plant.learning) is None or not learning.names:
        raise ConfigError(f"{place}: estimator.learn: nothing is learnt; name the parameters to learn")
    if file is None:
        raise ConfigError(f"{place}: the service keeps no checkpoint; give [checkpoint] directory")
    try:
        state = load_checkpoint(file, CheckpointFit.of(machine)).estimator
    except UnfitError as error:
        name = Path(place).name
        raise ConfigError(f"{file}: {error}; run the service by {name} for some hours") from None
    first = len(state.x_hat) - machine.plant.learnt
    learnt = learning.estimates(state.x_hat[first:], state.P[first:, first:])
    changes = learnt_changes(config, learnt)
    text = with_effects(write_back(text_of(source), changes.values | changes.left), changes.biases)
    parameters = {key: {"value": value, "sigma": sigma} for key, (value, sigma) in learnt.items()}
    return learnt, provenance(source, [file.name]) | {"parameters": parameters}, text
