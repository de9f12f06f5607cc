"""Distances of the true vehicle from its path, against the corridor of the scenario."""

import math

import numpy as np

from ttempc.reference.corridor import Corridor
from ttempc.types import FloatArray

from ...testbed.recording.channels import REFERENCE
from ...testbed.truth import TOOL_LOWERED, TruthBlock
from .followed_line import FollowedLine

_NAN = math.nan


class CorridorJudge:
    """Rows of `channels.CORRIDOR` for the truth of a run.

    A corridor is a place: each point is compared with the nearest place of its own reference path,
    whatever the time. The tool's path lies behind the trailer's, as in `channels.TOOL`.
    """

    def __init__(self, corridor: Corridor, reference: FloatArray, distance_m: FloatArray) -> None:
        # reference: rows of `channels.REFERENCE` (n, fields); distance_m: of the tractor point (n,)
        self._half_width = corridor.half_width(distance_m)
        self._hitch_limit = _NAN if corridor.hitch_limit is None else corridor.hitch_limit
        column = {name: reference[:, i] for i, name in enumerate(REFERENCE.fields)}
        trailer = np.column_stack([column["x_i_m"], column["y_i_m"]])
        yaw = column["psi_i_rad"]
        behind = corridor.tool_behind_m or 0.0
        self._tractor = FollowedLine(np.column_stack([column["x_t_m"], column["y_t_m"]]))
        self._trailer = FollowedLine(trailer)
        self._tool = FollowedLine(trailer - behind * np.column_stack([np.cos(yaw), np.sin(yaw)]))

    def rows(self, moments: TruthBlock, references: FloatArray) -> FloatArray:
        """Return the rows at some moments, (n, fields); call it in the order of time."""
        del references
        rows = []
        for number, tool in enumerate(moments.tools.tolist()):
            x_t, y_t, _, x_i, y_i = moments.rows[number, 1:6].tolist()
            offset = _NAN
            place, tractor = self._tractor.offset(x_t, y_t)
            _, trailer = self._trailer.offset(x_i, y_i)
            if tool:
                _, offset = self._tool.offset(*tool[:2])
                offset = offset if tool[TOOL_LOWERED] == 1.0 else _NAN
            half_width = float(self._half_width[round(place)])
            half_width = half_width if math.isfinite(half_width) else _NAN
            rows.append((half_width, tractor, trailer, offset, self._hitch_limit))
        return np.array(rows)
