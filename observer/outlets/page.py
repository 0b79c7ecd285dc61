"""The page as an outlet: served until cancelled; it reports its state."""

from __future__ import annotations

import asyncio
from functools import partial

from observer.bus.answers import LONGEST_ID
from observer.bus.ask import Address, command
from observer.bus.exchange import plain_name
from observer.config.outlets import ReportState
from observer.files.regular import read_users
from observer.outlets.messages import Latest
from observer.outlets.page_app import application
from observer.outlets.page_guard import Logins
from observer.outlets.page_stream import Stream
from observer.outlets.server import served
from observer.outlets.start import Start, run_together

_ANSWER_S = 5.0


async def serve(start: Start, latest: Latest, report_state: ReportState) -> None:
    """Serve the page until cancelled; raises `OSError` or `ConfigError` with one sentence if it cannot."""
    assert start.page is not None
    page = start.page
    secure = page.certificate is not None
    users = read_users(page.users_file, "page.users_file") if page.users_file is not None else None
    login = None if users is None else Logins(users, secure=secure)
    stream = Stream(latest, start, login is not None)
    app = application(start, stream, login, partial(_acknowledge, start))
    async with served(app, "page", page.listen, page.certificate, page.key) as serving:
        report_state({"reason": None, "address": f"http{'s' * secure}://{page.listen}/", "doubt": page.doubt})
        try:
            await run_together(serving, stream.run())
        finally:
            stream.end()


async def _acknowledge(start: Start, alarm: str, by: str) -> str | None:
    """Acknowledge an alarm, by its `id`; returns why that was not possible, None where it was."""
    address = Address(start.connect, start.machine, start.axis, start.client)
    parameters = {"id": plain_name(alarm, LONGEST_ID)}
    reply = await asyncio.to_thread(
        command, "acknowledge", address, _ANSWER_S, parameters=parameters, by=f"{by}@page"
    )
    if reply.document is None:
        return reply.problem
    return None if reply.document.get("done") is True else str(reply.document.get("text"))
