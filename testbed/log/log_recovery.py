"""Recovery: a complete log from the content of a truncated or damaged one."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from ..atomic_write import atomic_write
from ..errors import LogError
from .log import FORMAT, FORMAT_KEY, PROGRAM, RUN_METADATA, media_type, refuse_existing_log
from .log_content import Content
from .mcap_file import McapFile

RECOVERED_KEY: Final = "recovered"  # metadata of a recovered log: extent of what was recovered


def recover(content: Content, file: Path) -> None:
    """Write the content of a log to a new log, its messages byte for byte.

    Raises:
        LogError: the file or its partial file exists, or it cannot be written; no new file is left.
    """
    refuse_existing_log(file)
    try:
        with atomic_write(file) as stream:
            _write(content, McapFile(stream, library=PROGRAM))
    except OSError as error:
        raise LogError(f"{file}: cannot be written: {error.strerror}") from error


def _write(content: Content, mcap: McapFile) -> None:
    extent = {} if content.salvage is None else {RECOVERED_KEY: str(content.salvage)}
    mcap.add_metadata(RUN_METADATA, {**content.metadata, **extent, FORMAT_KEY: FORMAT})
    for name, data in content.attachments.items():
        mcap.add_attachment(name, media_type(name), data)
    channels = {
        topic: mcap.add_topic(topic, schema.name, schema.data, content.descriptions[topic])
        for topic, schema in content.schemas.items()
    }
    recovered = (
        (message, channel)
        for topic, channel in channels.items()
        for message in content.messages.get(topic, [])
    )
    for message, channel in sorted(recovered, key=lambda each: each[0].log_time):
        mcap.add_message(channel, message.log_time, message.data)
    mcap.finish()
