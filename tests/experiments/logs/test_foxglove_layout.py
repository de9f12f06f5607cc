"""Shipped Foxglove layout: its topics and fields exist in a log."""

import json
import re

from proving_ground.experiments.logs.foxglove_layout import FILE, layout_text
from proving_ground.testbed.messages.publisher import topics_of
from proving_ground.testbed.recording.channels import CHANNELS, ERROR

FIELDS = {f"{channel.topic}.{name}" for channel in (*CHANNELS, ERROR) for name in channel.fields}
LAYOUT = json.loads(FILE.read_text(encoding="utf-8"))


def texts(node):
    """Yield every key and text of a JSON tree."""
    if isinstance(node, dict):
        for key, value in node.items():
            yield key
            yield from texts(value)
    elif isinstance(node, list):
        for value in node:
            yield from texts(value)
    elif isinstance(node, str):
        yield node


def leaves(node):
    if isinstance(node, str):
        return [node]
    assert node["direction"] in ("row", "column")
    assert 0.0 < node["splitPercentage"] < 100.0
    return leaves(node["first"]) + leaves(node["second"])


def test_the_file_is_what_its_program_writes():
    assert FILE.read_text(encoding="utf-8") == layout_text(), (
        "run python -m experiments.logs.foxglove_layout"
    )


def test_every_topic_and_field_in_it_exists():
    topics = [each for each in texts(LAYOUT["configById"]) if re.match(r"/\w", each)]
    assert len(topics) > 30
    assert set(topics) <= FIELDS | {each.name for each in topics_of()}


def test_every_panel_has_one_place():
    assert sorted(leaves(LAYOUT["layout"])) == sorted(LAYOUT["configById"])
