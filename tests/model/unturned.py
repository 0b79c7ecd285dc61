"""A plant on the modes of the screw, lags and nodes, before it is taken to its own modes."""

from __future__ import annotations

from observer.config.machine import Config
from observer.model.bending import with_bending
from observer.model.build import full_model, keep_modes
from observer.model.couple import with_coupling
from observer.model.generator import Constant
from observer.model.plant import Plant
from observer.model.realise import realise
from observer.model.reduce import FullModel, reduce
from observer.model.rod.modes import Modes


def unturned(config: Config) -> tuple[Plant, Constant, FullModel, Modes]:
    """The plant, its constant couplings, the full model, and the screw's modes."""
    machine = realise(config)
    full = full_model(machine.config, machine.terms)
    full, mode_numbers, _ = with_bending(full, keep_modes(machine.config, full.modes))
    plant, modes = reduce(full, mode_numbers)
    return *with_coupling(plant, modes, full, machine.config, machine.terms), full, modes
