"""Export of a log: tables as CSV or Parquet, and a recording for the viewer Rerun."""

from __future__ import annotations

import importlib.util
import shutil
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

import numpy as np
import pandas
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from ...testbed.atomic_write import partial_path
from ...testbed.errors import LogError
from ...testbed.log.reader import Content, decoding, record_of
from ...testbed.log.scene import lines_of, motion_of
from ...testbed.messages.encoding import MAP_FRAME
from ...testbed.recording import channels as ch
from ...testbed.recording.record import Record
from ...testbed.truth import WHEELS
from .. import colours
from ..errors import BadOptions, MissingExtra, OutputExists
from ..output import refuse_existing

if TYPE_CHECKING:
    import rerun

Format = Literal["csv", "parquet", "rerun"]
_NEEDS: Final = {"parquet": ("pyarrow", "export"), "rerun": ("rerun", "rerun")}  # module, extra

_POSE: Final = ("x_m", "y_m", "z_m", "qw", "qx", "qy", "qz")

TIMELINE: Final = "time"  # of a recording: simulated, from 0
_WORLD, _PLOTS, _EVENTS = "world", "plots", "events"
_PATH_RADIUS_M: Final = 0.03
_EYE_M: Final = (-7.0, 4.0, 4.0)  # of the camera from the tractor point, which it follows
_LEVELS: Final = {"info": "INFO", "warning": "WARN", "error": "ERROR"}
PATH_COLOURS: Final = {
    ch.REFERENCE_PATH_TOPIC: colours.REFERENCE,
    ch.DRIVEN_TOPIC: colours.BODY_COLOURS["tractor"],
    ch.DRIVEN_TRAILER_TOPIC: colours.BODY_COLOURS["trailer"],
    ch.PREDICTED_PATH_TOPIC: colours.PREDICTED,
    ch.PREDICTED_TRAILER_PATH_TOPIC: colours.PREDICTED,
}
"""Colours of the paths on the ground by topic."""


def _in_turn(*fields: str) -> dict[str, str]:
    return dict(zip(fields, colours.SERIES_COLOURS, strict=False))


def _points(form: str) -> dict[str, str]:
    return {form.format(body): colours.BODY_COLOURS[body] for body in ("tractor", "trailer")}


def _input(field: str) -> dict[str, str]:
    series = {
        **{"feedforward": colours.SKY, "feedback": colours.RED, "robust": colours.BLUE},
        **{"command": colours.ORANGE, "min": colours.BOUND, "max": colours.BOUND},
    }
    return {f"{field}_{part}": colour for part, colour in series.items()}


PANELS: Final[dict[str, tuple[str, ch.Channel, dict[str, str]]]] = {
    "cross": ("True cross-track error [m]", ch.ERROR, _points("{}_cross_m")),
    "error": ("True distance to the reference [m]", ch.ERROR, _points("{}_euclidean_m")),
    "front": ("Front steering [rad]", ch.CONTROL, _input("delta_t_rad")),
    "trailer": ("Trailer steering [rad]", ch.CONTROL, _input("delta_i_rad")),
    "hydrostat": ("Hydrostat [fraction]", ch.CONTROL, _input("hp")),
    "slip": ("Slip", ch.TYRES, _in_turn(*(f"{wheel}_slip" for wheel in WHEELS))),
    "estimated": (
        "Estimated error [m]",
        ch.TRACKING,
        _in_turn("x_t_e_m", "y_t_e_m", "x_i_e_m", "y_i_e_m"),
    ),
    "load": ("Load [N]", ch.TYRES, _in_turn(*(f"{wheel}_load_n" for wheel in WHEELS))),
    "speed": ("Speed [m/s]", ch.STATE, _in_turn("v_mps", "v_rim_mps")),
    "solver": ("QP", ch.SOLVER, _in_turn("iterations", "accepted", "fallback")),
    "cost": ("Cost [us]", ch.TIMING, _in_turn(*ch.TIMING.fields)),
}
"""Plots over time: title, channel, and colours of its fields; in the order of importance."""
_SHOWN: Final = 6  # plots at first sight


