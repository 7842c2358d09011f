"""Profiles of streams: the frames of a gyroscope by its data sheet, for ``[gyro.stream]`` of bench files."""

from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from vcfbench.errors import ConfigError
from vcfbench.files import parse_toml, read_text, shown
from vcfbench.station.layering import merged


def stream_profiles() -> tuple[str, ...]:
    """Return the names of the profiles that come along."""
    files = resources.files("vcfbench.station").joinpath("streams").iterdir()
    return tuple(sorted(each.name.removesuffix(".toml") for each in files if each.name.endswith(".toml")))


def with_stream(values: Mapping[str, Any], source: str, folder: Path) -> Mapping[str, Any]:
    """Return the tables of a bench file with the profile of its stream in place, and the stream in place of a meter.

    Keys of the bench file go before those of the profile, whose file is found from `folder`.

    Raises:
        ConfigError: there is no such profile, or a multimeter beside the stream.
    """
    gyro = values.get("gyro")
    stream = gyro.get("stream") if isinstance(gyro, Mapping) else None
    if not isinstance(gyro, Mapping) or not isinstance(stream, Mapping):
        return values
    stated = dict(stream)
    if (named := stated.pop("profile", None)) is not None:
        stated = merged({"name": Path(str(named)).stem, **profile_keys(str(named), source, folder)}, stated)
    meter = {"model": "stream", "resource": stated.get("resource"), "timeout_s": stated.get("timeout_s", 2.0)}
    beside = values.get("multimeter", meter)
    if not isinstance(beside, Mapping) or beside.get("model") != "stream":
        raise ConfigError(f"{source}: multimeter: remove it: [gyro.stream] is the output")
    return {**values, "gyro": {**gyro, "stream": stated}, "multimeter": {**beside, **meter}}


def profile_keys(named: str, source: str, folder: Path) -> dict[str, Any]:
    """Return the keys of a profile, one that comes along or a file."""
    if named.endswith(".toml"):
        return parse_toml(read_text(folder / named, "a profile of a stream"), shown(folder / named))
    if named not in stream_profiles():
        known = f"one of {', '.join(stream_profiles())}, or FILE.toml"
        raise ConfigError(f"{source}: gyro.stream.profile: expected {known}, got {named!r}")
    text = resources.files("vcfbench.station").joinpath("streams", f"{named}.toml").read_text(encoding="utf-8")
    return parse_toml(text, f"profile {named}")
