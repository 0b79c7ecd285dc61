"""What a user may have to know of the network, of all that stands in this environment."""

from __future__ import annotations

import os

_TOLD = (
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
    """The variables that tell how the network is reached; everything else stays outside."""
    return {name: value for name, value in os.environ.items() if name.startswith(_TOLD)}
