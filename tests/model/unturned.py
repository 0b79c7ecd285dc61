"""A plant on the modes of the screw, lags and nodes, before it is taken to its own modes."""

from __future__ import annotations

import numpy as np

from observer.config import Config
from observer.model.build import full_model, keep_modes
from observer.model.couple import with_coupling
from observer.model.generator import Constant
from observer.model.plant import Plant
from observer.model.realise import realise
from observer.model.reduce import bed_rows, reduce
from observer.model.rod.modes import Modes


def unturned(config: Config) -> tuple[Plant, Constant, Modes]:
    """The plant, what lasts of its couplings, and the screw's modes."""
    machine = realise(config)
    full = full_model(machine.config, machine.terms)
    plant, modes = reduce(full, keep_modes(machine.config, full.modes))
    sigma_W = np.array([s.initial_sigma_W for s in machine.config.source])
    rows = bed_rows(full.places)
    return *with_coupling(plant, modes, machine.config, machine.terms, sigma_W, rows), modes
