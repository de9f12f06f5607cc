"""Shipped PlotJuggler layout: its curves exist in a log, and its tree is whole."""

from xml.etree import ElementTree

from proving_ground.experiments.logs.panels import PANELS
from proving_ground.experiments.logs.plotjuggler_layout import FILE, layout_text
from proving_ground.testbed.recording.channels import CHANNELS, ERROR

FIELDS = {f"{channel.topic}/{name}" for channel in (*CHANNELS, ERROR) for name in channel.fields}


def test_the_file_is_what_its_program_writes():
    assert FILE.read_text(encoding="utf-8") == layout_text(), (
        "run python -m experiments.logs.plotjuggler_layout"
    )


def test_every_curve_exists_in_a_log_and_every_plot_has_one():
    root = ElementTree.fromstring(FILE.read_text(encoding="utf-8"))
    plots = root.findall(".//plot")
    assert len(plots) == len(PANELS)
    for plot in plots:
        curves = [curve.attrib["name"] for curve in plot.findall("curve")]
        assert curves
        assert set(curves) <= FIELDS


def test_the_sizes_of_a_splitter_are_those_of_its_parts():
    root = ElementTree.fromstring(FILE.read_text(encoding="utf-8"))
    for splitter in root.iter("DockSplitter"):
        sizes = [float(size) for size in splitter.attrib["sizes"].split(";")]
        assert len(sizes) == len(splitter) == int(splitter.attrib["count"])
        assert abs(sum(sizes) - 1.0) < 1e-5
