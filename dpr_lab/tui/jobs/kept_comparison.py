"""Stored comparisons, which need not be simulated again for display."""

import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dpr_lab.whole_file import write_whole

if TYPE_CHECKING:
    from dpr_lab.identification.compare import Comparison


@dataclass(frozen=True, slots=True)
class KeptComparison:
    """A file of arrays, and the inputs they belong to."""

    file: Path
    subject: str
    """Current model and runs: stored comparisons of others are ignored."""

    def save(self, comparisons: "Sequence[Comparison]") -> None:
        """Save the comparisons in one file, atomically.

        Raises:
            DprError: they cannot be written.
        """
        arrays: dict[str, Any] = {
            f"{number}.{field.name}": np.array("" if (value := getattr(comparison, field.name)) is None else value)
            for number, comparison in enumerate(comparisons)
            for field in fields(comparison)
        }

        def write(fresh: Path) -> None:
            with fresh.open("wb") as file:
                np.savez(file, subject=np.array(self.subject), count=np.array(len(comparisons)), **arrays)

        write_whole(self.file, write)

    def load(self) -> "list[Comparison]":
        """Saved comparisons of the same subject; empty if there are none or the file has another content."""
        from dpr_lab.identification.compare import Comparison

        try:
            with np.load(self.file) as arrays:
                if str(arrays["subject"]) != self.subject:
                    return []
                rows = [
                    {field.name: arrays[f"{number}.{field.name}"] for field in fields(Comparison)}
                    for number in range(int(arrays["count"]))
                ]
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return []
        return [_comparison(row) for row in rows]


def _comparison(values: dict[str, Any]) -> "Comparison":
    from dpr_lab.identification.compare import Comparison

    plain: dict[str, Any] = {name: value.item() if value.ndim == 0 else value for name, value in values.items()}
    plain["pose"] = plain["pose"] or None
    return Comparison(**plain)
