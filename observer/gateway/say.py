"""How an outlet tells the service how it fares."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

Say = Callable[[dict[str, Any]], None]
"""Takes a `reason`, None with an `address` once the outlet serves."""
