"""Single forecasts of a decision, stored in a CSV file that later runs extend."""

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, fields
from itertools import groupby
from pathlib import Path

from dpr_lab import __version__
from dpr_lab.trials.score import Claim


@dataclass(frozen=True, slots=True)
class Forecast:
    """Forecast for a number of further releases, or the end of a plant: one row of the file."""

    plants: str
    """Type of the plants and of their releases."""
    date: str
    """Day of the computation."""
    seed: int
    recorded: int
    """Number of releases recorded before the forecast."""
    verdict: str
    """Verdict of the diagnosis of these releases."""
    plan: str
    """State of the plan."""
    further: int
    """Number of further releases; 0: the plan has no forecast."""
    probability: float | None
    true: bool | None
    """Whether these releases decided the causes."""
    version: str = __version__
    """Version of dpr-lab that made the forecast."""


COLUMNS = tuple(field.name for field in fields(Forecast))


def stored(file: Path, plants: str) -> list[Forecast]:
    """Read the forecasts of this version for one type of plants; a file that does not exist contains none."""
    if not file.exists():
        return []
    with file.open(newline="", encoding="utf-8") as lines:
        table = csv.DictReader(lines)
        if tuple(table.fieldnames or ()) != COLUMNS:
            raise SystemExit(f"{file} has other columns than {', '.join(COLUMNS)}: use another file (--file)")
        rows = [row for row in table if (row["plants"], row["version"]) == (plants, __version__)]
    return [
        Forecast(
            plants=plants,
            date=row["date"],
            seed=int(row["seed"]),
            recorded=int(row["recorded"]),
            verdict=row["verdict"],
            plan=row["plan"],
            further=int(row["further"]),
            probability=float(row["probability"]) if row["probability"] else None,
            true=row["true"] == "yes" if row["true"] else None,
        )
        for row in rows
    ]


def store(file: Path, forecasts: Iterable[Forecast]) -> None:
    """Append the forecasts of one plant in one write, so that a stopped run loses at most this plant."""
    file.parent.mkdir(parents=True, exist_ok=True)
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    if not file.exists():
        writer.writeheader()
    for forecast in forecasts:
        probability = "" if forecast.probability is None else f"{forecast.probability:.6g}"
        true = "" if forecast.true is None else "yes" if forecast.true else "no"
        writer.writerow(asdict(forecast) | {"probability": probability, "true": true})
    with file.open("a", newline="", encoding="utf-8") as lines:
        lines.write(text.getvalue())


def claims_by_plant(forecasts: Sequence[Forecast]) -> list[list[Claim]]:
    """Return the claims of each plant; a plant without a forecast has none."""
    return [
        [Claim(one.probability, one.true) for one in rows if one.probability is not None and one.true is not None]
        for _, rows in groupby(sorted(forecasts, key=lambda one: one.seed), key=lambda one: one.seed)
    ]
