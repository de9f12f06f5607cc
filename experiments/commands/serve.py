"""`ttempc serve`: drive one scenario with a controller over UDP."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Final

from ..warm_up import compile_in_two_processes
from . import options
from .options import command, json_of, option, out, refuse_given

_PORTS: Final = {"json": 8890, "agopengps": 8888}


@command(
    options.SCENARIO,
    out("DIR", "default: a new one in runs/"),
    *options.CHANGES,
    options.SEED,
    json_of("the summary"),
    option(
        "--protocol", choices=tuple(_PORTS), default="json", help="of the datagrams (default: json)"
    ),
    option(
        "--host",
        default="127.0.0.1",
        metavar="ADDRESS",
        help="to listen on (default: 127.0.0.1, this machine only). With any other, every computer "
        "that reaches it may drive: UDP has neither password nor encryption",
    ),
    option(
        "--port",
        type=options.whole_number(0, 2**16 - 1),
        metavar="N",
        help="to listen on, 0 for any free one (default: 8890, of agopengps 8888)",
    ),
    option(
        "--peer",
        metavar="HOST:PORT",
        help="the only peer that is listened to (default: the first that is understood)",
    ),
    options.SPEED.but(help="simulated seconds per second (default: 1)"),
    option(
        "--step", action="store_true", help="wait for every command instead of keeping the pace"
    ),
    option(
        "--wait",
        type=options.positive,
        default=600.0,
        metavar="S",
        help="time for the peer to start the run, and with --step for each command (default: 600)",
    ),
    option(
        "--hold",
        type=options.positive,
        default=1.0,
        metavar="S",
        help="simulated time for which the last command is held (default: 1)",
    ),
)
def serve(arguments: argparse.Namespace) -> int:
    """Drive one scenario in real time with a controller of your own over UDP, and write
    what `ttempc run` writes. docs/integrations.md describes the protocols: json, or
    agopengps with the plant in the place of the modules of AgOpenGPS.

    A command that does not come in time is replaced by the last one; after --hold the
    vehicle stops until there is one again. With --step the plant waits for every command.
    Exit codes as of `ttempc run`; 2 also where no peer came.
    """
    # Imported here so that --help does not load MuJoCo and matplotlib.
    from ..results.table import format_run
    from ..serve.link import Link, address_of, is_local, peer_of, text_of
    from ..serve.session import PROTOCOLS, SessionSettings, serve

    if arguments.step:
        refuse_given(arguments, ("speed",), "has no meaning with --step, which keeps no pace")
    port = _PORTS[arguments.protocol] if arguments.port is None else arguments.port
    address = address_of(arguments.host, port, "--host")
    peer = None if arguments.peer is None else peer_of(arguments.peer)
    name, scenario = options.load_scenario(arguments)
    compile_in_two_processes(arguments)
    settings = SessionSettings(
        speed=arguments.speed or 1.0,
        lockstep=arguments.step,
        wait_s=arguments.wait,
        hold_s=arguments.hold,
    )
    stem = f"{name}-{arguments.protocol}-{arguments.seed}"
    folder = arguments.out or options.unused_path(Path("runs"), stem)
    with Link(address, peer) as link:
        _say(f"{arguments.protocol} on {text_of(link.address)}, waiting for a peer")
        if not is_local(link.address):
            reach = f"with the address {text_of(peer)}" if peer else "who reaches it"
            _say(f"everyone {reach} may drive: UDP has neither password nor encryption")
        protocol = PROTOCOLS[arguments.protocol]()
        asked = name, scenario, arguments.seed, folder, link, protocol, settings
        finished, totals = serve(*asked, _say)
    if arguments.json:
        print(finished.summary.to_json())
        _say(totals)
    else:
        print(format_run(finished.summary))
        print(f"\n{totals}\n")
        for what, file in finished.files.items():
            print(f"{what:<11} {file}")
        print(f"\nopen {finished.files['report']}")
    return 0 if finished.summary.status == "completed" else options.EXIT_LOST


def _say(line: str) -> None:
    print(f"ttempc serve: {line}", file=sys.stderr, flush=True)
