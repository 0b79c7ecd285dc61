"""The environment variables that a user may need to reach the network."""

from __future__ import annotations

import os

_PREFIXES = (
    "PIP_",
    "UV_",
    "HTTP_PROXY",
    "HTTPS_PROXY",
    "NO_PROXY",
    "http_proxy",
    "https_proxy",
    "no_proxy",
    "SSL_CERT_FILE",
)


def of_network() -> dict[str, str]:
    """The variables that configure network access; nothing else is passed on."""
    return {name: value for name, value in os.environ.items() if name.startswith(_PREFIXES)}
