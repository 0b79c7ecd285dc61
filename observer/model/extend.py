"""Additional states of a plant: nodes beside the screw, lagging sensors, uncertain parameters."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from observer.config.machine import Config
from observer.config.sections import Description
from observer.config.sensors import Sensor
from observer.frames import FloatArray
from observer.model.learning import REST_K, Change, Nuisance, Parameter, learning_of, no_change
from observer.model.network import Attached, NodeModes
from observer.model.plant import Plant
from observer.model.reduce import FullModel, dropped_under
from observer.model.rod.modes import Modes, Stretch, modal_input
from observer.model.rod.screw import surface_rate


class States(NamedTuple):
    """e states that decay independently of each other.

    Attributes:
        decay_1_s: Decay rates, (e,).
        B: Input rows of the heats, (e, m).
        E: Input rows of the known inputs, (e, p).
        start_rows: Their start, as rows of the states before them, (e, n_x).
        prior_P: Covariance about that start, (e, e).
        smooth_P: The part of it that a machine at rest has too, (e, e).
        uniform: Their values in a machine at 1 °C, (e,).
    """

    decay_1_s: FloatArray
    B: FloatArray
    E: FloatArray
    start_rows: FloatArray
    prior_P: FloatArray
    smooth_P: FloatArray
    uniform: FloatArray


def node_states(
    plant: Plant,
    bodies: Attached,
    network_modes: NodeModes,
    places: FloatArray,
    mean: FloatArray,
    past_P: FloatArray,
) -> States:
    """Return the states of the nodes' own modes.

    A node starts at the temperature of the screw under it, `places` (m, n_x), or at the screw's mean (n_x,).
    The prior variance is that of this temperature, plus the effect of heats before the start, `past_P` (n,
    n).
    """
    n = len(bodies.names)
    start = np.tile(mean, (n, 1))
    for node, source, _ in bodies.ties:
        start[node] = places[source]
    apart = np.diag(np.einsum("ia,ab,ib->i", start, plant.smooth_P, start))
    E = np.zeros((n, len(plant.known_names)))
    E[:, plant.known.ambient] = network_modes.ambient
    return States(
        decay_1_s=network_modes.decay_1_s,
        B=network_modes.input @ bodies.shares,
        E=E,
        start_rows=network_modes.inverse @ start,
        prior_P=network_modes.inverse @ (apart + past_P) @ network_modes.inverse.T,
        smooth_P=network_modes.inverse @ apart @ network_modes.inverse.T,
        uniform=network_modes.inverse.sum(axis=1),
    )


def lag_states(rows: FloatArray, sources: int, inputs: int) -> States:
    """Return the states of sensors that follow `rows` (e, n_x); they start at these."""
    e = len(rows)
    exact = np.zeros((e, e))
    return States(np.zeros(e), np.zeros((e, sources)), np.zeros((e, inputs)), rows, exact, exact, np.ones(e))


def extended(plant: Plant, added: States) -> Plant:
    """Return the plant with additional states at its end."""
    if not len(added.start_rows):
        return plant
    first = len(plant.decay_1_s)
    n_x = first + len(added.start_rows)
    J = np.vstack([np.eye(first), added.start_rows])
    prior, smooth = J @ plant.prior_P @ J.T, J @ plant.smooth_P @ J.T
    prior[first:, first:] += added.prior_P
    smooth[first:, first:] += added.smooth_P
    return replace(
        plant,
        decay_1_s=np.concatenate([plant.decay_1_s, added.decay_1_s]),
        B=np.vstack([plant.B, added.B]),
        E=np.vstack([plant.E, added.E]),
        rows=replace(plant.rows, C=wide(plant.rows.C, n_x)),
        moving=tuple(  # they heat the new states too, wherever they are
            s.with_table(
                mean_B=np.concatenate([s.table.mean_B, added.B[:, s.index]]), turn=_wider(s.table.turn, n_x)
            )
            for s in plant.moving
        ),
        uniform=np.concatenate([plant.uniform, added.uniform]),
        prior_P=prior,
        smooth_P=smooth,
        field_noise_Q=np.pad(plant.field_noise_Q, (0, n_x - first)),
    )


def with_node_sensors(
    plant: Plant,
    machine: Description,
    bodies: Attached,
    network_modes: NodeModes,
    first: int,
    bed: FloatArray,
) -> Plant:
    """Connect sensors on nodes to these, and the thermal error to a bed that is a node.

    `bed` (R,) is the column of the bed; the nodes' states begin at `first`.
    """
    on = {i: bodies.names.index(s.on) for i, s in enumerate(machine.sensor) if s.on is not None}
    plant = _without_readings(plant, list(on))
    for sensor, node in on.items():
        plant.rows.C[sensor, first : first + len(bodies.names)] = network_modes.shape[node]
    if machine.bed is not None and machine.bed.on is not None:
        of_bed = network_modes.shape[bodies.names.index(machine.bed.on)]
        plant.rows.C[:, first : first + len(bodies.names)] += np.multiply.outer(bed, of_bed)
    return plant


def with_shown_part(plant: Plant, sensors: Sequence[Sensor]) -> Plant:
    """Return the plant whose sensors show a part `shows` of their temperature's rise above the air.

    A sensor reads the air's temperature for the remainder. Its own offset is not scaled.
    """
    part = np.array([sensor.shows for sensor in sensors])
    if (part == 1.0).all():
        return plant
    s, rows = len(part), plant.rows
    row_parts = np.concatenate([part, np.ones(len(rows.C) - s)])
    F = np.where(plant.known.offset, rows.F, row_parts[:, None] * rows.F)
    F[:s, plant.known.ambient] += 1.0 - part
    moving = tuple(
        m.with_table(mean_C=m.table.mean_C * row_parts, table_C=m.table.table_C * row_parts)
        for m in plant.moving
    )
    return replace(plant, rows=replace(rows, C=row_parts[:, None] * rows.C, F=F), moving=moving)


def with_lagging_sensors(plant: Plant, sensors: Sequence[int]) -> Plant:
    """Return the plant whose `sensors` read the last states, one each."""
    plant = _without_readings(plant, sensors)
    for i, sensor in enumerate(sensors):
        plant.rows.C[sensor, plant.rows.C.shape[1] - len(sensors) + i] = 1.0
    return plant


def _wider(turn: FloatArray, n_x: int) -> FloatArray:
    """A nut's `turn`, if it has one, with additional states, which it does not change."""
    if not len(turn):
        return turn
    rows, columns = turn.shape
    out = np.zeros((n_x, columns + n_x - rows))
    out[:rows, :columns], out[rows:, columns:] = turn, np.eye(n_x - rows)
    return out


