"""Identification of an LXI device over HTTP, ``GET /lxi/identification`` (LXI Device Specification 1.5, rule 10.2).

A box has it on port 80 of its own address; here each instrument has a port. *Unverified*: which LXI version each model
states, and whether a 33220A or a DSO7104B, which are older than that rule, have the page. Not simulated: the pages for
people, and the XSD, which a box has on itself too (rule 10.2.3).
"""

from __future__ import annotations

import socket
from xml.sax.saxutils import escape

from simrack.serve.instrument import ServedInstrument
from simrack.serve.loop import Loop
from simrack.serve.wire import Connection, Listener

PATH = "/lxi/identification"
_LONGEST_REQUEST = 1 << 13
_NAMESPACE = "http://www.lxistandard.org/InstrumentIdentification/1.0"
_XML = f"""<?xml version="1.0" encoding="UTF-8"?>
<LXIDevice xmlns="{_NAMESPACE}" xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance"
 xsi:schemaLocation="{_NAMESPACE} https://public.lxistandard.org/schemas/InstrumentIdentification/1.0.xsd">
<Manufacturer>{{0}}</Manufacturer><Model>{{1}}</Model>
<SerialNumber>{{2}}</SerialNumber><FirmwareRevision>{{3}}</FirmwareRevision>
<IdentificationURL>{{url}}</IdentificationURL>
<Interface xsi:type="NetworkInformation" InterfaceType="LXI" IPType="{{family}}">{{addresses}}
<Hostname>{{host}}</Hostname><IPAddress>{{host}}</IPAddress><SubnetMask>255.255.255.255</SubnetMask>
<MACAddress>00:00:00:00:00:00</MACAddress><Gateway>0.0.0.0</Gateway>
<DHCPEnabled>false</DHCPEnabled><AutoIPEnabled>false</AutoIPEnabled></Interface>
<LXIVersion>1.4 LXI Core 2011</LXIVersion>
</LXIDevice>
"""


class LxiServer:
    """Identifies an instrument; `host` is its address for clients, `resources` where else it answers."""

    def __init__(
        self, loop: Loop, address: tuple[str, int], instrument: ServedInstrument, host: str, resources: list[str]
    ) -> None:
        self.connections: set[_Request] = set()
        self.listener = Listener(loop, address, lambda connection: self.connections.add(_Request(self, connection)))
        self.loop, self._instrument, self._host = loop, instrument, host
        self._addresses = [escape(each) for each in resources if each.startswith("TCPIP")]
        self.url = f"http://{host}:{self.listener.port}{PATH}"

    def close(self) -> None:
        """Stop listening and end the connections."""
        self.listener.close()
        for connection in tuple(self.connections):
            connection.close()

    def identification(self) -> bytes:
        """Return the document with the present reply to *IDN?."""
        engine = self._instrument.engine
        words = (["", "", "", ""] if engine is None else engine.model.identity().split(","))[:4]
        family, host = ("IPv6", self._host.strip("[]")) if ":" in self._host else ("IPv4", self._host)
        listed = "".join(f"<InstrumentAddressString>{each}</InstrumentAddressString>" for each in self._addresses)
        return _XML.format(*map(escape, words), url=self.url, family=family, host=host, addresses=listed).encode()


class _Request(Connection):
    """A connection, which is for one request."""

    def __init__(self, server: LxiServer, connection: socket.socket) -> None:
        self._server = server
        self._input = b""
        super().__init__(server.loop, connection)

    def received(self, data: bytes) -> None:
        """Answer a whole request."""
        self._input += data
        whole = b"\r\n\r\n" in self._input
        if whole:
            method, path, *_ = (*self._input.partition(b"\r\n")[0].decode("latin-1").split(), "", "")
            found = path.lower().rstrip("/") == PATH
            body = self._server.identification() if found else b""
            status, more = "200 OK" if found else "404 Not Found", f"Content-Length: {len(body)}\r\nConnection: close"
            self.send(f"HTTP/1.1 {status}\r\nContent-Type: text/xml\r\n{more}\r\n\r\n".encode())
            self.send(b"" if method == "HEAD" else body)
        if whole or len(self._input) > _LONGEST_REQUEST:
            self.close()

    def gone(self) -> None:
        """Be forgotten."""
        self._server.connections.discard(self)
