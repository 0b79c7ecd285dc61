"""Heats as lines of InfluxDB's protocol by UDP, which Telegraf's `socket_listener` receives."""

from __future__ import annotations

import asyncio
import json

from observer.config.outlets import NewestMessages, OutletTable, ReportState


class InfluxLines(OutletTable):
    """Where the lines go."""

    host: str = "127.0.0.1"
    port: int = 8094

    async def serve(self, prefix: str, latest: NewestMessages, report_state: ReportState) -> None:
        """Send a line for each source at each step."""
        loop, address = asyncio.get_running_loop(), (self.host, self.port)
        socket, _ = await loop.create_datagram_endpoint(asyncio.DatagramProtocol, remote_addr=address)
        report_state({"reason": None, "address": f"udp {self.host}:{self.port}"})
        try:
            async for key, payload in latest.messages():
                if key == "heat" and payload:
                    heat = json.loads(payload)
                    for name, source in heat["sources"].items():
                        tags = f"axis={prefix},source={name},quality={heat['quality']}"
                        line = f"heat,{tags} heat_W={source['heat_W']} {round(heat['time_s'] * 1e9)}"
                        socket.sendto(line.encode())
        finally:
            socket.close()