def padded(vector: FloatArray, size: int) -> FloatArray:
    """Return the vector with zeros behind it."""
    return np.concatenate([vector, np.zeros(size - len(vector))])


def wide(matrix: FloatArray, columns: int) -> FloatArray:
    """Return the matrix with columns of zeros behind it."""
    return np.hstack([matrix, np.zeros((len(matrix), columns - matrix.shape[1]))])


def _without_readings(plant: Plant, sensors: Sequence[int]) -> Plant:
    """The plant whose `sensors` read neither states nor inputs, except for their own offsets."""
    C, F = plant.rows.C.copy(), plant.rows.F.copy()
    C[list(sensors)] = 0.0
    F[list(sensors)] = np.where(plant.known.offset, F[list(sensors)], 0.0)
    moving = tuple(
        s.with_table(mean_C=_without(s.table.mean_C, sensors), table_C=_without(s.table.table_C, sensors))
        for s in plant.moving
    )
    return replace(plant, rows=replace(plant.rows, C=C, F=F), moving=moving)


def _without(columns: FloatArray, sensors: Sequence[int]) -> FloatArray:
    """A lag's output column, or a table of them, with those sensors' entries at zero."""
    out = columns.copy()
    out[..., list(sensors)] = 0.0
    return out


def with_learning(
    plant: Plant, config: Config, full: FullModel, modes: Modes, body_parameters: Iterable[Parameter] = ()
) -> Plant:
    """Return the plant with the uncertain parameters of machine, bodies and sensors; unchanged if none is.

    The caller makes `body_parameters`, those of the bodies beside the screw.
    """
    parameters = [
        *_of_machine(plant, config, full, modes),
        *body_parameters,
        *_of_sensors(plant, config, modes),
    ]
    rest = REST_K**2 / config.estimator.initial_sigma_K**2
    return with_parameters(plant, parameters, config.learnt, rest)