def export_log(content: Content, place: Path, form: Format) -> list[Path]:
    """Write a log in another format, whole or not at all, and return the files.

    Args:
        content: of the log.
        place: folder to create for tables (csv, parquet), file for a recording (rerun: .rrd).
        form: of the files.

    Raises:
        OutputExists: the place exists already or cannot be written; nothing is left behind.
        MissingExtra: a package is not installed; the message names its extra.
        BadOptions: a recording does not end in .rrd.
        LogError: the log is of another version, holds no rows, or lacks what a recording needs.
    """
    refuse_existing(place, partial_path(place))
    module, extra = _NEEDS.get(form, ("pandas", ""))
    if importlib.util.find_spec(module) is None:
        raise MissingExtra(
            f"--format {form}: needs {module}, pip install 'ttempc-proving-ground[{extra}]'"
        )
    if form == "rerun":
        _export_rerun(content, place)
        return [place]
    frames = frames_of(content)
    if not any(map(len, frames.values())):
        raise LogError(f"{content.path}: holds no rows")
    partial = partial_path(place)
    try:
        partial.mkdir(parents=True)
        for topic, frame in frames.items():
            file = partial / f"{topic.strip('/').replace('/', '_')}.{form}"
            if form == "parquet":
                frame.reset_index().to_parquet(file, index=False)
            else:
                frame.to_csv(file, na_rep="nan")  # floats as their repr, hence exact
        partial.rename(place)
    except OSError as error:
        shutil.rmtree(partial, ignore_errors=True)
        raise OutputExists(f"output folder {place}: cannot be written: {error.strerror}") from None
    return sorted(place.iterdir())


def frames_of(content: Content) -> dict[str, pandas.DataFrame]:
    """Return a data frame for each topic, with `time_s` as its index and units in the names."""
    record = record_of(content, (*ch.CHANNELS, ch.ERROR))
    frames = {topic: table.to_pandas() for topic, table in record.tables.items()}
    rows = [(event.time_s, event.level, event.text) for event in record.events]
    names = ["time_s", "level", "text"]
    frames[ch.EVENT_TOPIC] = pandas.DataFrame(rows, columns=names).set_index("time_s")
    if content.messages.get(ch.TRANSFORMS_TOPIC):
        motion = motion_of(content)
        poses = np.concatenate([motion.xyz, motion.quat], axis=2)  # (n, bodies, 7)
        names = [f"{body}_{name}" for body in motion.body_names for name in _POSE]
        index = pandas.Index(motion.time_s, name="time_s")
        values = poses.reshape(len(poses), -1)
        frames[ch.TRANSFORMS_TOPIC] = pandas.DataFrame(values, index, names)
    return frames


def _export_rerun(content: Content, file: Path) -> None:
    """Write a recording with its blueprint: the field in 3-D, plots and events.

    Rerun draws transforms, poses and paths of an MCAP log, but neither its scene nor its flat
    channels.
    """
    if file.suffix != ".rrd":
        raise BadOptions(f"--out {file}: must end in .rrd")
    import rerun as rr

    partial = partial_path(file)
    record = record_of(content, (*ch.CHANNELS, ch.ERROR))
    run = [record.metadata.get(key, "") for key in ("scenario", "controller", "seed")]
    recording = rr.RecordingStream("ttempc", recording_id="-".join(run), send_properties=False)
    try:
        recording.save(partial, default_blueprint=_blueprint(content))
        recording.send_recording_name(" · ".join(run))
        _send_scene(recording, content)
        _send_paths(recording, content)
        _send_plots(recording, record)
        recording.disconnect()
        partial.rename(file)
    except (OSError, RuntimeError) as error:
        raise OutputExists(f"{file}: cannot be written: {error}") from None
    finally:
        recording.disconnect()
        partial.unlink(missing_ok=True)


