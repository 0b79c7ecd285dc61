"""The configuration's tables of the Zenoh session: its endpoints, users and certificates."""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from observer.config.quantities import (
    Count,
    File,
    Flag,
    Name,
    NonNegative,
    Number,
    Positive,
    Section,
    all_or_none,
)

DEFAULT_ENDPOINT = "tcp/127.0.0.1:7447"
_ENDPOINT = re.compile(r"[a-z][a-z0-9_-]*/[^\s]+")


def checked_endpoint(text: str) -> str:
    """Return the endpoint unchanged.

    Args:
        text: An endpoint of Zenoh, `protocol/address`.

    Raises:
        ValueError: If it has another form; addresses are not resolved here.
    """
    if not _ENDPOINT.fullmatch(text):
        raise ValueError(f"{text!r} is no Zenoh endpoint; write it like {DEFAULT_ENDPOINT}")
    return text


Endpoint = Annotated[str, Field(max_length=1024), AfterValidator(checked_endpoint)]
Endpoints = Annotated[tuple[Endpoint, ...], Field(max_length=64)]
Subject = Annotated[str, Field(pattern=r"^(user|certificate):[^\s:]+$", max_length=128)]
_ENCRYPTED = ("tls/", "quic/")


class Tls(Section):
    """Certificates, as PEM files: one's own with its key, and the authority that others are judged by."""

    ca: File | None = None  #: the authority whose certificates are accepted
    certificate: File | None = None  #: the own certificate; needed to listen
    key: File | None = None  #: its key, without a password; no other user may read the file
    client_certificates: Flag = False  #: whoever connects must show a certificate of `ca`

    _pair = all_or_none("certificate", "key")

    @model_validator(mode="after")
    def _needs_an_authority(self) -> Tls:
        if self.client_certificates and self.ca is None:
            raise ValueError("client_certificates needs the authority that signed them; give ca")
        return self


class Login(Section):
    """Names and passwords, which stand in files: of those who connect here, and of this side elsewhere."""

    users_file: File | None = None  #: file of lines `name:password`; clients must log in
    user: Name | None = None  #: name by which this side logs in where it connects
    password_file: File | None = None  #: file that holds the password and nothing else

    @model_validator(mode="before")
    @classmethod
    def _no_password_in_the_open(cls, table: Any) -> Any:
        if isinstance(table, dict) and "password" in table:
            raise ValueError(
                "a password does not belong in a configuration; write it into a file of its own and name "
                "that in password_file"
            )
        return table

    _pair = all_or_none("user", "password_file")


class Access(Section):
    """The rights of each `user:NAME` or `certificate:COMMON-NAME`; all others have none.

    A table without names is rejected, and so is a name with two roles.
    """

    viewer: tuple[Subject, ...] = ()  #: who may read: `"user:NAME"` or `"certificate:NAME"` (common name)
    operator: tuple[Subject, ...] = ()  #: who may also command
    service: tuple[Subject, ...] = ()  #: who may also publish and answer

    @property
    def subjects(self) -> tuple[str, ...]:
        """All names with a right: viewers, operators, then services."""
        return self.viewer + self.operator + self.service

    @model_validator(mode="after")
    def _each_has_one_role(self) -> Access:
        if not self.subjects:
            raise ValueError(
                'names nobody, so nobody could connect; name somebody, as viewer = ["user:anna"]'
            )
        for subject in self.subjects:
            if self.subjects.count(subject) > 1:
                raise ValueError(
                    f'"{subject}" is named twice; give each one role, an operator may view as well'
                )
        return self


