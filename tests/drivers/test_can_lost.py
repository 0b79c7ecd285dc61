"""A CAN bus that ends, falls silent or reports errors is never shown as connected, and is opened again."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
import time
from contextlib import contextmanager

import can
import pytest

from observer.quality.kinds import Condition, ConditionKind
from tests.drivers.harness import running
from tests.drivers.test_can import Adapter, frame, settings, virtual_bus
from tests.patience import eventually


class SocketcandServer:
    """A socketcand server of one client at a time, on loopback."""

    def __init__(self, greeting=b"< hi >"):
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.port = self._listener.getsockname()[1]
        self.calls = 0
        self._greeting = greeting
        self._clients = []
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self):
        with contextlib.suppress(OSError):  # of a server that was closed
            while True:
                client, _ = self._listener.accept()
                self._clients.append(client)
                client.sendall(self._greeting)
                if client.recv(100) == b"< open can0 >":
                    client.sendall(b"< ok >")
                    client.recv(100)
                    client.sendall(b"< ok >")
                self.calls += 1

    def send(self, text):
        self._clients[-1].sendall(text.encode())

    def hang_up(self):
        self._clients[-1].shutdown(socket.SHUT_RDWR)

    def close(self):
        self._listener.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        for end in (self._listener, *self._clients):
            end.close()


@contextmanager
def served(**options):
    server = SocketcandServer(**options)
    try:
        yield server
    finally:
        server.close()


def client_of(server, **more):
    return settings(
        interface="socketcand", channel="can0", options={"host": "127.0.0.1", "port": server.port}, **more
    ).open("axis")


def line_of(message, kind="frame"):
    return f"< {kind} {message.arbitration_id:03X} {time.time():.6f} {message.data.hex().upper()} >"


async def test_a_socketcand_server_that_closes_is_disconnected_and_found_again():
    with served() as server:
        driver = client_of(server)
        async with running(driver) as axis:
            await axis.until(lambda _: driver.status.connected)
            text = line_of(frame(0.25))
            server.send(text[:20])
            await asyncio.sleep(0)
            server.send(text[20:])
            assert await axis.good("nut_position_m") == pytest.approx(0.25)
            server.hang_up()
            await axis.until(lambda r: r.faults.get("nut_position_m") == "disconnected")
            await axis.until(lambda _: server.calls == 2 and driver.status.connected)
            server.send(line_of(frame(0.5)))
            assert await axis.good("nut_position_m") == pytest.approx(0.5)
            assert driver.status.reconnects == 1


async def test_a_socketcand_server_that_went_away_is_called_with_growing_pauses(monkeypatch):
    pauses_s = []
    monkeypatch.setattr("drivers.can_bus.RETRY_S", 0.01)
    real_wait = threading.Event.wait
    monkeypatch.setattr(
        threading.Event, "wait", lambda event, s=None: pauses_s.append(s) or real_wait(event, s)
    )
    with served() as server:
        port_of_nobody = client_of(server)
    async with running(port_of_nobody) as axis:
        await axis.until(lambda _: port_of_nobody.status.errors >= 4)
        assert await axis.fault("nut_position_m") == "disconnected"
    grown = [s for s in pauses_s if s in (0.02, 0.04, 0.08, 0.16)]
    assert grown[:4] == [0.02, 0.04, 0.08, 0.16]


async def test_a_server_of_another_kind_is_named():
    with served(greeting=b"220 mail.example ready>") as server:
        driver = client_of(server)
        async with running(driver) as axis:
            await axis.until(lambda _: driver.status.errors >= 1)
            assert 'instead of "hi"' in driver.status.last_error
            assert not driver.status.connected


@pytest.mark.parametrize("ending", ["nothing at once", "an unknown error", "a closed file"])
async def test_an_interface_that_ends_in_any_way_is_opened_again(monkeypatch, ending):
    """What python-can's interfaces do once their device has gone: return, or raise, without a pause."""
    opened = []

    class Ending(can.BusABC):
        def __init__(self, channel, **options):
            super().__init__(channel, **options)
            opened.append(channel)

        def _recv_internal(self, timeout):
            if ending == "nothing at once":
                return None, False
            raise RuntimeError("gone") if ending == "an unknown error" else ValueError("I/O on a closed file")

        def send(self, msg, timeout=None):
            raise NotImplementedError

    monkeypatch.setattr(can, "Bus", lambda channel, interface, **options: Ending(channel, **options))
    driver = settings().open("axis")
    async with running(driver) as axis:
        await axis.until(lambda _: len(opened) >= 3)
        await axis.until(lambda r: r.faults.get("nut_position_m") == "disconnected")
        assert driver.status.last_error


