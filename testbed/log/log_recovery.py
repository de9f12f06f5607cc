"""Makes a whole log of what a torn or damaged one still holds."""

from __future__ import annotations

from pathlib import Path

from ..errors import LogError
from .log import FORMAT, FORMAT_KEY, MEDIA_TYPES, PROGRAM, RUN_METADATA
from .log_content import Content
from .mcap_file import McapFile

RECOVERED_KEY = "recovered"  # in the metadata of a recovered log: what was kept, in words


def recover(content: Content, file: Path) -> None:
    """Write the content of a log to a new one, its messages byte for byte.

    Raises:
        LogError: the file exists already or cannot be written; nothing is left behind.
    """
    if file.exists():
        raise LogError(f"{file}: exists already and is not written over")
    part = file.with_name(file.name + ".part")
    try:
        with part.open("xb") as stream:
            try:
                _write(content, McapFile(stream, library=PROGRAM))
            except OSError:
                part.unlink()
                raise
        part.rename(file)
    except OSError as error:
        raise LogError(f"{file}: cannot be written: {error.strerror}") from error


def _write(content: Content, mcap: McapFile) -> None:
    said = {} if content.salvage is None else {RECOVERED_KEY: str(content.salvage)}
    mcap.add_metadata(RUN_METADATA, {**content.metadata, **said, FORMAT_KEY: FORMAT})
    for name, data in content.attachments.items():
        mcap.add_attachment(name, MEDIA_TYPES.get(Path(name).suffix, "text/plain"), data)
    channels = {
        topic: mcap.add_topic(topic, schema.name, schema.data)
        for topic, schema in content.schemas.items()
    }
    kept = (
        (message, channel)
        for topic, channel in channels.items()
        for message in content.messages.get(topic, [])
    )
    for message, channel in sorted(kept, key=lambda each: each[0].log_time):
        mcap.add_message(channel, message.log_time, message.data)
    mcap.finish()
