"""Layouts of viewers for run files: angles, torques, losses and events.

Foxglove opens its layout with "Import from file". Sources: layouts saved by both programs; message paths of Foxglove,
https://docs.foxglove.dev/docs/visualization/message-path-syntax. `tests/storage/test_viewers.py` compares the curves
with the channels of a run file.
"""

from pathlib import Path

VIEWERS: dict[str, Path] = {
    name: Path(__file__).with_name(file)
    for name, file in (("foxglove", "dpr-lab.foxglove.json"), ("plotjuggler", "dpr-lab.plotjuggler.xml"))
}
"""Layout file for each viewer."""
