"""Which extra of the installation brings a package that a command did not find."""

from __future__ import annotations

EXTRAS = {
    "analysis": ("control", "filterpy", "matplotlib", "pyarrow"),
    "page": ("starlette", "uvicorn"),
    "plant": ("prometheus_client", "paho", "asyncua", "httpx", "defusedxml"),
    "fleet": ("distributed",),
}
"""What can be imported with each extra of `pyproject.toml`; the daemon needs none of them."""


def remedy(command: str, error: ModuleNotFoundError) -> str | None:
    """A sentence on how to install what is missing; None where it is of no extra, so a defect."""
    missing = (error.name or "").partition(".")[0]
    for extra, modules in EXTRAS.items():
        if missing in modules:
            return (
                f"{command} needs the packages of {extra} ({missing} is missing): "
                f'pip install "ballscrew-observer[{extra}]"'
            )
    return None
