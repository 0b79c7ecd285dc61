"""Who answers at an endpoint where the axis that was asked for does not."""

from __future__ import annotations

import zenoh

from observer.exchange import plain_name

_QUERY_S = 1.0
_MOST = 8


def absent(session: zenoh.Session, connect: str, machine: str, axis: str) -> str | None:
    """Say which axes live there instead; None where that one does, or none at all.

    `machine` and `axis` may be `*`. Raises `zenoh.ZError` without a session.
    """
    wanted = zenoh.KeyExpr(f"ballscrew/{machine}/{axis}/alive")
    found = set()
    for reply in session.liveliness().get("ballscrew/*/*/alive", timeout=_QUERY_S):
        if reply.ok is None:
            continue
        if wanted.intersects(reply.ok.key_expr):
            return None
        found.add("/".join(plain_name(part) for part in str(reply.ok.key_expr).split("/")[1:3]))
    return _sentence(sorted(found), connect, f"{machine}/{axis}") if found else None


def _sentence(found: list[str], connect: str, wanted: str) -> str:
    """The axes that live, the first of them by their names, and how to ask for one."""
    if len(found) == 1:
        return f"at {connect} answers {found[0]}, not {wanted}; name it with --machine and --axis"
    more = f" and {len(found) - _MOST} more" if len(found) > _MOST else ""
    names = ", ".join(found[:_MOST]) + more
    return f"at {connect} answer {names}, not {wanted}; name one with --machine and --axis"
