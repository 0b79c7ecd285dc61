"""Who may do what, in the words of Zenoh's own access control: nothing, but what a role allows.

Rules judge the key expression as it was asked, by inclusion: `ballscrew/**` lies within none of the patterns
that may be queried, so a wildcard that would reach the commands does not get through for anybody.
"""

from __future__ import annotations

from typing import Any

from observer.tables.publishing import Access

_EVERYTHING = "ballscrew/**"
_ANSWERS = ("ballscrew/*/*/*", "ballscrew/*/*/truth/*")
_COMMANDS = "ballscrew/*/*/command/*"
_ROLES = {
    "viewer": ("hear", "be told", "ask"),
    "operator": ("hear", "be told", "ask", "command"),
    "service": ("hear", "be told", "ask", "command", "serve", "be asked"),
}


def _rule(name: str, flow: str, messages: tuple[str, ...], *keys: str) -> dict[str, Any]:
    return {"id": name, "permission": "allow", "flows": [flow], "messages": messages, "key_exprs": keys}


_RULES = (
    _rule(
        "hear", "ingress",
        ("declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"), _EVERYTHING,
    ),
    _rule(
        "be told", "egress",
        ("put", "delete", "reply", "liveliness_token", "declare_queryable"), _EVERYTHING,
    ),
    _rule("ask", "ingress", ("query",), *_ANSWERS),
    _rule("command", "ingress", ("query",), _COMMANDS),
    _rule(
        "serve", "ingress",
        ("put", "delete", "reply", "liveliness_token", "declare_queryable"), _EVERYTHING,
    ),
    _rule(
        "be asked", "egress",
        ("query", "declare_subscriber", "declare_liveliness_subscriber", "liveliness_query"), _EVERYTHING,
    ),
)  # fmt: skip


def access_control(access: Access) -> dict[str, Any]:
    """Zenoh's `access_control` for a table of roles; whoever is not in it may do nothing."""
    named = {role: subjects for role in _ROLES if (subjects := getattr(access, role))}
    used = {rule for role in named for rule in _ROLES[role]}
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [rule for rule in _RULES if rule["id"] in used],
        "subjects": [
            {"id": f"{role} {subject}", **_subject(subject)}
            for role, subjects in named.items()
            for subject in subjects
        ],
        "policies": [
            {"rules": _ROLES[role], "subjects": [f"{role} {subject}" for subject in subjects]}
            for role, subjects in named.items()
        ],
    }


def _subject(subject: str) -> dict[str, list[str]]:
    kind, name = subject.split(":", 1)
    return {"usernames" if kind == "user" else "cert_common_names": [name]}
