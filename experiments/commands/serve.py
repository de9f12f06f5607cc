"""`ttempc serve`: drive one scenario with a controller over UDP."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from ..errors import BadOptions
from . import options

_PORTS = {"json": 8890, "agopengps": 8888}

ABOUT = """\
Drives one scenario in real time with a controller of your own over UDP, and writes
what `ttempc run` writes. The protocols are described in docs/howto/serve.md:

  json        one datagram with samples a control period, one with the command
  agopengps   the plant in the place of the modules of AgOpenGPS, which steers it

The plant waits for the first peer, which then owns the session. A command that does
not come in time is replaced by the last one; after --hold the vehicle stops until
there is one again. With --step the plant waits for every command: the same commands
give the same run.

Exit codes as of `ttempc run`; 2 also where no peer came.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    options.add_scenario(parser)
    options.add_seed(parser)
    options.add_json(parser, "the summary")
    parser.add_argument(
        "--protocol", choices=_PORTS, default="json", help="of the datagrams (default: json)"
    )
    parser.add_argument(
        "--host",
        default="127.0.0.1",
        metavar="ADDRESS",
        help="to listen on (default: 127.0.0.1, this machine only). With any other, every computer "
        "that reaches it may drive: UDP has neither password nor encryption",
    )
    parser.add_argument(
        "--port",
        type=options.whole_number(0, 2**16 - 1),
        metavar="N",
        help="to listen on, 0 for any free one (default: 8890, of agopengps 8888)",
    )
    parser.add_argument(
        "--peer",
        metavar="HOST:PORT",
        help="the only peer that is listened to (default: the first that is understood)",
    )
    parser.add_argument(
        "--factor",
        type=options.number,
        metavar="X",
        help="simulated time over the clock's (default: 1)",
    )
    parser.add_argument(
        "--step", action="store_true", help="wait for every command instead of keeping the pace"
    )
    parser.add_argument(
        "--wait",
        type=options.number,
        default=600.0,
        metavar="S",
        help="time for the peer to start the run, and with --step for each command (default: 600)",
    )
    parser.add_argument(
        "--hold",
        type=options.number,
        default=1.0,
        metavar="S",
        help="simulated time for which the last command is held (default: 1)",
    )
    parser.set_defaults(command=_serve)


def _serve(arguments: argparse.Namespace) -> int:
    # Imported here so that --help does not load MuJoCo and matplotlib.
    from ..results.table import format_run
    from ..serve.link import Link, address_of, is_local, peer_of, text_of
    from ..serve.serve import PROTOCOLS, serve
    from ..serve.session import SessionSettings

    for option in ("factor", "wait", "hold"):
        value = getattr(arguments, option)
        if value is not None and not value > 0.0:
            raise BadOptions(f"--{option}: got {value:g}, must be above 0")
    if arguments.step and arguments.factor is not None:
        raise BadOptions("--factor: has no meaning with --step, which keeps no pace")
    port = _PORTS[arguments.protocol] if arguments.port is None else arguments.port
    address = address_of(arguments.host, port, "--host")
    peer = None if arguments.peer is None else peer_of(arguments.peer)
    name, scenario = options.load_scenario(arguments)
    settings = SessionSettings(
        factor=1.0 if arguments.factor is None else arguments.factor,
        lockstep=arguments.step,
        wait_s=arguments.wait,
        hold_s=arguments.hold,
    )
    folder = arguments.out or options.unused_path(
        Path("runs"), f"{name}-{arguments.protocol}-{arguments.seed}"
    )
    with Link(address, peer) as link:
        _say(f"{arguments.protocol} on {text_of(link.address)}, waiting for a peer")
        if not is_local(link.address):
            who = (
                f"everyone with the address {text_of(peer)}" if peer else "everyone who reaches it"
            )
            _say(f"{who} may drive: UDP has neither password nor encryption")
        protocol = PROTOCOLS[arguments.protocol]()
        finished, totals = serve(
            name, scenario, arguments.seed, folder, link, protocol, settings, say=_say
        )
    if arguments.json:
        print(finished.summary.to_json())
        _say(totals)
    else:
        print(format_run(finished.summary))
        print(f"\n{totals}\n")
        for what, file in finished.files.items():
            print(f"{what:<9} {file}")
    return 0 if finished.summary.status == "completed" else options.EXIT_LOST


def _say(line: str) -> None:
    print(f"ttempc serve: {line}", file=sys.stderr, flush=True)