def _send_scene(recording: rerun.RecordingStream, content: Content) -> None:
    """Send ground and vehicle, and the motion of its bodies."""
    import rerun as rr

    messages = content.messages.get(ch.SCENE_TOPIC)
    if not messages:
        raise LogError(f"{content.path}: holds nothing on {ch.SCENE_TOPIC}")
    with decoding(content.path, ch.SCENE_TOPIC):
        entities = SceneUpdate.FromString(messages[0].data).entities
    recording.log(_WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for entity in entities:
        place = "ground" if entity.frame_id == MAP_FRAME else f"vehicle/{entity.frame_id}"
        _send_shapes(recording, f"{_WORLD}/{place}", entity)
    motion = motion_of(content)
    times = rr.TimeColumn(TIMELINE, duration=motion.time_s)
    for body, name in enumerate(motion.body_names):
        poses = rr.Transform3D.columns(
            translation=motion.xyz[:, body],
            quaternion=np.roll(motion.quat[:, body], -1, axis=1),  # Rerun's order is x, y, z, w
        )
        recording.send_columns(f"{_WORLD}/vehicle/{name}", [times], poses)


def _send_shapes(recording: rerun.RecordingStream, path: str, entity: SceneEntity) -> None:
    """Send the shapes of an entity of the log's scene."""
    import rerun as rr

    for number, mesh in enumerate(entity.triangles):
        painted = [_colour(each) for each in mesh.colors] or None
        recording.log(
            f"{path}/mesh{number}",
            rr.Mesh3D(
                vertex_positions=[(point.x, point.y, point.z) for point in mesh.points],
                triangle_indices=np.array(mesh.indices, np.uint32).reshape(-1, 3),
                vertex_colors=painted,
                albedo_factor=None if painted else _colour(mesh.color),
            ),
            static=True,
        )
    for name, shapes, make, keys in (
        ("boxes", entity.cubes, rr.Boxes3D, lambda size: {"sizes": size}),
        ("balls", entity.spheres, rr.Ellipsoids3D, lambda size: {"half_sizes": 0.5 * size}),
        (
            *("rods", entity.cylinders, rr.Cylinders3D),
            lambda size: {"lengths": size[:, 2], "radii": 0.5 * size[:, 0]},
        ),
    ):
        if shapes:
            size = np.array([(each.size.x, each.size.y, each.size.z) for each in shapes])
            solid: Any = {"fill_mode": rr.components.FillMode.Solid}
            recording.log(
                f"{path}/{name}", make(**keys(size), **solid, **_placed(shapes)), static=True
            )


def _placed(shapes: Any) -> dict[str, Any]:  # noqa: ANN401 - protobuf has no types
    poses = [each.pose for each in shapes]
    turns = [(p.orientation.x, p.orientation.y, p.orientation.z, p.orientation.w) for p in poses]
    return {
        "centers": [(pose.position.x, pose.position.y, pose.position.z) for pose in poses],
        "quaternions": turns,
        "colors": [_colour(each.color) for each in shapes],
    }


def _colour(colour: Any) -> tuple[int, int, int, int]:  # noqa: ANN401 - protobuf has no types
    red, green, blue, opacity = (
        round(255 * part) for part in (colour.r, colour.g, colour.b, colour.a)
    )
    return red, green, blue, opacity


def _packed(colour: str) -> int:
    """Return a colour "#RRGGBB" as Rerun's number 0xRRGGBBAA."""
    return int(f"{colour.removeprefix('#')}FF", 16)


def _send_paths(recording: rerun.RecordingStream, content: Content) -> None:
    """Send reference, driven and predicted paths."""
    import rerun as rr

    for topic, colour in PATH_COLOURS.items():
        for line in lines_of(content, topic):
            strip = rr.LineStrips3D([line.points], colors=[_packed(colour)], radii=_PATH_RADIUS_M)
            recording.set_time(TIMELINE, duration=line.time_s)
            recording.log(f"{_WORLD}{topic}", strip, static=topic == ch.REFERENCE_PATH_TOPIC)


def _send_plots(recording: rerun.RecordingStream, record: Record) -> None:
    """Send the series of all panels, and the events."""
    import rerun as rr

    for name, (_, channel, fields) in PANELS.items():
        table = record[channel]
        for field, colour in fields.items() if len(table) else ():
            path = f"{_PLOTS}/{name}/{field}"
            line = rr.SeriesLines(colors=[_packed(colour)], names=[field])
            recording.log(path, line, static=True)
            times = rr.TimeColumn(TIMELINE, duration=table.time_s)
            scalars = rr.Scalars.columns(scalars=table[field])
            recording.send_columns(path, [times], scalars)
    for event in record.events:
        recording.set_time(TIMELINE, duration=event.time_s)
        recording.log(_EVENTS, rr.TextLog(event.text, level=_LEVELS[event.level]))


def _blueprint(content: Content) -> Any:  # noqa: ANN401 - the package is optional
    """Return the layout: field and events at the left, plots at the right."""
    import rerun.blueprint as rrb

    plots = [
        rrb.TimeSeriesView(origin=f"{_PLOTS}/{name}", name=title, plot_legend=rrb.Corner2D.RightTop)
        for name, (title, _, _) in list(PANELS.items())[:_SHOWN]
    ]
    start = motion_of(content)
    tractor = start.xyz[0, start.body_names.index("tractor")]
    field = rrb.Spatial3DView(
        origin=_WORLD,
        name="Field",
        eye_controls=rrb.EyeControls3D(
            kind=rrb.Eye3DKind.Orbital,
            position=tractor + _EYE_M,
            look_target=tractor,
            eye_up=(0.0, 0.0, 1.0),
            tracking_entity=f"{_WORLD}/vehicle/tractor",
        ),
    )
    events = rrb.TextLogView(origin=_EVENTS, name="Events")
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(field, events, row_shares=[4, 1]),
            rrb.Vertical(*plots),
            column_shares=[3, 2],
        ),
        rrb.TimePanel(state=rrb.PanelState.Collapsed, timeline=TIMELINE),
    )
