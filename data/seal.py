"""Metadata with a checksum of its own: on a partial read nothing else in an MCAP file covers it.

Without it one flipped bit could turn "simulated" into something else, unnoticed.
"""

import zlib

from data.errors import DamagedRecording

LIBRARY = "catheter-robot-toolkit"  # what our recorder writes into a file's header
SEAL = "catheter-robot-toolkit.crc32"  # the key of the checksum


def seal(name: str, fields: dict[str, str]) -> dict[str, str]:
    """Return metadata with its checksum added."""
    return fields | {SEAL: _checksum(name, fields)}


def unseal(name: str, fields: dict[str, str], place: str) -> dict[str, str]:
    """Return our metadata without its checksum; raise DamagedRecording when that is wrong or missing."""
    rest = {key: value for key, value in fields.items() if key != SEAL}
    written, found = fields.get(SEAL), _checksum(name, rest)
    if written != found:
        raise DamagedRecording(f"{place}, metadata {name!r:.40}", f"checksum is {found}, should be {written}")
    return rest


def _checksum(name: str, fields: dict[str, str]) -> str:
    return f"{zlib.crc32(repr((name, sorted(fields.items()))).encode('utf-8', 'surrogatepass')):08x}"
