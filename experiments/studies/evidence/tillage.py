"""A tool in the soil: slip of the tractor that pulls it, its draft and side force, side slopes."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ....testbed.recording.channels import STATE, TOOL
from ....testbed.recording.record import Record
from ....testbed.validation.check import between
from ...results.tracking_errors import START_UP_S, rows_at_same_time
from .drives import (
    CULTIVATOR,
    FARM,
    FARM_TOOL,
    FIELD_SENSORS,
    cross_error,
    seed_text,
    seeds,
    straight_pass,
)
from .evidence import ASSUMED_RULE, Evidence, around

_SOIL: Final = ("soil.random={coefficient_of_variation=0.3,correlation_m=5.0}",)  # the defaults
_HARD: Final = ("soil.cone_index_kpa=2000.0", 'terrain.iso_class="A"')
_SPEED: Final = 2.0  # [m/s]; 7.2 km/h
_SLIP_SOURCE: Final = (
    "New Holland T7.165 S, github.com/lindiap/tractor-field-operations-dataset, Case_2, 2,308 rows "
    "at 1 Hz labelled unmodified"
)
_MEMORY: Final = ((1, 0.41), (3, 0.26), (12, 0.14))  # lag [s], autocorrelation
_D497_N: Final = 0.85 * (46.0 + 2.8 * 3.6 * _SPEED) * 10 * 10.0  # F (A + B S) tools depth in cm
_D497_RANGE: Final = 0.30
_VEAL: Final = "Veal et al. 2009, VDI-Berichte 2060, boxplots in a handbook of automation"
_SLOPE: Final = 0.10  # [rad]


def working_slip(runs: int = 6) -> list[Evidence]:
    """Return the slip of a tractor at work: median, spread and autocorrelation."""
    changes = (*FARM_TOOL, *FIELD_SENSORS, *_SOIL)
    passes = [slip_each_second(straight_pass(_SPEED, seed, changes)[1]) for seed in seeds(runs)]
    slips = 100.0 * np.concatenate(passes)
    method = (
        f"{CULTIVATOR} at {_SPEED:g} m/s on straight passes of class D, 900 kPa with the default "
        f"random field, means of 1 s, {len(slips)} rows, {seed_text(runs)}"
    )
    uniform = (
        "straight passes at one speed and one set depth; the real field has changes of depth, "
        "texture, load and speed, and turns"
    )
    spread = between(
        "sd of the wheel slip at work",
        figure=float(slips.std()),
        low=around(3.9)[0],
        high=around(3.9)[1],
        unit="points",
        source=_SLIP_SOURCE,
    )
    median = between(
        "median wheel slip at work",
        figure=float(np.median(slips)),
        low=6.4,
        high=9.3,
        unit="%",
        source=_SLIP_SOURCE,
    )
    items = [
        Evidence(
            median,
            "7.8 %",
            "quartiles of the source",
            method,
            below="the source does not state the draft; the width of our tool is that of the "
            "machine, not one that loads the tractor as the source's was",
        ),
        Evidence(spread, "3.9 points", ASSUMED_RULE, method, below=uniform),
    ]
    for lag, published in _MEMORY:
        low, high = around(published)
        check = between(
            f"autocorrelation of the wheel slip after {lag} s",
            figure=autocorrelation(passes, lag),
            low=low,
            high=high,
            unit="",
            source=_SLIP_SOURCE,
        )
        items.append(
            Evidence(
                check,
                f"{published:.2f}",
                ASSUMED_RULE,
                method,
                below="the default random soil (assumed correlation length 5 m) forgets sooner "
                "than the field: its slow changes are missing",
                above="probably the record has noise of its sensors from row to row, which "
                "the true slip has not",
            )
        )
    return items


def transport_slip(runs: int = 3) -> list[Evidence]:
    """Return the slip of the machine that moves without a tool in the soil."""
    changes = (FARM[0], *_HARD, *FIELD_SENSORS)
    passes = [slip_each_second(straight_pass(_SPEED, seed, changes)[1]) for seed in seeds(runs)]
    low, high = around(0.6)
    check = between(
        "median wheel slip of a machine that moves without work",
        figure=100.0 * float(np.median(np.concatenate(passes))),
        low=low,
        high=high,
        unit="%",
        source=_SLIP_SOURCE,
    )
    return [
        Evidence(
            check,
            "0.6 %",
            ASSUMED_RULE,
            f"farm machine with its loaded trailer at {_SPEED:g} m/s on hard, smooth ground, "
            f"{seed_text(runs)}",
            above="the driven wheels carry the motion resistance of a loaded trailer, of which "
            "the record says nothing; the zero of a slip meter is set on such a drive",
        )
    ]


def tool_forces(runs: int = 3) -> list[Evidence]:
    """Return the mean draft of the tool, and its side force per degree of slip angle."""
    changes = (*FARM_TOOL, *FIELD_SENSORS)
    records = [straight_pass(_SPEED, seed, changes)[1] for seed in seeds(runs)]
    worked = [record[TOOL].time_s >= START_UP_S for record in records]
    draft = np.mean(
        [record[TOOL]["draft_n"][rows].mean() for record, rows in zip(records, worked, strict=True)]
    )
    low, high = around(_D497_N, _D497_RANGE)
    method = f"{CULTIVATOR} at {_SPEED:g} m/s on class D, {seed_text(runs)}"
    return [
        Evidence(
            between(
                "mean draft of a field cultivator, 10 tools, 10 cm, 7.2 km/h, medium soil",
                figure=float(draft),
                low=low,
                high=high,
                unit="N",
                source="ASABE D497, from public transcriptions",
            ),
            f"{_D497_N:.0f} N",
            f"the standard's range, ± {100.0 * _D497_RANGE:.0f} %; the law itself is the "
            "standard's, rough ground is ours",
            method,
        ),
        Evidence(
            between(
                "hitch cornering stiffness of an implement",
                figure=float(np.mean([side_stiffness(record) for record in records])),
                low=452.0,
                high=3385.0,
                unit="N/deg",
                source="Pearson and Bevly 2007, J. Terramechanics 44",
            ),
            "452 to 3385 N/deg",
            "the source's range; our coefficient per worked area is assumed from it",
            f"{method}, side force over slip angle of the tool point by least squares",
            below="the tool works 0.2 m2 of soil, the implements of the source's large tractor "
            "more than that",
        ),
    ]


def unsteered_tool(runs: int = 3) -> list[Evidence]:
    """Return the errors of a guided tractor and of its unsteered tool along a side slope."""
    changes = (
        *FARM_TOOL,
        *FIELD_SENSORS,
        'controller.name="pid"',
        "controller.vehicle.trailer_limit_deg=0.01",
        f"terrain.slope_rad={_SLOPE}",
    )
    records = [straight_pass(_SPEED, seed, changes)[1] for seed in seeds(runs)]
    tractor, tool = (
        100.0 * np.median(np.abs(np.concatenate([cross_error(each, point) for each in records])))
        for point in ("tractor", "tool")
    )
    method = (
        f"{CULTIVATOR}, `pid`, trailer steering locked, {_SPEED:g} m/s along a side slope of "
        f"{_SLOPE:g} rad, `field` sensors, {seed_text(runs)}, median of the unsigned error"
    )
    return [
        Evidence(
            between(
                "cross-track error of a guided tractor on a slope",
                figure=float(tractor),
                low=0.0,
                high=3.0,
                unit="cm",
                source=_VEAL,
            ),
            "commonly < 3 cm",
            "the source's limit",
            method,
            above="the GNSS error of 3 cm an axis, correlated over a minute, is larger than that "
            "of the source's receiver",
        ),
        Evidence(
            between(
                "cross-track error of its unsteered implement",
                figure=float(tool),
                low=20.0,
                high=math.inf,
                unit="cm",
                source=_VEAL,
            ),
            "may be > 20 cm",
            "the source's limit, of low-draft implements on gentle slopes of unknown size",
            method,
            below="the tyres of the loaded trailer and the cultivator hold the slope at small "
            "slip angles; the source's low-draft planters have little side force and looser "
            "linkages",
        ),
    ]


def slip_each_second(record: Record) -> FloatArray:
    """Return the mean slip of the driven wheels in every second after the start-up, (n,)."""
    state = record[STATE]
    counted = state.time_s >= START_UP_S
    slip = 1.0 - state["v_mps"][counted] / state["v_rim_mps"][counted]
    rows = round(1.0 / np.median(np.diff(state.time_s)))  # of a second
    return slip[: len(slip) // rows * rows].reshape(-1, rows).mean(axis=1)


def autocorrelation(passes: list[FloatArray], lag: int) -> float:
    """Return the autocorrelation at a lag [samples] of several series about their common mean."""
    mean = np.mean(np.concatenate(passes))
    centred = [series - mean for series in passes]
    pairs = np.mean(np.concatenate([series[:-lag] * series[lag:] for series in centred]))
    return float(pairs / np.mean(np.square(np.concatenate(centred))))


def side_stiffness(record: Record) -> float:
    """Return the side force of a tool per slip angle of its point, by least squares [N/deg]."""
    time_s, tool, state = rows_at_same_time(record, TOOL, STATE)
    yaw = record[STATE]["psi_i_rad"][state]
    vx, vy = (np.gradient(record[TOOL][name][tool], time_s) for name in ("x_m", "y_m"))
    angle = np.degrees(
        np.arctan2(vy * np.cos(yaw) - vx * np.sin(yaw), vx * np.cos(yaw) + vy * np.sin(yaw))
    )
    counted = time_s >= START_UP_S
    side = record[TOOL]["side_n"][tool][counted]
    angle = angle[counted]
    return float(-(side @ angle) / (angle @ angle))
