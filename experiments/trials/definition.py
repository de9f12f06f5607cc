"""Frozen scenarios of the field trials and their identifier."""

from __future__ import annotations

import functools
import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from ...testbed.configuration.resources import resource
from ...testbed.recording.provenance import code_digest
from ..scenario.scenario import Scenario, read_scenario

VERSION: Final = "v1"
"""Version of the field trials; other scenarios, seeds or scores are another version."""

_PROBES: Final = "plant.json"


def trial_files() -> dict[str, Path]:
    """Return the scenario files of the trials by name."""
    return {file.stem: file for file in sorted(_folder().glob("*.toml"))}


def trial(name: str) -> Scenario:
    """Return the scenario of a trial, with the default controller."""
    return read_scenario(str(trial_files()[name])).scenario()


def frozen_probes() -> dict[str, tuple[float, ...]]:
    """Return the results of the plant's probes that the identifier stands for, by trial."""
    content = json.loads((_folder() / _PROBES).read_text(encoding="utf-8"))
    return {name: tuple(values) for name, values in content.items()}


@functools.cache
def frozen_identifier() -> str:
    """Return version and content hash of the trials.

    The hash is that of the scenario files without their descriptions, and of the frozen results of
    the plant's probes, in which defaults, vehicle and plant count. A new key that is off by default
    changes neither.
    """
    contents = {name: read_scenario(str(file)).content for name, file in trial_files().items()}
    return identifier_of(contents, frozen_probes())


def identifier_of(
    contents: Mapping[str, Mapping[str, Any]], probes: Mapping[str, tuple[float, ...]]
) -> str:
    """Return the identifier of the tables of scenario files and of probe results."""
    trials = {
        name: {key: value for key, value in content.items() if key != "description"}
        for name, content in contents.items()
    }
    text = json.dumps([trials, {**probes}], sort_keys=True)
    return f"{VERSION}-{hashlib.sha256(text.encode()).hexdigest()[:8]}"


def identifier(differing: tuple[str, ...]) -> str:
    """Return the identifier of a bench.

    Args:
        differing: trials on which the plant of this code differs from the frozen one. The
            identifier then has the digest of the code, so that runs compare within one code only.
    """
    return f"{frozen_identifier()}+{code_digest()}" if differing else frozen_identifier()


def _folder() -> Path:
    return resource("proving_ground.experiments.trials", VERSION)
