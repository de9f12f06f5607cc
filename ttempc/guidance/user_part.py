"""Calls of parts that a user wrote."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from ..errors import GuidanceFailed


@contextmanager
def user_part(error: type[GuidanceFailed], what: str) -> Iterator[None]:
    """Convert whatever a user's part raises to `error`; `what` was called starts the message.

    `SystemExit` and other exceptions that do not derive from `Exception` are converted, too: they
    would end the program of the caller. An interrupt is the caller's own and passes.
    """
    try:
        yield
    except KeyboardInterrupt:
        raise
    except BaseException as reason:
        raise error(f"{what}: {type(reason).__name__}: {reason}") from reason
