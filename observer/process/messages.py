"""The daemon's own messages: structlog to standard error, as text or one JSON object per line."""

from __future__ import annotations

import sys

import structlog

from observer.process.terminal import readable_json


def configure(*, as_json: bool) -> None:
    """Set structlog up once, before anything is logged."""
    renderer: structlog.typing.Processor = (
        structlog.processors.JSONRenderer(serializer=readable_json)
        if as_json
        else structlog.dev.ConsoleRenderer(colors=sys.stderr.isatty())
    )
    exceptions = [structlog.processors.dict_tracebacks] if as_json else []
    structlog.configure(
        processors=[
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="iso", utc=True),
            *exceptions,
            renderer,
        ],
        logger_factory=structlog.PrintLoggerFactory(sys.stderr),
        cache_logger_on_first_use=True,
    )
