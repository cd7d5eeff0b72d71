"""`dpr-lab demo`: the main job from cable to curve, on a simulated rig."""

import json
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dpr_lab.cli.console import emit, json_mode, say, table
from dpr_lab.errors import DprError

if TYPE_CHECKING:
    from dpr_lab.model import Model

PLANT = "paper"


def demo(
    out: Annotated[Path, typer.Option(help="Folder of runs, model and report.")] = Path("out/demo"),
    seed: Annotated[
        int, typer.Option(help="Of the plant's noise, of the hand that places the rods, of the search.")
    ] = 1,
    realtime: Annotated[bool, typer.Option("--realtime", help="Let the device take its ten seconds a swing.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")] = False,
) -> None:
    """Record a simulated double pendulum through the real protocol, identify it, compare, draw.

    The simulated device is another process with a plant of its own; its true values are asked for only when
    everything else is done.

    Example: dpr-lab demo --out out/demo
    """
    json_mode(as_json)
    from dpr_lab.capture import CaptureOptions
    from dpr_lab.cli.capture import record
    from dpr_lab.cli.identify import search_with_progress, show
    from dpr_lab.compare import compare_run
    from dpr_lab.report.figures import save_figures
    from dpr_lab.report.html import write_report
    from dpr_lab.rig import load_rig
    from dpr_lab.storage.reader import load_run

    rig = load_rig("paper")
    url = f"sim://?plant={PLANT}&seed={seed}&clock={'realtime' if realtime else 'fast'}"
    say("1/4 capture: three releases of a simulated rig, over its serial protocol")
    captured, _ = record(url, rig, list(rig.poses), CaptureOptions(), out / "runs", ask=False)
    runs = [load_run(run.run_file, rig=rig) for run in captured]
    say("2/4 identify: improved genetic algorithm, then segment least squares")
    model = search_with_progress(runs, rig, seed=seed)
    model.save(out / "model.json")
    say("3/4 compare: measured and simulated curves")
    comparisons = [compare_run(run, rig, model) for run in runs]
    report = write_report(model, comparisons, out, save_figures(model, comparisons, out))
    say("4/4 open the seal: what the plant really is")
    truth = _reveal(seed)
    rows = _beside(model, truth)
    if as_json:
        emit(
            {
                "runs": [str(run.run_file) for run in captured],
                "model": str(out / "model.json"),
                "report": str(report),
                "ratios": {name: estimate.model_dump() for name, estimate in model.ratios.items()},
                "plant": truth["ratios"],
                "deviations_std": {name: row[-1] for name, row in rows.items()},
            }
        )
        return
    show(model)
    table(
        "Five ratios: identified, and the plant's own",
        ("ratio", "identified", "std", "plant", "deviation, std"),
        [(name, f"{v:.7g}", f"{s:.2g}", f"{p:.7g}", f"{z:+.2f}") for name, (v, s, p, z) in rows.items()],
    )
    print(f"report: {report}")


def _reveal(seed: int) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-m", "sim_device", "--plant", PLANT, "--seed", str(seed), "--reveal"],
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise DprError(f"the simulated device did not reveal its plant: {done.stderr.strip()}")
    return json.loads(done.stdout)


def _beside(model: "Model", truth: dict[str, Any]) -> dict[str, tuple[float, float, float, float]]:
    return {
        name: (found.value, found.std, truth["ratios"][name], (found.value - truth["ratios"][name]) / found.std)
        for name, found in model.ratios.items()
    }
