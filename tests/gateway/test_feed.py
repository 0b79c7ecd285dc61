"""What the service hears of the gateway's process, to its end."""

from __future__ import annotations

import subprocess
import sys

from observer.gateway.feed import _line_of


def test_a_process_that_is_ended_while_it_is_listened_to_has_said_its_last():
    """Ctrl-C closes what a thread still reads from."""
    with subprocess.Popen([sys.executable, "-c", "print(1)"], stdout=subprocess.PIPE, bufsize=0) as child:
        assert _line_of(child.stdout).strip() == b"1"
        assert _line_of(child.stdout) == b""
    assert child.stdout.closed
    assert _line_of(child.stdout) == b""
