"""A damaged recording's sound messages, written to a new file; the damaged one stays as it is."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mcap.opcode import Opcode
from mcap.records import Channel, Metadata, Schema

from data.chunk import Messages
from data.container import loose_from
from data.errors import BadInput, DamagedRecording
from data.files import check_inputs, fresh, open_regular
from data.inspection import Inspection, Piece, Progress, inspect, parse, scan
from data.seal import LIBRARY, SEAL, seal, unseal


@dataclass
class _Copy:
    """What is known while pieces are copied: the file's own numbers, and ours for the same things."""

    writer: Any
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    written: dict[int, int] = field(default_factory=dict)  # channel numbers, theirs to ours
    metadata: list[str] = field(default_factory=list)
    messages: int = 0
    unverified: list[tuple[int, int, int]] = field(default_factory=list)
    orphans: int = 0


def salvage(path: Path, out: Path, *, replace: bool = False, progress: Progress | None = None) -> Inspection:
    """Write every message that can be had of `path` to `out`, a sound recording; return what was found.

    Messages of a chunk that was cut off come along, and the new file's metadata record "salvage"
    names their times as unverified, beside everything that was lost. Raises BadInput for what is
    no recording or has nothing to save, CannotWrite for the output.
    """
    from mcap.writer import CompressionType, Writer

    check_inputs(out, path)
    definitions: list[Piece] = []  # the summary repeats what a lost chunk held
    found = inspect(path, progress, definitions)
    with fresh(out, replace) as temporary, temporary.open("wb") as target, open_regular(path) as file:
        copy = _Copy(Writer(target, compression=CompressionType.ZSTD, enable_data_crcs=True))
        copy.writer.start(library=LIBRARY)
        for piece in definitions:
            _define(piece, copy)
        for piece in scan(file, path, []):
            _copy(piece, copy, path)
        if not copy.messages:
            raise BadInput(path, "has no message that can be saved", "nothing was written")
        copy.writer.add_metadata("salvage", seal("salvage", _report(found, copy, path)))
        copy.writer.finish()
    return found


def _define(piece: Piece, copy: _Copy) -> None:
    match parse(piece):
        case Schema() as schema:
            copy.schemas.setdefault(schema.id, schema)
        case Channel() as channel:
            copy.channels.setdefault(channel.id, channel)
        case Metadata() as metadata if metadata.name not in copy.metadata:
            fields = dict(metadata.metadata)
            try:
                fields = unseal(metadata.name, fields, "") if SEAL in fields else fields
            except DamagedRecording:  # `inspect` has found it: what it says cannot be trusted
                return
            copy.metadata.append(metadata.name)
            copy.writer.add_metadata(metadata.name, seal(metadata.name, fields))


def _copy(piece: Piece, copy: _Copy, path: Path) -> None:
    if piece.opcode == Opcode.MESSAGE:
        one = loose_from(piece.content, path)
        _write(Messages.of_one(one.channel_id, one.log_time, one.data), copy)
    if piece.records is None:
        return
    for opcode, content in piece.records.others:
        _define(Piece(piece.offset, opcode, content), copy)
    messages = piece.records.messages
    if not piece.verified and len(messages):
        copy.unverified.append((int(messages.stamp_ns.min()), int(messages.stamp_ns.max()), len(messages)))
    _write(messages, copy)


def _write(messages: Messages, copy: _Copy) -> None:
    for index, number in enumerate(messages.channel.tolist()):
        ours = copy.written.get(number) or _register(number, copy)
        if ours is None:
            copy.orphans += 1
            continue
        stamp = int(messages.stamp_ns[index])
        copy.writer.add_message(ours, log_time=stamp, data=messages.content(index), publish_time=stamp)
        copy.messages += 1


def _register(number: int, copy: _Copy) -> int | None:
    """Return our number of a channel, registered on first use; None when its description was lost."""
    channel = copy.channels.get(number)
    if channel is None or (channel.schema_id and channel.schema_id not in copy.schemas):
        return None
    schema_id = 0
    if channel.schema_id:
        schema = copy.schemas[channel.schema_id]
        schema_id = copy.writer.register_schema(schema.name, schema.encoding, schema.data)
    fields = dict(channel.metadata)
    copy.written[number] = copy.writer.register_channel(channel.topic, channel.message_encoding, schema_id, fields)
    return copy.written[number]


def _report(found: Inspection, copy: _Copy, path: Path) -> dict[str, str]:
    lines = {f"lost.{i}": f"byte {f.offset}: {f.what}" for i, f in enumerate(found.findings, start=1)}
    for i, (start, end, count) in enumerate(copy.unverified, start=1):
        lines[f"unverified.{i}"] = f"{count} messages, stamps {start} to {end} ns: their chunk was cut off"
    if copy.orphans:
        lines["orphans"] = f"{copy.orphans} messages whose channel's description was lost"
    return {"from": ascii(path.name)[1:-1], "messages": str(copy.messages), **lines}
