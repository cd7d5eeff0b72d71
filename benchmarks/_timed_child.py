"""Process that diagnoses or identifies recordings on request and measures its time and memory.

benchmarks/diagnosis_speed.py starts one such process for each code base, with PYTHONPATH set to its folder. The code
base may be old, so this module imports only names that every version has. It reads one JSON object per line and answers
with one JSON object per line.
"""

import contextlib
import json
import os
import resource
import sys
import time
from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numba.core import event

PLACES = {"identify": ("dpr_lab.identification.identify", "dpr_lab.identify"), "diagnose": ("dpr_lab.gap.diagnose",)}
"""Modules that have contained each function, the newest first."""


def lookup(name: str) -> Callable[..., Any]:
    """Import a function of the code base from the first module that exists."""
    for place in PLACES[name]:
        with contextlib.suppress(ModuleNotFoundError):
            if find_spec(place) is not None:
                return getattr(import_module(place), name)
    raise ModuleNotFoundError(f"none of {', '.join(PLACES[name])} is in this code base")


def recorded(folder: Path) -> tuple[list[Any], Any]:
    """Read the runs and the rig from a folder written by `diagnosis_speed.keep`."""
    from dpr_lab.rig import Rig
    from dpr_lab.run import Run

    described = json.loads((folder / "case.json").read_text(encoding="utf-8"))
    rig = Rig.model_validate(described["rig"])
    with np.load(folder / "runs.npz") as arrays:
        runs = [
            Run(
                **about, **{name: arrays[f"{name}{i}"] for name in ("t", "theta", "counts")}, rig_name="", rig_sha256=""
            )
            for i, about in enumerate(described["runs"])
        ]
    return runs, rig


def answer(job: dict[str, Any]) -> dict[str, Any]:
    """Execute one request and measure its cost."""
    runs, rig = recorded(Path(job["folder"]))
    work = lookup(job["do"])
    with event.install_recorder("numba:compile") as compiled:
        began = time.process_time()
        document = work(runs, rig, seed=job.get("seed", 0))
        cpu_s = time.process_time() - began
    result = {"cpu_s": cpu_s, "compiled": bool(compiled.buffer), "peak_mb": peak_mb()}
    if job["do"] == "diagnose":
        document = document.to_json()
        result |= {"verdict": document["verdict"], "names": sorted(effect["name"] for effect in document["effects"])}
    return result


def peak_mb() -> float:
    """Maximum memory of this process so far, MB."""
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return most / (1e6 if sys.platform == "darwin" else 1e3)


def main() -> None:
    """Answer requests until the input ends. Output of the computation goes to stderr."""
    import dpr_lab

    code = os.environ["PYTHONPATH"]
    assert Path(dpr_lab.__file__).is_relative_to(code), f"{dpr_lab.__file__} is not the code of {code}"
    out = sys.stdout
    sys.stdout = sys.stderr
    for line in sys.stdin:
        print(json.dumps(answer(json.loads(line))), file=out, flush=True)


if __name__ == "__main__":
    main()
