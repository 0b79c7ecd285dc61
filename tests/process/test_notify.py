"""A service manager that reads nothing holds nobody up."""

import socket
import threading
import uuid

from observer.process.notify import service_manager
from tests.patience import PATIENCE_S


def test_a_manager_that_reads_nothing_is_not_waited_for(monkeypatch):
    name = f"observer-test-{uuid.uuid4().hex}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(f"\0{name}")
        monkeypatch.setenv("NOTIFY_SOCKET", f"@{name}")
        notify = service_manager()
        notify("READY=1")

        def pings() -> None:
            for _ in range(40):  # more than the socket holds
                notify("WATCHDOG=1")

        thread = threading.Thread(target=pings, daemon=True)
        thread.start()
        thread.join(PATIENCE_S)
        assert not thread.is_alive()
        assert manager.recv(64) == b"READY=1"
        notify.__self__.socket.close()
