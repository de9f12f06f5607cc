"""List of all studies."""

from __future__ import annotations

import importlib
import pkgutil
from typing import Final

from . import studies as declarations
from .study import Study

_OTHERS: Final = (".kayacan.eight_numbers", ".benchmarks")


def all_studies() -> dict[str, Study]:
    """Return every study by its name."""
    names = [f".studies.{item.name}" for item in pkgutil.iter_modules(declarations.__path__)]
    modules = [importlib.import_module(name, __package__) for name in (*names, *_OTHERS)]
    return {study.name: study for module in modules for study in module.STUDIES}
