"""Signatures of a station, Ed25519 (RFC 8032): the seal of the last line of a record, signed as a line of its own.

A seal vouches for all lines before it, so one signature vouches for the record as it ended. The library is
`cryptography` (extra ``sign``), imported where a key is named.
"""

import os
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from vcfbench.errors import ConfigError
from vcfbench.extras import need
from vcfbench.files import failing_as, read_file, shown

_SAID: Final = b"vcfbench seal "
_MOST: Final = 10_000
_WHAT: Final = "a signature"


class SigningKey:
    """A private key of a station.

    Raises:
        ConfigError: the file holds no Ed25519 key, or the extra ``sign`` is not installed.
    """

    def __init__(self, path: Path) -> None:
        serialization = need("cryptography.hazmat.primitives.serialization", "sign", _WHAT)
        data = read_file(path, "a private key in PEM", _MOST)
        try:
            self._key = serialization.load_pem_private_key(data, password=None)
        except (ValueError, TypeError) as error:
            raise ConfigError(f"{shown(path)}: expected a private key in PEM without password: {error}") from None
        if not isinstance(self._key, _ed25519().Ed25519PrivateKey):
            raise ConfigError(f"{shown(path)}: expected a key of Ed25519", hint="vcfbench runs new-key FILE makes one")
        if os.name == "posix" and (rights := stat.S_IMODE(path.stat().st_mode)) & 0o077:
            raise ConfigError(
                f"{shown(path)}: expected a private key that only its owner can read, got mode {rights:04o}",
                hint=f"chmod 600 {shown(path)}; if it was read, make a new one: vcfbench runs new-key FILE",
            )

    @property
    def public(self) -> str:
        """The public key, 32 bytes in hexadecimal."""
        return str(self._key.public_key().public_bytes_raw().hex())

    def signature(self, seal: str) -> dict[str, str]:
        """Return the fields of a line that signs the seal of the line before."""
        return {"key": self.public, "signature": self._key.sign(_SAID + seal.encode()).hex()}


def named_key(bench_file: str | None) -> SigningKey | None:
    """Return the key that the environment (``VCFBENCH_SIGNING_KEY``) or the bench file names; None where neither does.

    Raises:
        ConfigError: it cannot be used.
    """
    path = os.environ.get("VCFBENCH_SIGNING_KEY") or bench_file
    return None if path is None else SigningKey(Path(path))


def new_key(path: Path) -> Path:
    """Make a key: `path` holds the private one, for its owner alone, ``path.pub``, which is returned, the public one.

    Raises:
        ConfigError: a file of that name is there, or it cannot be written.
    """
    serialization = need("cryptography.hazmat.primitives.serialization", "sign", _WHAT)
    key = _ed25519().Ed25519PrivateKey.generate()
    pem = serialization.Encoding.PEM
    private = key.private_bytes(pem, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    public = key.public_key().public_bytes(pem, serialization.PublicFormat.SubjectPublicKeyInfo)
    beside = path.with_name(f"{path.name}.pub")
    for file, data, mode in ((path, private, 0o600), (beside, public, 0o644)):
        with failing_as(ConfigError, f"{shown(file)}: no key can be written there"):
            descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, mode)
            with os.fdopen(descriptor, "wb") as opened:
                opened.write(data)
    return beside


def public_key_of(path: Path) -> str:
    """Return the public key in a file, of it or of the private one, in hexadecimal; ConfigError where it has none."""
    serialization = need("cryptography.hazmat.primitives.serialization", "sign", _WHAT)
    data = read_file(path, "a public key in PEM", _MOST)
    if b"PRIVATE KEY" in data:
        return SigningKey(path).public
    try:
        return str(serialization.load_pem_public_key(data).public_bytes_raw().hex())
    except (ValueError, AttributeError):
        raise ConfigError(f"{shown(path)}: expected a public key of Ed25519 in PEM") from None


def is_signed(line: Mapping[str, Any], seal: str | None) -> bool:
    """Return True if a line of type `signature` signs `seal` with the key that it names."""
    ed25519 = _ed25519()
    try:
        key = ed25519.Ed25519PublicKey.from_public_bytes(bytes.fromhex(line["key"]))
        key.verify(bytes.fromhex(line["signature"]), _SAID + str(seal).encode())
    except Exception:  # noqa: BLE001  # whatever is wrong with it, it is no signature
        return False
    return True


def _ed25519() -> Any:
    return need("cryptography.hazmat.primitives.asymmetric.ed25519", "sign", _WHAT)
