"""The configuration of outlets: page, metrics, MQTT, OPC UA and those of other packages.

Each is off until its table is there. An outlet of another package is selected by `kind = "module:Class"` or
by a name of the entry-point group `ballscrew_observer.outlets`.
"""

from __future__ import annotations

import ipaddress
import re
from abc import abstractmethod
from collections.abc import AsyncIterator, Callable
from typing import Annotated, Any, Protocol

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    SerializeAsAny,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    model_validator,
)

from observer.config.outside import entry_names, is_outside, outside
from observer.config.quantities import File, Flag, Name, Number, Section, all_or_none

_ADDRESS = re.compile(r"(?P<host>[A-Za-z0-9_.-]+|\[[0-9A-Fa-f:.]+\]):(?P<port>\d{1,5})")
_OPCUA = "opc.tcp://"
_MOST_PORT = 65_535
_LEAST_INTERVAL_S = 1e-3


def host_and_port(address: str) -> tuple[str, int]:
    """Return host, without brackets, and port of an address `host:port`.

    Args:
        address: A name, an IPv4 address or an IPv6 address in brackets, and a port from 1 to 65535.

    Raises:
        ValueError: If it is anything else.
    """
    match = _ADDRESS.fullmatch(address)
    if not match or not 1 <= int(match["port"]) <= _MOST_PORT:
        raise ValueError(f"{address[:60]!r} is no address; write host:port, like 127.0.0.1:8080")
    return match["host"].strip("[]"), int(match["port"])


def is_loopback(address: str) -> bool:
    """Return whether only this computer can reach an address.

    A name other than `localhost` counts as reachable, because it is not resolved.

    Raises:
        ValueError: If the address is invalid.
    """
    host, _ = host_and_port(address)
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _checked(address: str) -> str:
    host_and_port(address)
    return address


def _checked_interval(interval_s: float) -> float:
    if 0.0 < interval_s < _LEAST_INTERVAL_S:
        raise ValueError(f"{interval_s:g} s is too short; give 0, which is every step, or 0.001 and more")
    return interval_s


def _checked_opcua(url: str) -> str:
    address = url.removeprefix(_OPCUA)
    if address == url:
        raise ValueError(f"{url[:60]!r} is no address of OPC UA; write it like {_OPCUA}127.0.0.1:4840")
    host_and_port(address)
    return url


Address = Annotated[str, Field(max_length=300), AfterValidator(_checked)]


OpcuaAddress = Annotated[str, Field(max_length=300), AfterValidator(_checked_opcua)]
Topic = Annotated[str, Field(pattern=r"^[^#+\s/][^#+\s]*$", max_length=200)]


class Page(Section):
    """The page for people: where it listens, and the names and passwords of those who may look.

    An address that other computers reach is rejected without `users_file`.
    """

    #: where it is served, `host:port`; any address but this computer's requires `users_file`
    listen: Address = "127.0.0.1:8080"
    users_file: File | None = None  #: a file of lines `name:password`; viewers must then log in
    certificate: File | None = None  #: PEM file; the page is then served by TLS
    key: File | None = None  #: its key

    _pair = all_or_none("certificate", "key")

    @model_validator(mode="after")
    def _others_log_in(self) -> Page:
        if not is_loopback(self.listen) and self.users_file is None:
            raise ValueError(
                f"others reach {self.listen}, so they have to log in; name a file of user:password lines in "
                "users_file, or listen on 127.0.0.1"
            )
        return self

    @property
    def doubt(self) -> str | None:
        """Warning about passwords that go to other computers without TLS; None with TLS or on this computer
        only.
        """
        if is_loopback(self.listen) or self.certificate is not None:
            return None
        return (
            f"page.listen: others reach {self.listen} without TLS, so passwords and values are sent "
            "unencrypted; name page.certificate and page.key"
        )


ReportState = Callable[[dict[str, Any]], None]
"""Takes what has changed in the state of an outlet: `address` where it serves, `reason` why it does not."""


class NewestMessages(Protocol):
    """The newest message of every key of an axis."""

    @property
    def is_stale(self) -> bool:
        """Whether no estimate has come for two periods: the service is silent, frozen or gone."""

    def document(self, key: str) -> dict[str, Any]:
        """The newest document of a key, decoded; empty before the first."""

    def messages(self) -> AsyncIterator[tuple[str, bytes]]:
        """Yield key and payload of the stored messages, then of new ones as they arrive.

        A slow reader gets only the newest message of each key. The payload is empty where a message is
        dropped, because the service has started again.
        """


