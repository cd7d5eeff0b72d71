"""Storage of comparisons on disk, so that they can be displayed without another simulation."""

import json
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from dpr_lab.whole_file import write_whole

if TYPE_CHECKING:
    from dpr_lab.identification.moving_arm.identify import AnyComparison


@dataclass(frozen=True, slots=True)
class KeptComparison:
    """File with comparisons and a description of their inputs."""

    file: Path
    subject: str
    """Description of the current model and runs. Stored comparisons of other inputs are ignored."""

    def save(self, comparisons: "Sequence[AnyComparison]") -> None:
        """Save the comparisons in one file, atomically.

        Raises:
            DprError: they cannot be written.
        """
        arrays: dict[str, Any] = {
            f"{number}.{field.name}": _array(getattr(comparison, field.name))
            for number, comparison in enumerate(comparisons)
            for field in fields(comparison)
        }

        def write(fresh: Path) -> None:
            with fresh.open("wb") as file:
                np.savez(file, subject=np.array(self.subject), count=np.array(len(comparisons)), **arrays)

        write_whole(self.file, write)

    def load(self) -> "Sequence[AnyComparison]":
        """Return the stored comparisons for the same inputs.

        The list is empty if none are stored or the file is invalid.
        """
        from dpr_lab.identification.compare import Comparison
        from dpr_lab.identification.moving_arm.identify import ArmComparison

        try:
            with np.load(self.file) as arrays:
                if str(arrays["subject"]) != self.subject:
                    return []
                kind = ArmComparison if "0.rms_rad" in arrays else Comparison
                rows = [
                    {field.name: _plain(arrays[f"{number}.{field.name}"]) for field in fields(kind)}
                    for number in range(int(arrays["count"]))
                ]
        except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile):
            return []
        return [kind(**row) for row in rows]


def _array(value: Any) -> Any:
    """Return an array unchanged; any other value of a field becomes JSON text."""
    return value if isinstance(value, np.ndarray) else np.array(json.dumps(value, default=np.generic.item))


def _plain(array: Any) -> Any:
    """Convert an array that `_array` created back to the value of a field."""
    return json.loads(str(array)) if array.dtype.kind == "U" else array
