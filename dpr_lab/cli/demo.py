"""`dpr-lab demo`: the main job from cable to curve on a simulated rig, then a blind trial of the diagnosis."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from dpr_lab.cli.console import emit, json_mode, say, table

if TYPE_CHECKING:
    from dpr_lab.gap.diagnosis import Diagnosis
    from dpr_lab.model import Model
    from dpr_lab.trials.protocol import Opened, Trial

PLANT = "paper"
SEED = 1


def demo(
    out: Annotated[
        Path, typer.Option(help="Folder of runs, model and report; each demo's trial gets a folder of its own in it.")
    ] = Path("out/demo"),
    seed: Annotated[
        int | None,
        typer.Option(min=0, help="Same seed, same demo; when left out, fresh chance draws the plant of the trial."),
    ] = None,
    realtime: Annotated[bool, typer.Option("--realtime", help="Let the device take its ten seconds a swing.")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object on stdout.")] = False,
) -> None:
    """Record, identify and compare a simulated double pendulum; then diagnose one whose effect is withheld.

    The simulated device is another process with a plant of its own; its true values are asked for only when
    everything else is done. The first demo on a computer compiles the kernels, which takes a minute or two.

    Example: dpr-lab demo --out out/demo
    """
    json_mode(as_json)
    from dpr_lab.kernels import CACHE

    if CACHE is None or not any(CACHE.rglob("*.nbi")):
        say("first run on this computer: compiling takes a minute or two, the next run does without")
    known = _known_plant(out, SEED if seed is None else seed, realtime)
    trial, model, found, opened = _withheld_effect(_unused(out), seed)
    report = trial.folder / "diagnosis" / "diagnosis.html"
    if as_json:
        emit(_record(known, trial, opened, report))
    else:
        _show(known, model, found, opened, trial, report)


def _known_plant(out: Path, seed: int, realtime: bool) -> dict[str, Any]:
    """Capture, identify, compare a plant without any effect, and ask what it is."""
    from dpr_lab.capture import CaptureOptions
    from dpr_lab.cli.capture import record
    from dpr_lab.cli.identify import search_with_progress
    from dpr_lab.compare import compare_run
    from dpr_lab.report.saving import save_comparison
    from dpr_lab.rig import load_rig
    from dpr_lab.storage.reader import load_run
    from dpr_lab.trials.sealing import ask

    rig = load_rig("paper")
    url = f"sim://?plant={PLANT}&seed={seed}&clock={'realtime' if realtime else 'fast'}"
    say("1/7 capture: three releases of a simulated rig, over its serial protocol")
    captured, _ = record(url, rig, list(rig.poses), CaptureOptions(), out / "runs", ask=False)
    runs = [load_run(run.run_file, rig=rig) for run in captured]
    say("2/7 identify: improved genetic algorithm, then segment least squares")
    model = search_with_progress(runs, rig, seed=seed)
    model.save(out / "model.json")
    say("3/7 compare: measured and simulated curves, and what the plant really is")
    saved = save_comparison(model, [compare_run(run, rig, model) for run in runs], out)
    truth = ask("--plant", PLANT, "--seed", str(seed), "--reveal")["ratios"]
    files = [str(run.run_file) for run in captured]
    return {"runs": files, "model": model, "report": saved["report"], "plant": truth, "out": out}


def _withheld_effect(folder: Path, seed: int | None) -> "tuple[Trial, Model, Diagnosis, Opened]":
    """One blind trial: sealed and recorded, identified, diagnosed, opened and scored."""
    from dpr_lab.cli.identify import search_with_progress
    from dpr_lab.cli.trials import diagnosed
    from dpr_lab.trials.protocol import draw, open_trial, recordings
    from dpr_lab.trials.sealing import Kind, Wanted

    say("4/7 another plant, with an effect that only the device knows: sealed, then recorded")
    trial = draw(Wanted(Kind.SINGLE, seed=seed), folder, say)
    say("5/7 identify it, as if it had no such effect")
    model = search_with_progress(recordings(trial), trial.rig, seed=seed or SEED)
    model.save(folder / "model.json")
    say("6/7 diagnose: where model and rig differ, and why")
    found, _ = diagnosed(trial, start=model.unknowns)
    say("7/7 open the seal, and score")
    return trial, model, found, open_trial(trial)


def _unused(out: Path) -> Path:
    """A folder for the trial: an opened one is never used again."""
    number = 1
    while (folder := out / f"trial-{number}").exists():
        number += 1
    return folder


def _record(known: dict[str, Any], trial: "Trial", opened: "Opened", report: Path) -> dict[str, Any]:
    from dpr_lab.cli.trials import opening

    model: Model = known["model"]
    return {
        "runs": known["runs"],
        "model": str(known["out"] / "model.json"),
        "report": known["report"],
        "ratios": {name: estimate.model_dump() for name, estimate in model.ratios.items()},
        "plant": known["plant"],
        "deviations_std": {name: row[-1] for name, row in _beside(model, known["plant"]).items()},
        "trial": opening(opened) | {"folder": str(trial.folder), "report": str(report)},
    }


def _show(
    known: dict[str, Any], model: "Model", found: "Diagnosis", opened: "Opened", trial: "Trial", report: Path
) -> None:
    from dpr_lab.cli.identify import show as show_model
    from dpr_lab.cli.trials import show_opened

    show_model(known["model"])
    table(
        "Five ratios: identified, and the plant's own",
        ("ratio", "identified", "std", "plant", "deviation, std"),
        [
            (name, f"{v:.7g}", f"{s:.2g}", f"{p:.7g}", f"{z:+.2f}")
            for name, (v, s, p, z) in _beside(known["model"], known["plant"]).items()
        ],
    )
    print(f"report: {known['report']}")
    print()
    print("A plant with a withheld effect")
    print(f"bare model: residual {model.fit.chi2_per_dof:.3g} times what the noise allows (1 is noise alone)")
    print(f"diagnosis: {found.sentence}")
    show_opened(opened, trial)
    print(f"report: {report}")


def _beside(model: "Model", truth: dict[str, float]) -> dict[str, tuple[float, float, float, float]]:
    return {
        name: (found.value, found.std, truth[name], (found.value - truth[name]) / found.std)
        for name, found in model.ratios.items()
    }
