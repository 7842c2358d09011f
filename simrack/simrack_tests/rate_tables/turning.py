"""What is sent to each simulated table so that it turns at 50 deg/s, counter-clockwise; golden bytes, no driver's."""

from __future__ import annotations

from simrack.rate_tables.mn_as import character_sum

RATE = 50.0


def dd16(axis: int, function: int, data: bytes = b"") -> bytes:
    body = bytes([0xDD, axis, function]) + data.ljust(12, b"\0")
    return body + bytes([-sum(body) % 256])


def mn(text: str) -> bytes:
    return f"${text}*{character_sum(text)}\r\n".encode()


def aaaa(control: int, position: int = 0, speed: int = 0) -> bytes:
    slot = bytes([control]) + position.to_bytes(3, "little") + speed.to_bytes(2, "little")
    body = b"\xaa\xaa" + slot + bytes(12)
    return body + bytes([sum(body) % 256])


LOAD = (5_000_000).to_bytes(4, "little") + (10_000_000).to_bytes(4, "little")
START: dict[str, list[bytes]] = {
    "acl": [b":MODE:RATE 1\n", b":INT:CLOSE 1\n", b":DEM:RATE 1,50\n"],
    "zaber": [b"/1 1 driver enable\n", b"/1 1 move vel 145635\n"],
    "atl": [b"ACL100\r", b"JOG50\r"],
    "esp": [b"1MO\r", b"1VA50;1MV+\r"],
    "dd16": [dd16(0, 0x55), dd16(1, 3), dd16(1, 5), dd16(1, 0x0C, LOAD), dd16(1, 0x10, b"\x02")],
    "mn_as": [mn(text) for text in ("MNREM,1", "MNENB,1", "MNMOD,1,0,0", "MNVEL,50,0,0", "MNRUN,1")],
    "ruya": [b"$1mo=1\r\n", b"$13101000050.0000\r\n"],
    "aaaa": [aaaa(0xAB), aaaa(0x81, 8_000_000, 5000)],
}
"""How each table is set turning at 50 deg/s, counter-clockwise."""

CONNECT = dd16(0, 0x55)
POLL: dict[str, bytes] = {
    "acl": b":Mode? 1\r",
    "zaber": b"/1 1 get pos\n",
    "atl": b"PPO\r",
    "esp": b"1TP\r",
    "dd16": CONNECT,
    "mn_as": mn("MNSTS,1"),
    "ruya": b"",
    "aaaa": b"",
}
"""What each table answers whatever its state; two say their status unasked."""
