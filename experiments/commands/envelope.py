"""`ttempc envelope`: find where controllers fail."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from ..output import begin_part, refuse_existing
from . import options
from .sweep import add_workers

_ABOUT = """\
Makes one quantity of a scenario harder until a controller fails: the vehicle is lost,
or the trailer's 95 % cross-track error exceeds a limit, in at least half of the seeds.
Looks at the whole range first, says where both of its ends hold or fail and where
failure comes and goes, then bisects down to the tolerance. Prints a line a controller
and writes what was found, with every value that was tried, to a JSON file.

Exit code 0 where the question was answered, 2 for bad input (one line, no run made).
"""
_TOLERANCES = {"cone-index": 20.0, "slope": 0.01, "speed": 0.05, "delay": 0.05, "roughness": 1.0}


def add(commands: options.Commands) -> None:
    """Declare the command."""
    parser = options.command(commands, "envelope", "find where controllers fail", _ABOUT)
    parser.add_argument("quantity", choices=_TOLERANCES, help="what is made harder")
    options.add_scenario(parser)
    parser.add_argument(
        "--controller",
        action="append",
        metavar="NAME",
        help="who drives; may be repeated (default: the scenario's)",
    )
    parser.add_argument("--low", type=options.number, metavar="X", help="one end of the range")
    parser.add_argument("--high", type=options.number, metavar="X", help="the other end")
    parser.add_argument("--tolerance", type=options.number, metavar="X", help="how close to come")
    parser.add_argument(
        "--limit",
        type=options.number,
        metavar="M",
        help="fails above this 95 %% cross-track error of the trailer, in m (default: only where "
        "the vehicle is lost)",
    )
    parser.add_argument(
        "--seeds", type=_seeds, default=3, metavar="N", help="runs a value (default: 3)"
    )
    add_workers(parser)
    parser.set_defaults(command=_envelope)


def _seeds(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number from 1, got {text!r}")
    return int(text)


def _envelope(arguments: argparse.Namespace) -> int:
    # Here, because MuJoCo and Dask take seconds to load, and help should not wait.
    from proving_ground.testbed.recording.provenance import versions

    from ..scenario.scenario import parse_overrides, read_scenario
    from ..sweep.engine import engine
    from ..sweep.envelope import QUANTITIES, EnvelopeFile, Question, envelope

    settings = parse_overrides(arguments.overrides)
    draft = read_scenario(arguments.scenario)
    name, quantity = arguments.quantity, QUANTITIES[arguments.quantity]
    file = arguments.out or options.fresh(Path("runs"), f"envelope-{draft.name}-{name}", ".json")
    refuse_existing(file)
    questions = [
        Question(
            scenario=arguments.scenario,
            controller=controller,
            quantity=name,
            low=quantity.low if arguments.low is None else arguments.low,
            high=quantity.high if arguments.high is None else arguments.high,
            tolerance=_TOLERANCES[name] if arguments.tolerance is None else arguments.tolerance,
            limit_m=arguments.limit,
            seeds=tuple(range(1, arguments.seeds + 1)),
            settings=settings,
        )
        for controller in arguments.controller or [draft.scenario(settings).controller.name]
    ]
    for question in questions:
        question.check()
    found = []
    with engine(arguments.workers, arguments.dask) as carried_out:
        part = begin_part(file)
        for question in questions:
            found.append(envelope(question, carried_out))
            print(found[-1], flush=True)
            content = asdict(EnvelopeFile(versions(), tuple(found)))
            text = json.dumps(content, indent=2, allow_nan=False) + "\n"
            part.write_text(text, encoding="utf-8")
    part.rename(file)
    print(f"values    {file}")
    return 0
