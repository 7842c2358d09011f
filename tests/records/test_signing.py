"""Keys that are none, and signatures that sign something else."""

from __future__ import annotations

import os
import stat
import sys
from typing import TYPE_CHECKING, Any

import pytest

from vcfbench.errors import ConfigError
from vcfbench.records.signing import SigningKey, is_signed, named_key, new_key, public_key_of

if TYPE_CHECKING:
    from pathlib import Path

serialization = pytest.importorskip("cryptography.hazmat.primitives.serialization")
SEAL = "0f" * 32


def pem(key: Any, password: bytes | None = None) -> bytes:
    encryption = serialization.BestAvailableEncryption(password) if password else serialization.NoEncryption()
    made: bytes = key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, encryption)
    return made


def other_kind() -> Any:
    from cryptography.hazmat.primitives.asymmetric import ec  # noqa: PLC0415

    return ec.generate_private_key(ec.SECP256R1())


@pytest.mark.skipif(sys.platform == "win32", reason="modes are different there")
def test_new_key_is_private_and_never_overwrites(tmp_path: Path) -> None:
    before = os.umask(0)
    try:
        public = new_key(tmp_path / "station.pem")
    finally:
        os.umask(before)
    assert public == tmp_path / "station.pem.pub"
    modes = [stat.S_IMODE(path.stat().st_mode) for path in (tmp_path / "station.pem", public)]
    assert modes == [0o600, 0o644]
    assert (
        public_key_of(public) == public_key_of(tmp_path / "station.pem") == SigningKey(tmp_path / "station.pem").public
    )
    assert b"PUBLIC KEY" in public.read_bytes()
    kept = public.read_bytes()
    with pytest.raises(ConfigError, match=r"station\.pem: no key can be written there: File exists"):
        new_key(tmp_path / "station.pem")
    assert public.read_bytes() == kept


def test_what_is_no_key_of_a_station_is_one_sentence(tmp_path: Path) -> None:
    path = tmp_path / "key"
    new_key(tmp_path / "station.pem")
    private = serialization.load_pem_private_key((tmp_path / "station.pem").read_bytes(), None)
    for data, words in (
        (b"none", "expected a private key in PEM without password"),
        (pem(private, b"secret"), "expected a private key in PEM without password"),
        (pem(other_kind()), "expected a key of Ed25519; vcfbench runs new-key FILE makes one"),
    ):
        path.write_bytes(data)
        with pytest.raises(ConfigError, match=words):
            SigningKey(path)
    spki = serialization.PublicFormat.SubjectPublicKeyInfo
    for data in (b"none", other_kind().public_key().public_bytes(serialization.Encoding.PEM, spki)):
        path.write_bytes(data)
        with pytest.raises(ConfigError, match="expected a public key of Ed25519 in PEM"):
            public_key_of(path)


def test_signature_line_signs_one_seal_with_named_key(tmp_path: Path) -> None:
    new_key(tmp_path / "a")
    new_key(tmp_path / "b")
    line = SigningKey(tmp_path / "a").signature(SEAL)
    assert is_signed(line, SEAL)
    wrong = [{**line, "key": public_key_of(tmp_path / "b")}, {**line, "key": "no hex"}, {"key": line["key"]}, {}]
    assert not any(is_signed(each, SEAL) for each in wrong)
    assert not is_signed(line, SEAL.replace("f", "e"))
    assert not is_signed(line, None)


def test_the_environment_names_a_key_before_the_bench_file_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    new_key(tmp_path / "a")
    new_key(tmp_path / "b")
    monkeypatch.setenv("VCFBENCH_SIGNING_KEY", "")
    assert named_key(None) is None
    of_bench = named_key(str(tmp_path / "a"))
    monkeypatch.setenv("VCFBENCH_SIGNING_KEY", str(tmp_path / "b"))
    of_environment = named_key(str(tmp_path / "a"))
    assert of_bench is not None
    assert of_environment is not None
    assert of_bench.public == public_key_of(tmp_path / "a")
    assert of_environment.public == public_key_of(tmp_path / "b")


@pytest.mark.skipif(os.name != "posix", reason="modes are different there")
@pytest.mark.parametrize("mode", [0o644, 0o640, 0o660, 0o604, 0o602])
def test_a_key_that_others_may_use_signs_nothing(mode: int, tmp_path: Path) -> None:
    new_key(tmp_path / "station.pem")
    (tmp_path / "station.pem").chmod(mode)
    with pytest.raises(ConfigError, match=rf"only its owner can read, got mode {mode:04o}.*chmod 600"):
        SigningKey(tmp_path / "station.pem")
