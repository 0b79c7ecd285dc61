"""The configuration of the page that people look at, off until its table is there."""

from __future__ import annotations

import ipaddress
import re
from typing import Annotated

from pydantic import AfterValidator, Field, model_validator

from observer.tables.quantities import File, Section

_ADDRESS = re.compile(r"(?P<host>[A-Za-z0-9_.-]+|\[[0-9A-Fa-f:.]+\]):(?P<port>\d{1,5})")
_MOST_PORT = 65_535


def host_and_port(address: str) -> tuple[str, int]:
    """The host, without brackets, and the port of an address; raises `ValueError` where it is none."""
    found = _ADDRESS.fullmatch(address)
    if not found or not 1 <= int(found["port"]) <= _MOST_PORT:
        raise ValueError(f"{address[:60]!r} is no address; write host:port, like 127.0.0.1:8080")
    return found["host"].strip("[]"), int(found["port"])


def is_loopback(address: str) -> bool:
    """Whether only this computer can reach an address."""
    host, _ = host_and_port(address)
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _checked(address: str) -> str:
    host_and_port(address)
    return address


Address = Annotated[str, Field(max_length=300), AfterValidator(_checked)]


class Page(Section):
    """The page for people: where it listens, and the names and passwords of those who may look."""

    listen: Address = "127.0.0.1:8080"
    users_file: File | None = None
    certificate: File | None = None
    key: File | None = None
    reports: File | None = None

    @model_validator(mode="after")
    def _others_log_in(self) -> Page:
        if (self.certificate is None) != (self.key is None):
            raise ValueError("certificate and key go together; give both or neither")
        if not is_loopback(self.listen) and self.users_file is None:
            raise ValueError(
                f"others reach {self.listen}, so they have to log in; name a file of user:password lines in "
                "users_file, or listen on 127.0.0.1"
            )
        return self
