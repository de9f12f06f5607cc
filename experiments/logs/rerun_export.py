"""Export of a log to Rerun: the field in 3-D, plots and events, with a blueprint that shows all.

Rerun draws transforms, poses and paths of an MCAP log, but neither its scene nor its flat channels.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from foxglove_schemas_protobuf.SceneEntity_pb2 import SceneEntity
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate

from ttempc.types import FloatArray

from ...testbed.atomic_write import partial_path
from ...testbed.errors import LogError
from ...testbed.log.reader import Content, decoding, record_of
from ...testbed.log.scene import lines_of, motion_of
from ...testbed.messages.encoding import MAP_FRAME
from ...testbed.recording.channels import CHANNELS, ERROR, REFERENCE_PATH_TOPIC, SCENE_TOPIC
from ...testbed.recording.record import Event, Record
from ..errors import BadOptions, MissingExtra, OutputExists
from ..output import refuse_existing
from .panels import PANELS, PATH_COLOURS

if TYPE_CHECKING:
    import rerun

TIMELINE: Final = "time"  # simulated, from 0
_WORLD, _PLOTS, _EVENTS = "world", "plots", "events"
_PATH_RADIUS_M: Final = 0.03
_EYE_M: Final = (-7.0, 4.0, 4.0)  # of the camera from the tractor point, which it follows
_SHOWN: Final = ("cross", "error", "front", "trailer", "hydrostat", "slip")  # plots at first sight
_LEVELS: Final = {"info": "INFO", "warning": "WARN", "error": "ERROR"}


def export_rerun(content: Content, file: Path) -> None:
    """Write a recording for Rerun with its blueprint.

    Args:
        content: of the log.
        file: to write, ending in .rrd.

    Raises:
        MissingExtra: rerun-sdk is not installed.
        OutputExists: the file exists already or cannot be written.
        BadOptions: the file does not end in .rrd.
        LogError: the log is of another version, or lacks scene, transforms or paths.
    """
    if file.suffix != ".rrd":
        raise BadOptions(f"--out {file}: must end in .rrd")
    partial = partial_path(file)
    refuse_existing(file, partial)
    if importlib.util.find_spec("rerun") is None:
        raise MissingExtra("log rerun: needs rerun-sdk, pip install 'ttempc-proving-ground[rerun]'")
    import rerun as rr

    record = record_of(content, (*CHANNELS, ERROR))
    run = [record.metadata.get(key, "") for key in ("scenario", "controller", "seed")]
    recording = rr.RecordingStream("ttempc", recording_id="-".join(run), send_properties=False)
    try:
        recording.save(partial, default_blueprint=_blueprint(content))
        recording.send_recording_name(" · ".join(run))
        _send_scene(recording, content)
        _send_paths(recording, content)
        _send_plots(recording, record)
        _send_events(recording, record.events)
        recording.disconnect()
        partial.rename(file)
    except (OSError, RuntimeError) as error:
        partial.unlink(missing_ok=True)
        raise OutputExists(f"{file}: cannot be written: {error}") from None
    except LogError:
        recording.disconnect()
        partial.unlink(missing_ok=True)
        raise


def _send_scene(recording: rerun.RecordingStream, content: Content) -> None:
    """Send ground and vehicle, and the motion of its bodies."""
    import rerun as rr

    messages = content.messages.get(SCENE_TOPIC)
    if not messages:
        raise LogError(f"{content.path}: holds nothing on {SCENE_TOPIC}")
    with decoding(content.path, SCENE_TOPIC):
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
        colours = [_colour(each) for each in mesh.colors] or None
        recording.log(
            f"{path}/mesh{number}",
            rr.Mesh3D(
                vertex_positions=[(point.x, point.y, point.z) for point in mesh.points],
                triangle_indices=np.array(mesh.indices, np.uint32).reshape(-1, 3),
                vertex_colors=colours,
                albedo_factor=None if colours else _colour(mesh.color),
            ),
            static=True,
        )
    solid = rr.components.FillMode.Solid
    if entity.cubes:
        boxes = rr.Boxes3D(sizes=_sizes(entity.cubes), fill_mode=solid, **_placed(entity.cubes))
        recording.log(f"{path}/boxes", boxes, static=True)
    if entity.spheres:
        radii = 0.5 * _sizes(entity.spheres)
        balls = rr.Ellipsoids3D(half_sizes=radii, fill_mode=solid, **_placed(entity.spheres))
        recording.log(f"{path}/balls", balls, static=True)
    if entity.cylinders:
        sizes = _sizes(entity.cylinders)
        rods = rr.Cylinders3D(
            lengths=sizes[:, 2],
            radii=0.5 * sizes[:, 0],
            fill_mode=solid,
            **_placed(entity.cylinders),
        )
        recording.log(f"{path}/rods", rods, static=True)


def _sizes(shapes: Any) -> FloatArray:  # noqa: ANN401 - protobuf has no types
    return np.array([(each.size.x, each.size.y, each.size.z) for each in shapes])


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
            recording.log(f"{_WORLD}{topic}", strip, static=topic == REFERENCE_PATH_TOPIC)


def _send_plots(recording: rerun.RecordingStream, record: Record) -> None:
    """Send the series of all panels."""
    import rerun as rr

    for panel in PANELS:
        for series in panel.series:
            table = record[series.channel]
            if not len(table):
                continue
            path = f"{_PLOTS}/{panel.name}/{series.field}"
            line = rr.SeriesLines(colors=[_packed(series.colour)], names=[series.field])
            recording.log(path, line, static=True)
            times = rr.TimeColumn(TIMELINE, duration=table.time_s)
            scalars = rr.Scalars.columns(scalars=table[series.field])
            recording.send_columns(path, [times], scalars)


def _send_events(recording: rerun.RecordingStream, events: Sequence[Event]) -> None:
    import rerun as rr

    for event in events:
        recording.set_time(TIMELINE, duration=event.time_s)
        recording.log(_EVENTS, rr.TextLog(event.text, level=_LEVELS[event.level]))


def _blueprint(content: Content) -> Any:  # noqa: ANN401 - the package is optional
    """Return the layout: field and events at the left, plots at the right."""
    import rerun.blueprint as rrb

    titles = {panel.name: panel.title for panel in PANELS}
    plots = [
        rrb.TimeSeriesView(
            origin=f"{_PLOTS}/{name}", name=titles[name], plot_legend=rrb.Corner2D.RightTop
        )
        for name in _SHOWN
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
        rrb.SelectionPanel(state=rrb.PanelState.Hidden),
        rrb.BlueprintPanel(state=rrb.PanelState.Hidden),
    )
