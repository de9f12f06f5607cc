"""Offsets of the true vehicle and of its reference from the line that was given."""

import numpy as np

from ttempc.types import FloatArray

from ...testbed.recording.channels import LINE, REFERENCE, STATE
from ...testbed.truth import STATE_COLUMNS, TOOL_LOWERED, TruthBlock
from .followed_line import FollowedLine

_POINTS = (("x_t_m", "y_t_m"), ("x_i_m", "y_i_m"))  # of tractor and trailer


class LineJudge:
    """Rows of `channels.LINE`: every point against the line as given, whatever the time.

    `line` is (n, 2) [m], in driving order.
    """

    def __init__(self, line: FloatArray) -> None:
        self._lines = [FollowedLine.evenly(line) for _ in LINE.fields]

    def rows(self, moments: TruthBlock, references: FloatArray) -> FloatArray:
        """Return the rows at some moments, (n, fields), in the order of time.

        `references` are the rows of `channels.REFERENCE` at these moments.
        """
        states = moments.rows[:, STATE_COLUMNS]
        places = [states[:, [STATE.fields.index(name) for name in names]] for names in _POINTS]
        tools = np.full((len(states), 2), np.nan)
        if moments.tools.size:
            lowered = moments.tools[:, TOOL_LOWERED] == 1.0
            tools[lowered] = moments.tools[lowered, :2]
        places.append(tools)
        places += [
            references[:, [REFERENCE.fields.index(name) for name in names]] for names in _POINTS
        ]
        offsets = [line.offsets(place) for line, place in zip(self._lines, places, strict=True)]
        return np.column_stack(offsets)
