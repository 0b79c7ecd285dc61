"""A process for the past, as the service starts it: for one query, or to tend the files of an axis.

Its memory is released when it ends, and it shares nothing with the loop.
"""

from __future__ import annotations

import json
import os
import sys
import time
from contextlib import suppress
from pathlib import Path

from observer.errors import UserError

_GIVES_WAY = 10


def main() -> None:
    """Answer the query on the standard input, or `tend` the files of an axis."""
    with suppress(AttributeError, OSError):
        os.nice(_GIVES_WAY)
    command, folder, name, *_ = sys.argv[1:]
    if command == "tend":
        from observer.service.past_tending import tend  # noqa: PLC0415 - a query does not wait for the mathematics

        tend(Path(folder), name)
        return
    from observer.record.pages import Pages, Span  # noqa: PLC0415
    from observer.record.step_store import Past  # noqa: PLC0415

    question = json.load(sys.stdin)
    pages = Pages(Past(Path(folder), name), question["in_force"], question["gap_s"])
    try:
        span = Span.of(question["asked"], time.time())
        page = pages.estimates(span) if question["key"] == "estimate" else pages.readings(span)
    except UserError as error:
        sys.stderr.write(str(error))
        sys.exit(2)
    sys.stdout.buffer.write(page)


main()