class Publish(Section):
    """The Zenoh session of the daemon.

    With `tls` every endpoint must be encrypted, and an encrypted one needs `tls`. Names in `access` must be
    able to log in. A client cannot have `access`, because its router decides.
    """

    #: `"peer"`, `"client"` (of a router) or `"router"` (is one)
    mode: Literal["client", "peer", "router"] = "peer"
    connect: Endpoints = ()  #: endpoints to connect to, as `"tcp/192.168.0.10:7447"`
    #: endpoints to listen on; without `listen` and `connect` it is `tcp/127.0.0.1:7447`, on this computer
    #: only; a `"client"` does not listen
    listen: Endpoints = ()
    #: highest rate at which field and error are sent as JSON
    field_rate_Hz: Annotated[Number, Field(ge=1e-3, le=50)] = 2.0
    history: Annotated[Count, Field(ge=1, le=100_000)] = 1000  #: how many estimates the queryable remembers
    tls: Tls | None = None  #: `[publish.tls]`, below
    login: Login | None = None  #: `[publish.login]`, below
    #: `[publish.access]`, below; without it everybody who can connect may do everything
    access: Access | None = None

    @property
    def listens(self) -> Endpoints:
        """Endpoints on which the session listens.

        Without `listen` and `connect` it is loopback, except for a client.
        """
        if self.listen or self.connect or self.mode == "client":
            return self.listen
        return (DEFAULT_ENDPOINT,)

    @property
    def reached_at(self) -> str:
        """Where a client on this computer reaches the session, else its router."""
        endpoint = next(iter((*self.listens, *self.connect)), DEFAULT_ENDPOINT)
        return endpoint.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:")

    @model_validator(mode="after")
    def _wires_are_encrypted_where_certificates_are(self) -> Publish:
        for endpoint in (*self.listen, *self.connect):
            if endpoint.startswith(_ENCRYPTED) and self.tls is None:
                raise ValueError(f"{endpoint} needs certificates; give [publish.tls]")
        if self.tls is None:
            return self
        if not self.listen and not self.connect:
            raise ValueError('tls is given but no endpoint; write listen = ["tls/…"] or connect = ["tls/…"]')
        for endpoint in (*self.listen, *self.connect):
            if not endpoint.startswith(_ENCRYPTED):
                raise ValueError(f"tls is given, but {endpoint} is not encrypted; write tls/ for tcp/")
        if self.listen and self.tls.certificate is None:
            raise ValueError("tls: to listen, the service needs a certificate; give certificate and key")
        return self

    @model_validator(mode="after")
    def _who_is_named_can_log_in(self) -> Publish:
        if self.access is None:
            return self
        if self.mode == "client":
            raise ValueError(
                "access has no effect on a client, whose router decides; write the table where that router "
                "is configured, and remove it here"
            )
        users = self.login is not None and self.login.users_file is not None
        certificates = self.tls is not None and self.tls.client_certificates
        for subject in self.access.subjects:
            if subject.startswith("user:") and not users:
                raise ValueError(
                    f'access names "{subject}", but nobody is asked for a password; give login.users_file'
                )
            if subject.startswith("certificate:") and not certificates:
                raise ValueError(
                    f'access names "{subject}", but nobody is asked for a certificate; set '
                    "tls.client_certificates"
                )
        if self.connect and not any(s.startswith("certificate:") for s in self.access.service):
            raise ValueError(
                "access would shut out the router at connect; name its certificate under access.service"
            )
        return self


class Client(Section):
    """How a command shows who it is: the file given with `--client`."""

    tls: Tls | None = None  #: `[tls]` with `ca`, `certificate` and `key`, as in `[publish.tls]`
    login: Login | None = None  #: `[login]` with `user` and `password_file`, as in `[publish.login]`

    @model_validator(mode="after")
    def _nothing_of_a_server(self) -> Client:
        serves = self.login is not None and self.login.users_file is not None
        if serves or (self.tls is not None and self.tls.client_certificates):
            raise ValueError("users_file and client_certificates are for the service; remove them")
        return self


STATE_DIRECTORY = "STATE_DIRECTORY"
"""Where systemd says that a unit may keep its state; several places are parted by colons."""


class RecordSettings(Section):
    """Where the lossless log of the daemon goes."""

    directory: File | None = None  #: where the recordings go; without it nothing is recorded
    rotate_MB: Positive = 64.0  #: a new file begins at this size
    sync_s: Positive = 5.0  #: the file is forced to disk this often
    keep_days: Positive | None = None  #: older files are removed; – is no limit
    keep_GB: Positive | None = None  #: largest total size; – is no limit
    keep_free_GB: NonNegative = 1.0  #: space that stays free, at most a tenth of the disk; 0 is no limit


class Checkpoint(Section):
    """Where the service saves its state, so that a restart continues from it."""

    enabled: bool = True  #: whether the state is saved
    #: its folder; – is the recordings' directory, else systemd's `$STATE_DIRECTORY`, else it is off
    directory: File | None = None
    period_s: Annotated[float, Field(ge=0.1, le=3600)] = 10.0  #: how often; once more at the end
    oldest_s: Annotated[float, Field(gt=0, le=86_400)] = 900.0  #: an older one is ignored at the start

    def place(self, record: RecordSettings) -> Path | None:
        """Return the folder in force: as configured, else that of the recordings, else systemd's.

        Args:
            record: The table `[record]`.

        Returns:
            The folder. None where saving is off, or none of the three is set.
        """
        if not self.enabled:
            return None
        if self.directory is not None or record.directory is not None:
            return self.directory or record.directory
        state_folder = os.environ.get(STATE_DIRECTORY, "").split(":")[0]
        return Path(state_folder) if state_folder else None


AlarmKind = Literal[
    "sensor_fault", "sensor_stuck", "sensor_disagrees", "heat_high", "heat_low", "heat_off_law",
    "model_inconsistent", "wire", "disk", "compensation", "clock", "estimate",
]  # fmt: skip


class AlarmSettings(Section):
    """Which alarms there are, and when a heat is more than usual."""

    enabled: Flag = True  #: whether alarms are raised
    #: hours of running to learn the usual heats, 1 to 1000
    learn_h: Annotated[Number, Field(ge=1.0, le=1000.0)] = 30.0
    #: relative deviation of a heat that raises an alarm, 0.05 to 3
    deadband: Annotated[Number, Field(ge=0.05, le=3.0)] = 0.25
    #: change of a sensor's learnt offset that raises an alarm, 0.05 to 20
    sensor_K: Annotated[Number, Field(ge=0.05, le=20.0)] = 0.5
    off: tuple[AlarmKind, ...] = ()  #: kinds that are not raised, such as `["sensor_disagrees"]`
