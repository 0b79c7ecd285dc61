"""A drive that processes one frame after the other in memory that it allocates once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np

from observer.frames import FloatArray, Inputs, NutPath
from observer.kernels import record
from observer.kernels.layout import Bundle, Fields
from observer.model.drive import Drive, DriveDesk, DriveState, turned
from observer.model.plant import MovingSource, Plant
from observer.model.rod import moving
from observer.model.rod.moving import NutDesk


class Frame:
    """The memory of one frame (see `align.walk.Frames`), with a record of each position's samples.

    Attributes:
        bundle: All arrays of the frame in one piece of memory.
        channels: Names of the channels.
        paths: Record of the samples of each position channel.
    """

    def __init__(self, fields: Fields, channels: tuple[str, ...], positions: Sequence[str]) -> None:
        """Allocate the memory.

        Args:
            fields: Names, types and shapes of the frame's arrays.
            channels: Names of the channels.
            positions: Names of the position channels.
        """
        self.bundle, self.channels = Bundle(fields), channels
        samples, offset = self.bundle["samples"], self.bundle["offset"]
        self._samples, self._offset = (
            dict(zip(positions, samples, strict=True)),
            dict(zip(positions, offset, strict=True)),
        )
        self.paths = {
            name: record(NutPath(array[0], array[1], self._offset[name], array[2], array[3]))
            for name, array in self._samples.items()
        }

    def path(self, channel: str) -> NutPath:
        """Return the samples of a position since the frame before, as views.

        Args:
            channel: The position channel.
        """
        offset = self._offset[channel]
        time_s, position_m, driven_m_s, speed_age_s = self._samples[channel][:, : offset[-1]]
        return NutPath(time_s, position_m, offset, driven_m_s, speed_age_s)


class LiveNut(NamedTuple):
    """A nut for the kernel.

    Attributes:
        table: Record of its `NutTable`.
        desk: Record of its `NutDesk`.
        path: Record of the samples of its position.
    """

    table: Any
    desk: Any
    path: Any


class DriveTick(NamedTuple):
    """The argument of the kernel for one frame.

    Attributes:
        octets: Bytes of the frame.
        read: Record of `ColumnsRead`.
        desk: Inputs and outputs of the kernel.
        dt_s: Length of the step, s, (1,).
        moment: Times of the first and of the last frame, s, (2,).
        nuts: Records of `LiveNut`.
        inputs: Record of the resulting `Inputs`.
        before: Fills in the heats by the laws, in Python.
        after: Step in Python after the kernel's own, or None.
    """

    octets: Any
    read: Any
    desk: DriveDesk
    dt_s: FloatArray
    moment: FloatArray
    nuts: tuple[Any, ...]
    inputs: Any
    before: Callable[[], None]
    after: Callable[[], None] | None


class LiveDrive:
    """Converts frames to inputs by the same kernels as `Drive.run`.

    Attributes:
        inputs: Inputs of the last frame, overwritten by the next.
        inputs_record: The same as a record.
        record: Argument of `kernels.step_frame`.
    """

    def __init__(self, drive: Drive, plant: Plant, frame: Frame) -> None:
        """Allocate the memory.

        Args:
            drive: The plant's reading of the channels.
            plant: The model.
            frame: Memory of the frames.

        Raises:
            KeyError: If the frame lacks a channel that the model reads.
        """
        self._drive, self._plant, self._frame = drive, plant, frame
        drive.set_channels(frame.channels)
        state = drive.initial()
        self._turns = state.turns
        self._bundle = Bundle.of(_arrays(state))
        empty = Inputs.empty(
            len(state.law_W), len(state.z), plant.rows.sensors, len(plant.moving), len(plant.decay_1_s),
            len(plant.rows.C),
        )  # fmt: skip
        self._inputs = Bundle.of(empty._asdict())
        self.inputs = Inputs._make(self._inputs[name] for name in Inputs._fields)
        self.inputs_record = record(self.inputs)
        self._law, state_fields, frame_fields, u = (
            np.empty((1, len(state.law_W))),
            self._bundle,
            frame.bundle,
            self.inputs,
        )
        desk = DriveDesk(
            frame_fields["time_s"], frame_fields["values"], frame_fields["fresh"], frame_fields["quality"],
            state_fields["law_W"], state_fields["z"], self._law, np.empty((1, len(state.z))), u.z_start,
            u.z_end, u.law_W, u.law_jump_W, u.y_degC, u.usable, u.quality, u.degraded,
        )  # fmt: skip
        self._nuts = [self._nut(i, source) for i, source in enumerate(plant.moving)]
        nuts = tuple(
            record(LiveNut(record(source.table), record(nut), frame.paths[source.channel]))
            for source, nut in zip(plant.moving, self._nuts, strict=True)
        )
        after = bool(drive.losses) or any(source.ends_fraction for source in plant.moving) or drive.displaces
        self.record = record(
            DriveTick(
                frame_fields.octets, drive.read, desk, frame_fields["dt_s"], state_fields["moment"],
                nuts, self.inputs_record, self._put_heats,
                self._put_rest if after else None,
            )
        )  # fmt: skip

    def _nut(self, i: int, source: MovingSource) -> NutDesk:
        B, C = len(source.table.mean_B), len(source.table.mean_C)
        state_fields = {name: self._bundle[f"{name}{i}"] for name in NutDesk._fields[:6]}
        out_B, out_C = self.inputs.moving_B[:, i], self.inputs.moving_C[:, i]
        return NutDesk(**state_fields, out_B=out_B, out_C=out_C, step_B=np.empty(B), step_C=np.empty(C))

    def _put_heats(self) -> None:
        """Fill in the heats by the laws."""
        state_fields, frame = self._bundle, self._frame.bundle
        state_fields["running_s"][:] = self._drive.heats(
            self._law, frame["values"], frame["dt_s"], state_fields["running_s"]
        )

    def _put_rest(self) -> None:
        """Fill in losses, heat at the reversals of nuts, and displacements."""
        u = self.inputs
        self._drive.displace(u.time_s, u.y_degC, u.usable, float(self._bundle["moment"][0]))
        if self._drive.losses:
            values = self._frame.bundle["values"]
            u.loss_1_s[:], u.loss_degC[:] = self._drive.loss(values, u.z_end[:, self._plant.known.ambient])
        for i, source in enumerate(self._plant.moving):
            if source.ends_fraction:
                self._turn(i, source)

    def _turn(self, i: int, source: MovingSource) -> None:
        """Move a part of a nut's heat to its reversals."""
        B, C = self._nuts[i].out_B, self._nuts[i].out_C
        turn, B[:], C[:] = turned(
            source, self._turns[i], self._frame.bundle["dt_s"], self._frame.path(source.channel), B, C
        )
        self._turns = (*self._turns[:i], turn, *self._turns[i + 1 :])

    def keep_inputs(self) -> Inputs:
        """Return a copy of the inputs of the last frame, for whoever uses them after the next one."""
        data = self._inputs.octets.tobytes()
        return Inputs._make(self._inputs.fields.columns(data, Inputs._fields))

    @property
    def state(self) -> DriveState:
        """The state after the last frame, a copy as `Drive.run` takes it."""
        bundle = self._bundle
        begin_s, last_s = bundle["moment"].tolist()
        nuts = tuple(map(moving.state_of, self._nuts))
        return DriveState(
            bundle["law_W"].copy(),
            bundle["z"].copy(),
            nuts,
            self._turns,
            begin_s,
            last_s,
            bundle["running_s"].copy(),
        )

    def take(self, state: DriveState) -> None:
        """Replace the state, as after a restart from a checkpoint."""
        for name, array in _arrays(state).items():
            self._bundle[name][...] = array
        self._turns = state.turns


def _arrays(state: DriveState) -> dict[str, FloatArray]:
    """A state's arrays by name."""
    moment = np.array([state.begin_s, state.last_s])
    arrays = {"law_W": state.law_W, "z": state.z, "moment": moment, "running_s": state.running_s}
    for i, nut in enumerate(state.nuts):
        arrays |= {f"{name}{i}": array for name, array in moving.arrays_of(nut).items()}
    return arrays
