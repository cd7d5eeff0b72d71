"""Create viewer layouts for run files: angles, torques and events."""

from collections.abc import Callable

from dpr_lab.storage.viewers.foxglove import foxglove
from dpr_lab.storage.viewers.plotjuggler import plotjuggler

VIEWERS: dict[str, tuple[str, Callable[[], str]]] = {
    "foxglove": ("dpr-lab.foxglove.json", foxglove),
    "plotjuggler": ("dpr-lab.plotjuggler.xml", plotjuggler),
}
"""Default file name, and function that returns the layout, for each viewer."""