def with_parameters(
    plant: Plant, parameters: Sequence[Parameter], learnt: Collection[str], rest: float = 0.0
) -> Plant:
    """Return the plant with those of the parameters that are uncertain.

    Parameters with a kind in `learnt` are learnt; the others are considered. Their effects are described on
    the screw's modes, lags and nodes in any basis. The variance of the screw's temperature against the air's
    after a night is `rest` times that of its unknown field.
    """
    uncertain = [p for p in parameters if p.sigma > 0.0]
    if not uncertain:
        return plant
    end_is_prescribed = plant.known.left_end is not None or plant.known.right_end is not None
    learning = learning_of(
        uncertain,
        learnt,
        len(plant.decay_1_s),
        len(plant.known_names),
        ambient=plant.known.ambient,
        rest_P=None if end_is_prescribed else rest * plant.smooth_P,
    )
    if plant.basis is not None:
        learning = replace(learning, arrays=learning.arrays.in_basis(plant.basis.V, plant.basis.inverse))
    return replace(plant, learning=learning, layout=replace(plant.layout, learned=learning.names))


def _of_machine(plant: Plant, config: Config, full: FullModel, modes: Modes) -> Iterator[Parameter]:
    """Yield the parameters of the machine: film, material, ambient, ends, and the scale of every law."""
    tolerance, screw = config.tolerance, config.screw
    n_x, unchanged = len(plant.decay_1_s), no_change(len(plant.decay_1_s), len(plant.known_names))
    film_1_s, air = modes.rod.diffusivity_m2_s * modes.rod.fin_1_m**2, plant.known.ambient
    is_mode = np.arange(n_x) < len(modes)
    is_lag = (np.arange(n_x) >= len(modes)) & (np.arange(n_x) < plant.lag_slice.stop)
    passive = unchanged._replace(
        rate_1_s=np.where(is_mode, -plant.decay_1_s, 0.0), inputs=np.where(is_mode, plant.E.T, 0.0)
    )
    film = unchanged._replace(inputs=unchanged.inputs.copy())
    film.inputs[air] = modes.rod.fin_1_m**2 * padded(modes.wetted(0.0, modes.rod.length_m), n_x)
    if modes.rod.profile is None:
        film = film._replace(rate_1_s=np.where(is_mode, -film_1_s, 0.0))
    else:  # it mixes the modes of a screw with sections
        loses, shape = np.linalg.eigh(modes.surface())
        row = wide(shape.T, n_x)
        film = film._replace(into=-film_1_s * loses[:, None] * row, feedback_row=row)
    ends = ((modes.rod.left, "left", 0.0), (modes.rod.right, "right", modes.rod.length_m))
    losses = [
        (side, end.biot_1_m * modes.rod.conductance_W_m, _lost_at(plant, full, modes, x_m))
        for end, side, x_m in ends
        if not end.prescribed
    ]
    lossy = [loss for loss in losses if loss[1] > 0.0]
    # all but the losses of film and ends; dropped modes conduct away too what their lags show
    conduction = unchanged._replace(
        rate_1_s=np.where(is_lag, -plant.decay_1_s, passive.rate_1_s - film.rate_1_s),
        into=np.vstack([-film.into, *(-loss_W_K * loss.into for _, loss_W_K, loss in lossy)]),
        feedback_row=np.vstack([film.feedback_row, *(loss.feedback_row for *_, loss in lossy)]),
        inputs=passive.inputs
        - film.inputs
        - sum((loss_W_K * loss.inputs for _, loss_W_K, loss in lossy), np.zeros_like(film.inputs)),
    )
    # with more of it, all that warms or cools is slower
    slower = unchanged._replace(
        rate_1_s=-passive.rate_1_s, inputs=-passive.inputs, heats=np.where(is_mode, -1.0, 0.0)
    )
    film_W_m2K = film_1_s / surface_rate(screw)
    for kind, sigma, change, name, value in (
        (Nuisance.CONVECTION, tolerance.convection if film_W_m2K > 0.0 else 0.0, film,
         "surface.convection_W_m2K", film_W_m2K),
        (Nuisance.CONDUCTIVITY, tolerance.conductivity, conduction,
         "screw.conductivity_W_mK", screw.conductivity_W_mK),
        (Nuisance.HEAT_CAPACITY, tolerance.heat_capacity, slower,
         "screw.specific_heat_J_kgK", screw.specific_heat_J_kgK),
    ):  # fmt: skip
        yield Parameter(kind, 0, sigma, change, name, value, unit=value)
    warmer = unchanged._replace(steady=plant.E[:, air])
    yield Parameter(Nuisance.AMBIENT, 0, tolerance.ambient_K, warmer, "ambient.offset_K")
    for side, loss_W_K, loss in losses:
        i = ("left", "right").index(side)
        yield Parameter(Nuisance.END, i, tolerance.end_W_K, loss, f"boundary.{side}.loss_W_K", loss_W_K)
    for j, index in enumerate(np.flatnonzero(plant.estimated).tolist()):
        source = config.source[index]
        if source.law is not None and Nuisance.LAW.key in config.learnt:
            name, law_change, scale = (
                f"source.{source.name}.scale",
                unchanged._replace(law=index),
                source.scale,
            )
            yield Parameter(Nuisance.LAW, j, config.law_uncertainty(source), law_change, name, scale, scale)


