"""Ground: shape and strength together, and their archive in a log."""

from __future__ import annotations

import io
import zipfile
import zlib
from dataclasses import dataclass
from typing import Final

import numpy as np

from ttempc.types import FloatArray

from ..errors import InvalidField
from .grid import MOST_POINTS, check_array_header
from .terrain import Terrain

GROUND_FILE: Final = "ground.npz"  # the attachment of a log

_MOST_BYTES: Final = 8 * MOST_POINTS  # of both grids in single precision
_FOREIGN: Final = (  # raised by archives of someone else
    *(KeyError, ValueError, TypeError, OSError, EOFError, MemoryError, RuntimeError, OverflowError),
    *(zipfile.BadZipFile, zlib.error, InvalidField),
)


@dataclass(frozen=True, slots=True, eq=False)
class Ground:
    """The ground of a run."""

    terrain: Terrain
    cone_index: FloatArray  # (ny, nx) [kPa] at the points of the terrain's grid
    ruts: bool = False  # whether wheels press it; `terrain` is its shape before

    def cone_index_at(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Return the cone index [kPa] of the grid points nearest to (x, y) [m], all (n,).

        Beyond the grid it is that of the border. Half way, the point with the larger coordinate
        counts.
        """
        (ny, nx) = self.cone_index.shape
        terrain = self.terrain
        column = np.floor((x - terrain.origin[0]) / terrain.spacing_m + 0.5)
        row = np.floor((y - terrain.origin[1]) / terrain.spacing_m + 0.5)
        rows = np.clip(row, 0, ny - 1)
        columns = np.clip(column, 0, nx - 1)
        return self.cone_index[rows.astype(np.int64), columns.astype(np.int64)]

    def to_npz(self) -> bytes:
        """Return the ground as a compressed numpy archive, in single precision.

        Heights of a field of 80 m in single precision are accurate to a micrometre: enough for
        pictures, but not to repeat a simulation.
        """
        arrays = {
            "heights_m": self.terrain.heights.astype(np.float32),
            "cone_index_kpa": self.cone_index.astype(np.float32),
            "spacing_m": np.array(self.terrain.spacing_m),
            "origin_m": np.array(self.terrain.origin),
        }
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
            for name, values in arrays.items():
                file = io.BytesIO()
                np.save(file, values, allow_pickle=False)
                # rough ground compresses badly: 60 ms for 7 % of its bytes
                rough = name == "heights_m" and values.std() > 0
                kind = zipfile.ZIP_STORED if rough else None
                archive.writestr(f"{name}.npy", file.getvalue(), kind)
        return stream.getvalue()

    @classmethod
    def from_npz(cls, data: bytes) -> Ground:
        """Return the ground that `to_npz` wrote.

        Raises:
            InvalidField: the bytes are not such an archive.
        """
        try:
            _check_archive(data)
            with np.load(io.BytesIO(data), allow_pickle=False) as archive:
                x, y = archive["origin_m"].tolist()
                terrain = Terrain(archive["heights_m"], float(archive["spacing_m"]), (x, y))
                cone_index = archive["cone_index_kpa"].astype(float)  # (ny, nx)
        except _FOREIGN as error:
            raise InvalidField(f"ground: not the ground of a log ({error})") from error
        if cone_index.shape != terrain.heights.shape:
            raise InvalidField(
                f"ground: got heights {terrain.heights.shape} and cone indices "
                f"{cone_index.shape}, must be of one shape"
            )
        return cls(terrain, cone_index)


def _check_archive(data: bytes) -> None:
    """Refuse an archive whose arrays declare other sizes than they have, or too large ones.

    Raises:
        ValueError: with the size and the limit.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        members = archive.infolist()
        total = sum(member.file_size for member in members)
        if total > _MOST_BYTES + 4096:
            raise ValueError(f"{total} bytes once decompressed, at most {_MOST_BYTES}")
        for member in members:
            with archive.open(member) as stream:
                check_array_header(io.BytesIO(stream.read(4096)), member.file_size)