class OutletTable(BaseModel):
    """A table `[outlets.also.<name>]`: its keys, and how its outlet serves them."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    kind: str

    @abstractmethod
    async def serve(self, prefix: str, latest: NewestMessages, report_state: ReportState) -> None:
        """Serve until cancelled, in an event loop of its own.

        It is called again a second after it returns or raises.

        Args:
            prefix: The key expression of the axis, `ballscrew/<machine>/<axis>`.
            latest: The messages of the axis.
            report_state: To be called with `{"reason": None, "address": …}` once it serves.

        Raises:
            Exception: Any; `health` then has its sentence as a reason.
        """


def _from_outside(value: Any, validate_instance: ValidatorFunctionWrapHandler) -> OutletTable:
    """Validate an outlet's table by the class that its `kind` names; raises `ValueError` if it is none."""
    if not isinstance(value, dict):
        outlet: OutletTable = validate_instance(value)
        return outlet
    kind = value.get("kind")
    if not is_outside(kind, "outlets"):
        kinds = ", ".join((*entry_names("outlets"), "module:Class"))
        raise ValueError(f'kind is "{kind}", which is no outlet of another package; give one of {kinds}')
    table = outside(kind, "outlets")
    if not (isinstance(table, type) and issubclass(table, OutletTable)):
        raise ValueError(f"{kind} is no outlet; name a subclass of observer.config.outlets.OutletTable")
    return table.model_validate(value)


OutsideOutlet = Annotated[OutletTable, WrapValidator(_from_outside), SerializeAsAny()]


class OutletSettings(Section):
    """Whether the service starts `observer outlets`, and which outlets of other packages it serves."""

    start: Flag = True  #: false where you start `observer outlets` yourself, here or on another computer
    #: [outlets of your own](../how-to/add-an-outlet.md), each a table `[outlets.also.<name>]` with its `kind`
    also: dict[Name, OutsideOutlet] = Field(default_factory=dict, max_length=16)


class Metrics(Section):
    """Figures for Prometheus: where they can be scraped."""

    listen: Address = "127.0.0.1:9187"  #: `host:port`; open to whoever reaches the port


class Mqtt(Section):
    """A broker of MQTT; its topics are the Zenoh keys, below `prefix` if there is one."""

    broker: Address = "127.0.0.1:1883"  #: where the broker listens, `host:port`
    prefix: Topic | None = None  #: prefix of every topic
    user: Name | None = None  #: user name of the service
    password_file: File | None = None  #: a file whose first line is the password
    ca: File | None = None  #: PEM file of the authority of the broker; the connection is then encrypted
    late: Flag = True  #: sends missed messages from the recordings later
    #: one missed step per so many seconds; 0 is every step
    late_every_s: Annotated[Number, Field(ge=0, le=3600), AfterValidator(_checked_interval)] = 60.0
    late_rate_Hz: Annotated[Number, Field(ge=0.1, le=1000)] = 20.0  #: largest rate of late steps, 0.1 to 1000

    _pair = all_or_none("user", "password_file")


class Opcua(Section):
    """A server of OPC UA: its address, its users, and the files for its encryption.

    An address that other computers reach is rejected without `users_file` or `anonymous`. A `users_file` is
    rejected without a certificate, because passwords would be sent unencrypted.
    """

    #: address; beyond this computer it requires `users_file`, `certificate` and `key`, or `anonymous`
    listen: OpcuaAddress = "opc.tcp://127.0.0.1:4840"
    #: a file of lines `name:password`: whoever connects must log in, encrypted
    users_file: File | None = None
    certificate: File | None = None  #: PEM or DER file, RSA; all connections are then encrypted
    #: its key, 2048 bits or more, without a passphrase; no other user may read the file
    key: File | None = None
    anonymous: bool = False  #: whoever reaches the port may read, from other computers too

    _pair = all_or_none("certificate", "key")

    @model_validator(mode="after")
    def _others_log_in(self) -> Opcua:
        if self.users_file is not None and self.anonymous:
            raise ValueError("users_file asks for names and anonymous asks for none; give one of them")
        if self.users_file is not None and self.certificate is None:
            raise ValueError("a password goes over no wire in the clear; give certificate and key too")
        asks = self.users_file is not None or self.anonymous
        if not asks and not is_loopback(self.listen.removeprefix(_OPCUA)):
            raise ValueError(
                f"others reach {self.listen}, so they have to log in; give users_file, certificate and key, "
                "or listen on 127.0.0.1; anonymous = true lets whoever reaches it read"
            )
        return self
