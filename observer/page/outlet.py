"""The page as an outlet of the gateway: served until cancelled; it reports its state to the service."""

from __future__ import annotations

from observer.files.regular import read_users
from observer.gateway.messages import Latest
from observer.gateway.server import served
from observer.gateway.start import ReportState, Start, run_together, tell_service
from observer.page.app import application
from observer.page.guard import Logins
from observer.page.stream import Stream


async def serve(start: Start, latest: Latest, report_state: ReportState) -> None:
    """Serve the page until cancelled; raises `OSError` or `ConfigError` with one sentence if it cannot."""
    assert start.page is not None
    page = start.page
    secure = page.certificate is not None
    users = read_users(page.users_file, "page.users_file") if page.users_file is not None else None
    login = None if users is None else Logins(users, secure=secure)
    stream = Stream(latest, start, login is not None)
    app = application(start, stream, login, acknowledge)
    async with served(app, "page", page.listen, page.certificate, page.key) as serving:
        report_state({"reason": None, "address": f"http{'s' * secure}://{page.listen}/", "doubt": page.doubt})
        try:
            await run_together(serving, stream.run())
        finally:
            stream.end()


def acknowledge(alarm: str, by: str) -> None:
    """Report to the service that somebody has acknowledged an alarm, by its `id`."""
    tell_service({"acknowledge": alarm, "by": by})
