"""Zenoh endpoints as users write them: `tcp/127.0.0.1:7447`."""

from __future__ import annotations

import re

_ENDPOINT = re.compile(r"[a-z][a-z0-9_-]*/[^\s]+")


def checked_endpoint(text: str) -> str:
    """Return an endpoint as it is; raises `ValueError` where it is none."""
    if not _ENDPOINT.fullmatch(text):
        raise ValueError(f"{text!r} is no Zenoh endpoint; write it like tcp/127.0.0.1:7447")
    return text