async def test_an_adapter_that_was_reset_is_silent_and_opened_again(tmp_path):
    path = tmp_path / "ttyACM0"
    adapter = Adapter(path)
    driver = settings(interface="slcan", channel=str(path), bitrate=500_000, reopen_s=0.5).open("axis")
    async with running(driver) as axis:
        await axis.until(lambda _: driver.status.connected)
        adapter.send(frame(0.125))
        await axis.good("nut_position_m")
        adapter.received()
        await axis.until(lambda _: driver.status.state == "silent")
        assert await axis.fault("nut_position_m") == "silent"
        opened = bytearray()
        await eventually(lambda: opened.extend(received(adapter)) or b"L\r" in opened)
        assert b"S6\r" in opened
        assert not driver.status.connected
        adapter.send(frame(0.25))
        assert await axis.good("nut_position_m") == pytest.approx(0.25)
        assert driver.status.state == "connected"
        assert driver.status.reconnects == 1
    adapter.unplug()


def received(adapter):
    try:
        return adapter.received()
    except BlockingIOError:
        return b""


async def test_a_silent_udp_bus_is_not_connected():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    driver = settings(
        interface="udp_multicast",
        channel="239.74.163.2",
        options={"port": port, "hop_limit": 0},
        reopen_s=0.5,
    ).open("axis")
    async with running(driver) as axis:
        await axis.until(lambda _: driver.status.state == "silent")
        assert "no frame has come for 0.5 s; check power" in driver.status.last_error
        told = Condition(ConditionKind.SILENT, "axis", driver.status.last_error).sentence
        assert "bit rate" in told


@pytest.mark.parametrize(
    ("identifier", "data", "counted", "error"),
    [
        (0x08, b"\0\0\x80\0\0\0\0\0", (1, 0, 0), "error frames"),
        (0x04, b"\0\x10\0\0\0\0\0\0", (1, 1, 0), "error-passive"),
        (0x04, b"\0\x20\0\0\0\0\0\0", (1, 1, 0), "error-passive"),
        (0x40, b"", (1, 0, 1), "bus-off"),
        (0x04, b"\0\x40\0\0\0\0\0\0", (1, 0, 0), None),
    ],
)
async def test_error_frames_are_counted_by_what_they_report(identifier, data, counted, error):
    with virtual_bus() as bus:
        driver = settings().open("axis")
        async with running(driver) as axis:
            await axis.until(lambda _: driver.status.connected)
            bus.send(can.Message(arbitration_id=identifier, data=data, is_error_frame=True))
            await axis.until(lambda _: driver.status.error_frames)
            status = driver.status
            assert (status.error_frames, status.error_passive, status.bus_off) == counted
            assert status.bus_error == error


async def test_a_bus_is_sound_again_some_time_after_its_last_error(monkeypatch):
    monkeypatch.setattr("drivers.can_bus.ERROR_S", 0.1)
    with virtual_bus() as bus:
        driver = settings().open("axis")
        async with running(driver) as axis:
            await axis.until(lambda _: driver.status.connected)
            bus.send(can.Message(arbitration_id=0x40, is_error_frame=True))
            await axis.until(lambda _: driver.status.bus_error == "bus-off")
            await eventually(lambda: bus.send(frame()) or driver.status.bus_error is None)
            assert driver.status.bus_off == 1


async def test_errors_of_a_socketcand_server_are_counted():
    with served() as server:
        driver = client_of(server)
        async with running(driver) as axis:
            await axis.until(lambda _: driver.status.connected)
            server.send(line_of(can.Message(arbitration_id=0x40, is_error_frame=True), "error"))
            await axis.until(lambda _: driver.status.bus_off == 1)


def test_the_sentence_of_bus_errors_names_every_candidate():
    told = Condition(ConditionKind.BUS, "axis", "error frames", value=12).sentence
    for words in ("12 error frames", "bit rate", "terminator", "wire", "acknowledges"):
        assert words in told
