"""Writes docs/schemas: the JSON Schemas of the results, generated from their types."""

import json
from pathlib import Path

from dpr_lab.report.schemas import SCHEMAS, schema

FOLDER = Path(__file__).with_name("schemas")


def files() -> dict[str, str]:
    """Name of each file -> its text."""
    return {f"{name}.json": json.dumps(schema(name), indent=1, ensure_ascii=False) + "\n" for name in SCHEMAS}


if __name__ == "__main__":
    FOLDER.mkdir(exist_ok=True)
    for name, text in files().items():
        (FOLDER / name).write_text(text, encoding="utf-8")
