"""Write results as JSON files."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from dpr_lab.report.plain import as_json
from dpr_lab.whole_file import write_text


def write_json(result: Mapping[str, Any], path: Path) -> None:
    """Write a JSON object atomically.

    Raises:
        DprError: the folder or the file cannot be written.
    """
    write_text(path, as_json(result) + "\n")
