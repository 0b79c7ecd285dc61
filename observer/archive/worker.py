"""The archive's process: queries in, answers out, one at a time and with low priority.

It ends when there are no more queries, so its memory is released, and it shares nothing with the loop:
neither the interpreter's lock nor memory.
"""

from __future__ import annotations

import json
import os
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import structlog

from observer.archive.client import FOUND, REFUSED, UNFINISHED
from observer.archive.pages import Pages, Span
from observer.archive.series import series
from observer.archive.store import Archive, UnfinishedError
from observer.errors import UserError
from observer.installation import parse
from observer.process.messages import configure
from observer.process.pipes import framed, messages

_GIVES_WAY = 10

log = structlog.get_logger()


def main() -> None:
    """Answer until the standard input closes; the first message is the document `config`, with a folder."""
    with suppress(AttributeError, OSError):
        os.nice(_GIVES_WAY)
    configure(as_json=False)
    incoming = messages(sys.stdin.buffer.read)
    first = next(incoming, None)
    if first is None:
        return
    document = json.loads(first[1])
    config = parse(document["config"])
    if (folder := document.get("recordings")) is not None:
        config = config.model_copy(
            update={"record": config.record.model_copy(update={"directory": Path(folder)})}
        )
    archive = Archive(config, document["hash"])
    pages = Pages(archive)
    for what, question in incoming:
        try:
            key, payload = FOUND, _answer(archive, pages, what, json.loads(question))
        except UnfinishedError as error:
            key, payload = UNFINISHED, str(error).encode()
        except UserError as error:
            key, payload = REFUSED, str(error).encode()
        except Exception as error:  # whatever the question, the next one is answered
            log.error("a query of the past failed", query=what, exc_info=True)
            key, payload = (
                REFUSED,
                f"the query failed ({type(error).__name__}); ask for another span".encode(),
            )
        sys.stdout.buffer.write(framed(key, payload))
        sys.stdout.buffer.flush()


def _answer(archive: Archive, pages: Pages, what: str, asked: dict[str, Any]) -> bytes:
    if what == "estimate":
        return pages.estimates(Span.of(asked, time.time()))
    if what == "readings":
        return pages.readings(Span.of(asked, time.time()))
    span = Span(asked["from_s"], asked["to_s"], asked.get("every_s", 0.0))
    if what == "late":
        return pages.late(span, asked["keys"])
    return series(archive, asked["node"], span, asked["most"], backwards=asked["backwards"])