def _lost_at(plant: Plant, full: FullModel, modes: Modes, x_m: float) -> Change:
    """The effect of a loss of 1 W/K at an end; it cools dropped modes too if a source is there."""
    n_x, place = len(plant.decay_1_s), Stretch(x_m, x_m)
    into = padded(modal_input(modes, place), n_x)
    dropped, of_known = dropped_under(plant, modes, full, place)
    for j, heat in enumerate(full.heats):
        if heat.stretch == place and heat.share > 0.0:
            into[len(modes) + j] = plant.decay_1_s[len(modes) + j] / heat.share
            break
    row = padded(modes.theta(x_m)[0], n_x) + dropped
    inputs = -np.multiply.outer(of_known, into)
    inputs[plant.known.ambient] += into
    unchanged = no_change(n_x, len(plant.known_names))
    return unchanged._replace(into=-into, feedback_row=row, inputs=inputs)


def _of_sensors(plant: Plant, config: Config, modes: Modes) -> Iterator[Parameter]:
    """Yield the parameters of the sensors: offset, position, lag and the shown part of the rise."""
    n_x, tolerance = len(plant.decay_1_s), config.tolerance
    unchanged = no_change(n_x, len(plant.known_names))
    for i, sensor in enumerate(config.sensor):
        name, offset_K = f"sensor.{sensor.name}", sensor.offset(tolerance.offset_K)
        if sensor.shows != 1.0:  # the rest is what surrounds it, which is known as well as the air
            offset_K = math.hypot(offset_K, (1.0 - sensor.shows) * tolerance.ambient_K)
        if sensor.kind == "displacement":  # its place and lag matter little: growth is a mean over the screw
            change = unchanged._replace(shift_K=1.0)
            yield Parameter(Nuisance.OFFSET, i, offset_K, change, f"{name}.zero_um")
            continue
        yield Parameter(Nuisance.OFFSET, i, offset_K, unchanged._replace(shift_K=1.0), f"{name}.offset_K")
        if (place_m := sensor.position_m) is not None:  # one beside the screw has no place there
            slope = unchanged._replace(row=sensor.shows * padded(modes.slope(place_m), n_x))
            yield Parameter(Nuisance.PLACE, i, tolerance.position_m, slope, f"{name}.position_m", place_m)
        late = unchanged._replace(lag_s=tolerance.lag_s)
        yield Parameter(Nuisance.LAG, i, tolerance.lag_s, late, f"{name}.lag_s")
        if sensor.shows_tolerance is not None:
            change = unchanged._replace(row=plant.rows.C[i], row_known=_above_air(plant, i))
            yield Parameter(
                Nuisance.GAIN, i, sensor.shows_tolerance, change, f"{name}.shows", sensor.shows, sensor.shows
            )


def _above_air(plant: Plant, sensor: int) -> FloatArray:
    """The known inputs' row (p,) of a sensor's rise above the air."""
    row = np.where(plant.known.offset, 0.0, plant.rows.F[sensor])
    row[plant.known.ambient] -= 1.0
    return row
