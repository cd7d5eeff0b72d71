"""Layouts of viewers: each curve exists in a run file, and the viewers can read the files."""

import json
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from dpr_lab.storage.layout import SCHEMAS
from dpr_lab.storage.viewers import VIEWERS


def in_schema(topic: str, key: str, element: str | None) -> bool:
    kind = SCHEMAS[topic]["properties"].get(key, {}).get("type")
    return kind == "array" if element else kind in ("number", "integer")


def test_foxglove_shows_keys_of_run_files_in_panels_that_exist() -> None:
    document = json.loads(VIEWERS["foxglove"].read_bytes())
    paths = [path["value"] for panel in document["configById"].values() for path in panel.get("paths", [])]
    assert "/samples.theta[1]" in paths
    for path in paths:
        match = re.fullmatch(r"(/\w+)\.(\w+)(\[\d\])?", path)
        assert match is not None
        assert in_schema(*match.groups()), path

    def leaves(node: Any) -> list[str]:
        return [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]

    assert leaves(document["layout"]) == list(document["configById"])


def test_plotjuggler_shows_keys_of_run_files() -> None:
    root = ElementTree.fromstring(VIEWERS["plotjuggler"].read_bytes())
    names = [curve.attrib["name"] for curve in root.iter("curve")]
    assert "/samples/theta[1]" in names
    for name in names:
        match = re.fullmatch(r"(/\w+)/(\w+)(\[\d\])?", name)
        assert match is not None
        assert in_schema(*match.groups()), name
    (column,) = root.iter("DockSplitter")
    areas = list(column)
    assert int(column.attrib["count"]) == len(areas) == len(column.attrib["sizes"].split(";"))


def test_plotjuggler_finds_what_its_loader_asks_for() -> None:
    """Elements and attributes that PlotJuggler 3 reads: `PlotDocker::restoreSplitter`, `PlotWidget::xmlLoadState`."""
    root = ElementTree.fromstring(VIEWERS["plotjuggler"].read_bytes())
    (tabs,) = root.findall("tabbed_widget")
    assert tabs.get("parent") == "main_window"
    assert [child.tag for child in tabs] == ["Tab", "currentTabIndex"]
    (column,) = tabs.findall("Tab/Container/DockSplitter")
    assert column.get("orientation") in ("-", "|")
    assert sum(map(float, column.attrib["sizes"].split(";"))) == pytest.approx(1.0, abs=1e-4)
    for area in column:
        assert area.tag == "DockArea"
        (plot,) = area
        assert (plot.get("mode"), plot.get("style")) == ("TimeSeries", "Lines")
        assert {child.tag for child in plot} == {"limitY", "curve"}
        assert all(re.fullmatch("#[0-9a-f]{6}", curve.attrib["color"]) for curve in plot.iter("curve"))


def test_foxglove_finds_what_its_panels_ask_for() -> None:
    """Keys of layouts that Foxglove exports, and of the settings of its panels Plot and Raw Messages."""
    document = json.loads(VIEWERS["foxglove"].read_bytes())
    assert set(document) == {"configById", "globalVariables", "userNodes", "playbackConfig", "layout"}
    for name, panel in document["configById"].items():
        kind, _, identifier = name.partition("!")
        assert identifier
        if kind == "RawMessages":
            assert panel["topicPath"] in SCHEMAS
            continue
        assert kind == "Plot"
        assert panel["foxglovePanelTitle"]  # a panel without it has the name of its kind
        assert "title" not in panel
        assert panel["xAxisVal"] == "timestamp"
        assert {path["timestampMethod"] for path in panel["paths"]} == {"receiveTime"}

    def shares(node: Any) -> None:
        if not isinstance(node, str):
            assert node["direction"] in ("row", "column")
            assert 0 < node["splitPercentage"] < 100
            shares(node["first"])
            shares(node["second"])

    shares(document["layout"])


@pytest.mark.parametrize("viewer", VIEWERS)
def test_the_command_writes_a_layout_once(viewer: str, tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from dpr_lab.cli.app import app
    from dpr_lab.errors import RunError

    file = tmp_path / "layout"
    assert CliRunner().invoke(app, ["run", "layout", viewer, "--out", str(file)]).exit_code == 0
    assert file.read_text(encoding="utf-8") == VIEWERS[viewer].read_text(encoding="utf-8")
    assert isinstance(CliRunner().invoke(app, ["run", "layout", viewer, "--out", str(file)]).exception, RunError)
