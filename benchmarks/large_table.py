"""Import of a large table: CPU time and memory per million rows, compared with a loop that reads the file line by line.

    python benchmarks/large_table.py [--rows 6000000] [--quick] [--json]

The text table contains time and two angles of a decaying swing. `dpr-lab import table` reads the table, checks it and
writes a run. The last result is relative to a simple loop over the same lines in this process, so that other load on
the computer has little influence.
"""

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from _bars import at_least, at_most, options, show

SECONDS = 15.0
"""Target of the import of six million rows on an idle core, CPU seconds."""
TIMES_ITS_NUMBERS = 10.0
"""Upper limit of the memory, relative to the size of the numbers in the file."""
TIMES_A_LOOP = 0.2
"""Target of the rows per second of the whole import, relative to a loop that only splits lines and converts numbers."""

CHILD = """
import json, resource, sys, time
from pathlib import Path
from dpr_lab.workflows.import_table import ImportRequest, import_table
from dpr_lab.storage.tables.options import ImportOptions
def imported(name):
    folder = Path(sys.argv[1])
    import_table(ImportRequest(folder / name, "paper", folder / "runs", ImportOptions(keep_rest=True)))
imported("short.csv")  # loads the libraries
before, began = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
imported("long.csv")
grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
print(json.dumps([time.process_time() - began, 1024 * grown]))
"""


def write_table(file: Path, rows: int) -> None:
    """Write a table of a decaying swing of both rods, with the noise of an encoder."""
    rng = np.random.default_rng(0)
    with file.open("w", encoding="utf-8") as text:
        text.write("t,theta1,theta2\n")
        for start in range(0, rows, 100_000):
            t = np.arange(start, min(start + 100_000, rows)) / 10_000
            phase = 2 * np.pi * np.array([[0.8], [1.1]]) * t + [[0.0], [0.3]]
            swing = np.exp(-t / 300) * np.array([[1.2], [1.0]]) * np.cos(phase)
            theta = np.pi + swing + rng.normal(size=swing.shape) * 2e-4
            rows_of = zip(t.tolist(), *theta.tolist(), strict=True)
            text.writelines(f"{a:.4f},{b:.6f},{c:.6f}\n" for a, b, c in rows_of)


def by_line(file: Path) -> float:
    """CPU seconds of a loop over the lines of a file."""
    began = time.process_time()
    columns: list[list[float]] = [[], [], []]
    with file.open(encoding="utf-8") as text:
        next(text)
        for line in text:
            for column, word in zip(columns, line.split(","), strict=True):
                column.append(float(word))
    return time.process_time() - began


def main() -> None:
    """Write a table, import it in a separate process, and print the results."""
    parser = options(__doc__)
    parser.add_argument("--rows", type=int, default=6_000_000)
    chosen = parser.parse_args()
    rows = 500_000 if chosen.quick else chosen.rows
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "long.csv"
        write_table(file, rows)
        write_table(file.with_name("short.csv"), 20_000)
        words = [sys.executable, "-c", CHILD, folder]
        done = subprocess.run(words, capture_output=True, text=True, check=True)
        seconds, grown = map(float, done.stdout.strip("[]\n").split(","))
        loop = by_line(file)
    bars = [
        at_most("import, s of the processor for 6 million rows", seconds * 6e6 / rows, SECONDS),
        at_most("memory over that of the numbers in the file", grown / (rows * 3 * 8), TIMES_ITS_NUMBERS),
        at_least("speed over that of a loop over lines", loop / seconds, TIMES_A_LOOP),
    ]
    show(f"a table of {rows:,} rows", bars, chosen.json, seconds=seconds)


if __name__ == "__main__":
    main()
