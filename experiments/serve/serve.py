"""One run with a peer over UDP in the place of the controller."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Final

from ..run.simulate import Finished, run
from ..scenario.scenario import Scenario
from .agopengps import AgOpenGpsProtocol
from .json_protocol import JsonProtocol
from .link import Link
from .protocol import WireProtocol
from .remote import RemoteController
from .session import Session, SessionSettings

PROTOCOLS: Final[dict[str, Callable[[], WireProtocol]]] = {
    "json": JsonProtocol,
    "agopengps": AgOpenGpsProtocol,
}


def serve(
    name: str,
    scenario: Scenario,
    seed: int,
    folder: Path,
    link: Link,
    protocol: WireProtocol,
    settings: SessionSettings | None = None,
    *,
    say: Callable[[str], None] = lambda line: None,
) -> tuple[Finished, str]:
    """Run a scenario with the controller at the other end of a link; write as `run` does.

    Args:
        name: of the scenario.
        scenario: what to run; its controller is replaced.
        seed: draws terrain and noise.
        folder: to make.
        link: socket, open.
        protocol: of the datagrams; of this run alone.
        settings: of the session.
        say: is told what happens beside the run, in lines.

    Returns:
        What the run left, and what was exchanged as one line.

    Raises:
        ServeError: no peer was ready in time; nothing is written.
        OutputExists, ExperimentError, TestbedError, TtempcError: as `run`.
    """
    session = Session(name, link, protocol, settings or SessionSettings(), say)
    factory = partial(RemoteController, link=session.commands)
    try:
        finished = run(name, scenario, seed, folder, factory=factory, make=session.assemble)
        session.end(finished.summary.status)
    finally:
        session.end("interrupted")
    return finished, session.totals()
