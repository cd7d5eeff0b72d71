"""Create a layout for Foxglove (JSON), which is opened with "Import from file".

Source: layouts that Foxglove exports; message paths, https://docs.foxglove.dev/docs/visualization/message-path-syntax.
"""

import json
from typing import Any

from dpr_lab.storage.viewers.curves import COLORS, PLOTS, TEXTS


def foxglove() -> str:
    """Create a Foxglove layout as JSON, with plots and the events below them."""
    panels = {f"Plot!{number}": _plot(title, curves) for number, (title, curves) in enumerate(PLOTS.items(), 1)}
    panels["RawMessages!events"] = {"topicPath": TEXTS, "diffEnabled": False}
    document = {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": _column(list(panels)),
    }
    return json.dumps(document, indent=1) + "\n"


def _plot(title: str, curves: tuple[tuple[str, str, int | None], ...]) -> dict[str, Any]:
    paths = [
        {
            "value": f"{topic}.{key}" + ("" if element is None else f"[{element}]"),
            "enabled": True,
            "timestampMethod": "receiveTime",
            "color": COLORS[number],
        }
        for number, (topic, key, element) in enumerate(curves)
    ]
    return {"foxglovePanelTitle": title, "paths": paths, "xAxisVal": "timestamp", "isSynced": True, "showLegend": True}


def _column(panels: list[str]) -> Any:
    """Arrange panels of equal height one below the other."""
    first, *rest = panels
    if not rest:
        return first
    share = round(100 / len(panels), 2)
    return {"direction": "column", "first": first, "second": _column(rest), "splitPercentage": share}
