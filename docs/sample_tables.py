"""Record the sample tables in configs/tables from the simulated rig `bench`: `python docs/sample_tables.py`."""

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from dpr_lab.acquisition.capture import CaptureOptions
from dpr_lab.run import Run
from dpr_lab.storage.reader import load_run
from dpr_lab.workflows.capture import capture

FOLDER = Path(__file__).parents[1] / "configs" / "tables"
LINK = "sim://?plant=bench&seed=12&clock=fast"
DURATION_S = 8.0


def record(out: Path, seconds: float = DURATION_S) -> None:
    """Write one CSV table for each pose of the sample rig: the swing from its release on."""
    with TemporaryDirectory() as folder:
        options = CaptureOptions(duration=seconds)
        captured = capture(str(FOLDER / "bench.toml"), Path(folder), options, lambda: True, url=LINK)
        for run in map(load_run, captured.files):
            (out / f"{run.pose}.csv").write_text(csv(run), encoding="utf-8", newline="\n")


def csv(run: Run) -> str:
    """Return the table of a logger of joint encoders: degrees, 0 = hanging, outer angle relative to the inner rod."""
    swing = run.t >= 0
    relative = np.column_stack([run.theta[:, 1] - np.pi, run.theta[:, 2] - run.theta[:, 1]])[swing]
    rows = zip(run.t[swing].tolist(), *np.degrees(relative).T.tolist(), strict=True)
    return "time_s,angle1_deg,angle2_deg\n" + "".join(f"{t:.3f},{q1:.2f},{q2:.2f}\n" for t, q1, q2 in rows)


if __name__ == "__main__":
    record(Path(sys.argv[1]) if len(sys.argv) > 1 else FOLDER)
