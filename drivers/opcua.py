"""An OPC UA server, as found in controls and gateways: the values of named nodes, read each period.

Only the Read service is ever called. A value counts only if its status is plain Good; everything
else, including a value at its sensor's limit or an overridden one, is a fault named after the status.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, model_validator

from drivers.places import OpcUaChannel, check_channels
from drivers.polled import PolledTable
from drivers.protocol import ChannelName, PollPeriod, Text, Timeout
from observer.config.quantities import File, all_or_none


class OpcUaSettings(PolledTable):
    """An OPC UA server; certificate and key, user and password file belong together."""

    session = "drivers.opcua_session"

    kind: Literal["opcua"]
    url: Annotated[Text, Field(pattern=r"^opc\.tcp://[^/@\s]+(/\S*)?$")]
    period_s: PollPeriod = 0.1
    timeout_s: Timeout = 1.0
    policy: Literal["Basic256Sha256", "Aes128Sha256RsaOaep", "Aes256Sha256RsaPss"] = "Basic256Sha256"
    certificate: File | None = None
    private_key: File | None = None
    server_certificate: File | None = None
    user: Text | None = None
    password_file: File | None = None
    channels: dict[ChannelName, OpcUaChannel] = Field(min_length=1)

    _files = all_or_none("certificate", "private_key", "server_certificate")
    _login = all_or_none("user", "password_file")

    @model_validator(mode="after")
    def _sensible(self) -> OpcUaSettings:
        if self.user is not None and self.certificate is None:
            raise ValueError("a password is never sent in the clear; give certificate and private_key too")
        check_channels(self.channels)
        return self

    @property
    def files(self) -> dict[str, Path]:
        """The files that the table names, by key.

        Keys without a file are missing.
        """
        keys = ("certificate", "private_key", "server_certificate", "password_file")
        return {key: file for key in keys if (file := getattr(self, key)) is not None}

    def file_problems(self, _name: str) -> list[str]:
        """Return a sentence for each named file that does not exist.

        Each begins with the key. The content of the files is read only when the driver connects.
        """
        return [
            f"{key}: {file} is not a file; fix the path"
            for key, file in self.files.items()
            if not os.path.isfile(file)  # one in a folder that this user may not read counts as missing too
        ]
