"""Metadata with a checksum of its own: on a partial read nothing else in an MCAP file covers it.

Without it one flipped bit could turn "simulated" into something else, unnoticed.
"""

import zlib

from data.errors import DamagedRecording

LIBRARY = "catheter-robot-toolkit"  # what our recorder writes into a file's header


def seal(name: str, fields: dict[str, str]) -> dict[str, str]:
    """Return metadata with its checksum added."""
    return fields | {"crc32": f"{_metadata_checksum(name, fields):08x}"}


def unseal(name: str, fields: dict[str, str], must: bool, place: str) -> dict[str, str]:
    """Return metadata without its checksum; raise DamagedRecording when it differs, or is missing but `must`."""
    written = fields.pop("crc32", None)
    found = f"{_metadata_checksum(name, fields):08x}"
    if (must or written is not None) and written != found:
        raise DamagedRecording(f"{place}, metadata {name!r:.40}", f"checksum is {found}, should be {written}")
    return fields


def _metadata_checksum(name: str, fields: dict[str, str]) -> int:
    return zlib.crc32(repr((name, sorted(fields.items()))).encode("utf-8", "surrogatepass"))
