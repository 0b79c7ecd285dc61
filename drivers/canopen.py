"""The nut's position from a CANopen DS-402 drive: object 0x6064, received or requested.

There are two modes. The drive sends its process data on its own, and this computer sends nothing; or this
computer requests an SDO upload, which is a read, each period. Downloads, network management and SYNC are
never sent.
"""

from __future__ import annotations

import struct
import threading
import time
from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import AfterValidator, Field, model_validator

from drivers.places import CanTable
from drivers.protocol import ChannelName, Decoded, Driver, not_zero
from observer.config.quantities import Count, Finite

if TYPE_CHECKING:  # the bus library is imported only when it is used
    import can

    from drivers.can_bus import Decode, Pump
    from drivers.can_reader import BusReader

POSITION_ACTUAL_VALUE = 0x6064
TPDO_1 = 0x180
SDO_REPLY = 0x580
SDO_REQUEST = 0x600
_INT32 = struct.Struct("<i")
_SDO = struct.Struct("<BHBi")
_UPLOAD_REQUEST = 0x40  # initiate upload (CiA 301, 7.2.4.3.6)
_UPLOADED_FOUR_BYTES = 0x43  # its expedited answer, size indicated, four bytes
_ABORTED = 0x80


class CanopenSettings(CanTable):
    """The actual position (object 0x6064) of a CANopen DS-402 drive.

    metres = counts / counts_per_m + offset_m. With `mode = "tpdo"` the driver listens to the drive's own
    process data: identifier `cob_id`, position at byte `position_byte`. With `mode = "sdo"` it requests the
    object each period. Only this mode sends, and it sends upload (read) requests only.
    """

    kind: Literal["canopen"]
    node_id: Annotated[Count, Field(ge=1, le=127)]
    mode: Literal["tpdo", "sdo"] = "tpdo"
    cob_id: Annotated[Count, Field(ge=0x181, le=0x57F)] | None = None
    position_byte: Annotated[Count, Field(ge=0, le=4)] = 0
    counts_per_m: Annotated[Finite, AfterValidator(not_zero)]
    offset_m: Finite = 0.0
    position_channel: ChannelName = "nut_position_m"

    @model_validator(mode="after")
    def _sensible(self) -> CanopenSettings:
        if self.mode == "sdo" and self.cob_id is not None:
            raise ValueError('cob_id belongs to mode = "tpdo"; remove it')
        return self

    @property
    def delivered(self) -> tuple[str, ...]:
        """The one channel of the driver: the nut's position in m."""
        return (self.position_channel,)

    @property
    def listens(self) -> bool:
        """Whether the driver only listens and never sends.

        With `mode = "sdo"` it sends one upload request each period, so the interface cannot be listen-only.
        """
        return self.mode == "tpdo"

    def open(self, name: str) -> Driver:
        """Make the driver of the drive's position.

        With `mode = "tpdo"` it only receives. With `mode = "sdo"` its thread also sends the requests. The bus
        is not opened before `run`.
        """
        from drivers.can_bus import BusDriver  # noqa: PLC0415  (the bus library is imported only when it is used)

        if self.mode == "tpdo":
            return BusDriver(name, self, tpdo_decoder(self))
        return BusDriver(name, self, sdo_decoder(self), sdo_pump(self))


def position_m(counts: int, settings: CanopenSettings) -> float:
    """Return the position in m from drive units: counts / counts_per_m + offset_m."""
    return counts / settings.counts_per_m + settings.offset_m


def tpdo_decoder(settings: CanopenSettings) -> Decode:
    """Return a decoder of the process data message that carries the position.

    The position is a signed 32-bit integer, least significant byte first, from byte `position_byte` on.

    Returns:
        A function of a frame. It gives None for other frames, and NaN with the fault `short_frame` for a
        message that ends before the position.
    """
    identifier = settings.cob_id if settings.cob_id is not None else TPDO_1 + settings.node_id
    first = settings.position_byte

    def decode(frame: can.Message) -> Decoded | None:
        if frame.arbitration_id != identifier or not _is_data(frame):
            return None
        if len(frame.data) < first + _INT32.size:
            return _fault(settings, "short_frame")
        (counts,) = _INT32.unpack_from(frame.data, first)
        return {settings.position_channel: position_m(counts, settings)}, {}

    return decode


def sdo_decoder(settings: CanopenSettings) -> Decode:
    """Return a decoder of the drive's replies to SDO uploads (CiA 301, 7.2.4.3.6).

    Returns:
        A function of a frame. It gives None for frames of other nodes or objects. Its faults are
        `short_frame`, `bad_reply`, and `sdo_abort_…` with the drive's abort code.
    """

    def decode(frame: can.Message) -> Decoded | None:
        if frame.arbitration_id != SDO_REPLY + settings.node_id or not _is_data(frame):
            return None
        if len(frame.data) != _SDO.size:
            return _fault(settings, "short_frame")
        command, index, subindex, counts = _SDO.unpack(frame.data)
        if (index, subindex) != (POSITION_ACTUAL_VALUE, 0):
            return None
        if command == _ABORTED:
            return _fault(settings, f"sdo_abort_{counts & 0xFFFFFFFF:08x}")
        if command != _UPLOADED_FOUR_BYTES:
            return _fault(settings, "bad_reply")
        return {settings.position_channel: position_m(counts, settings)}, {}

    return decode


def sdo_pump(settings: CanopenSettings) -> Pump:
    """Return a pump that requests the position each period and hands on every frame in between.

    Returns:
        A function for the driver's thread. It sends one upload request each `period_s`, and returns when its
        event is set. It raises whatever the interface raises when sending fails.
    """
    import can  # noqa: PLC0415

    from drivers.can_bus import RECEIVE_TIMEOUT_S  # noqa: PLC0415

    request = can.Message(
        arbitration_id=SDO_REQUEST + settings.node_id,
        data=_SDO.pack(_UPLOAD_REQUEST, POSITION_ACTUAL_VALUE, 0, 0),
        is_extended_id=False,
    )

    def pump(reader: BusReader, stop: threading.Event) -> None:
        next_s = time.monotonic()
        while not stop.is_set():
            reader.bus.send(request, timeout=RECEIVE_TIMEOUT_S)
            next_s = max(next_s + settings.period_s, time.monotonic())
            while not stop.is_set() and (wait_s := next_s - time.monotonic()) > 0:
                reader.read(min(wait_s, RECEIVE_TIMEOUT_S))

    return pump


def _is_data(frame: can.Message) -> bool:
    return not (frame.is_error_frame or frame.is_remote_frame or frame.is_extended_id or frame.is_fd)


def _fault(settings: CanopenSettings, fault: str) -> Decoded:
    return {settings.position_channel: float("nan")}, {settings.position_channel: fault}
