"""The port mapper, version 2 (RFC 1833), over TCP and UDP: where clients of VXI-11 find its programs."""

from __future__ import annotations

import socket
import struct
from collections.abc import Mapping

from simrack.serve.loop import Loop
from simrack.serve.rpc import Call, RpcConnection, RpcDatagrams
from simrack.serve.wire import Listener

PORT_MAPPER = 100000
_TCP, _UDP = 6, 17
_MAPPING = struct.Struct(">4I")
_WORD = struct.Struct(">I")


class PortMapper:
    """Answers clients with the ports of programs, which are on TCP; itself on UDP too.

    `rpcinfo -p` asks for all by DUMP. libtirpc asks by GETPORT over UDP before it connects.
    """

    def __init__(self, loop: Loop, address: tuple[str, int], ports: Mapping[int, int]) -> None:
        self._loop = loop
        self._listener = Listener(loop, address, self._accept)
        self.port = self._listener.port
        self._mappings = [(program, 1, _TCP, port) for program, port in ports.items()]
        self._mappings += [(PORT_MAPPER, 2, protocol, self.port) for protocol in (_TCP, _UDP)]
        self._programs = {(PORT_MAPPER, 2): {3: self._port_of, 4: self._dump}}
        self._datagrams = RpcDatagrams(loop, (address[0], self.port), self._programs)
        self._connections: set[RpcConnection] = set()

    def close(self) -> None:
        """Stop listening and end the connections."""
        self._datagrams.close()
        self._listener.close()
        for connection in self._connections:
            connection.close()

    def _accept(self, connection: socket.socket) -> None:
        self._connections = {each for each in self._connections if not each.closed}
        served = RpcConnection(self._loop, connection)
        self._connections.add(served)
        served.programs = self._programs

    def _port_of(self, call: Call) -> bytes:
        """GETPORT: 0 for a program that is not there, or not on that protocol; its version does not count."""
        program, _version, protocol, _port = call.arguments.words(_MAPPING)
        known = (port for name, _, over, port in self._mappings if (name, over) == (program, protocol))
        return _WORD.pack(next(known, 0))

    def _dump(self, _call: Call) -> bytes:
        """DUMP: all mappings, as an XDR list."""
        return b"".join(_WORD.pack(1) + _MAPPING.pack(*each) for each in self._mappings) + _WORD.pack(0)
