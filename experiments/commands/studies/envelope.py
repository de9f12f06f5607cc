"""`ttempc envelope`: find where controllers fail."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from ...output import create_partial, refuse_existing, write_file
from .. import options

ABOUT = """\
Makes one quantity of a scenario harder until a controller fails: in at least half of
the seeds the run terminates early, or the trailer's 95 % cross-track error exceeds a
limit. Scans the whole range first and reports if both ends pass or fail, or if failure
is not monotone; then bisects down to the tolerance. Prints one line per controller and
writes the results, with every value that was tried, to a JSON file.

Exit code 0 if the search completed, 2 for bad input (one line, no run made).
"""
_TOLERANCES = {"cone-index": 20.0, "slope": 0.01, "speed": 0.05, "delay": 0.05, "roughness": 1.0}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of the command."""
    parser.add_argument("quantity", choices=_TOLERANCES, help="quantity to vary")
    options.add_scenario(parser)
    parser.add_argument(
        "--controller",
        action="append",
        metavar="NAME",
        help="controller; may be repeated (default: the scenario's)",
    )
    parser.add_argument("--low", type=options.number, metavar="X", help="one end of the range")
    parser.add_argument("--high", type=options.number, metavar="X", help="the other end")
    parser.add_argument(
        "--tolerance", type=options.number, metavar="X", help="width at which the bisection ends"
    )
    parser.add_argument(
        "--limit",
        type=options.number,
        metavar="M",
        help="a run fails above this 95 %% cross-track error of the trailer, in m (default: a run "
        "fails only by early termination)",
    )
    parser.add_argument(
        "--seeds",
        type=options.whole_number(1),
        default=3,
        metavar="N",
        help="runs per value (default: 3)",
    )
    options.add_workers(parser)
    options.add_json(parser, "the values")
    parser.set_defaults(command=_envelope)


def _envelope(arguments: argparse.Namespace) -> int:
    # Imported here so that --help does not load MuJoCo and Dask.
    from ....testbed.recording.provenance import versions
    from ...run.user_code import named_parts, refuse_untrusted
    from ...scenario.scenario import parse_overrides, read_scenario
    from ...sweep.engine import engine
    from ...sweep.envelope import QUANTITIES, EnvelopeFile, Question, envelope

    settings = parse_overrides(arguments.overrides)
    draft = read_scenario(arguments.scenario)
    name, quantity = arguments.quantity, QUANTITIES[arguments.quantity]
    file = arguments.out or options.unused_path(
        Path("runs"), f"envelope-{draft.name}-{name}", ".json"
    )
    refuse_existing(file)
    for controller in (arguments.controller or [None]) if not arguments.trust else ():
        changes = settings if controller is None else _with_controller(settings, controller)
        refuse_untrusted(draft.file, named_parts(draft.scenario(changes, "--set")), changes)
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
    results, text = [], ""
    with engine(arguments.workers, arguments.dask) as run_jobs:
        partial = create_partial(file)
        for question in questions:
            results.append(envelope(question, run_jobs))
            if not arguments.json:
                print(results[-1], flush=True)
            content = asdict(EnvelopeFile(versions(), tuple(results)))
            text = json.dumps(content, indent=2, allow_nan=False) + "\n"
            write_file(partial, text)
    partial.rename(file)
    print(text if arguments.json else f"values    {file}\n", end="")
    return 0


def _with_controller(settings: dict[str, Any], name: str) -> dict[str, Any]:
    return {**settings, "controller": {**settings.get("controller", {}), "name": name}}
