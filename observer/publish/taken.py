"""Whether another program listens where the service is to."""

from __future__ import annotations

import errno
import re
import socket
from collections.abc import Iterable

from observer.errors import ConfigError

_TCP = re.compile(r"tcp/\[?(?P<host>[^\]/?#]+?)\]?:(?P<port>\d+)([?#].*)?")


def refuse_taken(endpoints: Iterable[str], place: str) -> None:
    """Raise `ConfigError` where another program listens on a TCP endpoint already; `place` is named."""
    for endpoint in endpoints:
        if (tcp := _TCP.fullmatch(endpoint)) and _is_taken(tcp["host"], int(tcp["port"])):
            raise ConfigError(
                f"{place}: another program listens on {endpoint}; stop it or choose another port"
            )


def _is_taken(host: str, port: int) -> bool:
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except (OSError, OverflowError) as error:  # an address that is not there yet is waited for
        return isinstance(error, OSError) and error.errno == errno.EADDRINUSE
    return False
