"""`dpr-lab export`: models for other programs."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from dpr_lab.cli.checks import EXPORT_NAMES, Json, RigName, TorqueKind, names_in
from dpr_lab.cli.console import emit, line, say, table, text
from dpr_lab.shown import percent

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from dpr_lab.exports.into.replay import FileReplay
    from dpr_lab.workflows.export import ExportResult
    from dpr_lab.workflows.export_ensemble import EnsembleResult
    from dpr_lab.workflows.export_into import ExportedInto


def export(
    model: Annotated[
        Path, typer.Argument(help="Model written by `identify` or `diagnose`, or the folder of a diagnosis.")
    ],
    rig: RigName,
    to: Annotated[
        str | None,
        typer.Option(
            help="Formats, separated by commas: python, mjcf, urdf, sdf, fmu, fmu2. Default: mjcf,python,urdf,sdf;"
            " with --ensemble: mjcf.",
            callback=EXPORT_NAMES.check,
            autocompletion=EXPORT_NAMES.complete,
        ),
    ] = None,
    check: Annotated[
        list[Path] | None,
        typer.Option(
            help="Run to replay in each program; may be repeated. If a format cannot express an effect, the"
            " model is refitted to this run without the effect."
        ),
    ] = None,
    torque: TorqueKind = None,
    into: Annotated[
        Path | None,
        typer.Option(
            help="Your own MJCF, URDF or SDFormat file. The command writes a copy with the identified numbers."
            " See `rig from`."
        ),
    ] = None,
    joints: Annotated[
        str | None,
        typer.Option(help="With --into: names of the joints, separated by commas: inner, outer, then arm if present."),
    ] = None,
    ensemble: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=1000,
            help="Number of models to sample from the posterior. With --check, the standard deviations are"
            " increased until the bands of the models cover the run.",
        ),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="With --ensemble: seed of the random numbers. Default: 0.")
    ] = None,
    out: Annotated[Path, typer.Option(help="Folder for the files.")] = Path("export"),
    as_json: Json = False,
) -> None:
    """Export a model to MuJoCo, Python, URDF, SDFormat or FMI.

    With --check, the accuracy of the exported model is reported. With --into, the command instead writes the
    identified numbers to a copy of your own MJCF, URDF or SDFormat file and shows the difference. --check then compares
    both files on recordings. With --ensemble, the command writes models sampled from the posterior of parameters and
    causes, for domain randomisation.

    Example: dpr-lab export out/diagnosis --rig paper --to mjcf,python --check runs/x1.mcap --out export

    Example: dpr-lab export out/diagnosis --rig rig.toml --into robot.xml --out export

    Example: dpr-lab export out/diagnosis --rig paper --ensemble 50 --check runs/x1.mcap --out ensemble
    """
    if into is not None and ensemble is not None:
        raise typer.BadParameter("--into writes one file: remove the option --ensemble")
    if into is not None and to is not None:
        raise typer.BadParameter("--into keeps the format of your file: remove the option --to")
    if joints is not None and into is None:
        raise typer.BadParameter("--joints requires --into")
    if seed is not None and ensemble is None:
        raise typer.BadParameter("--seed requires --ensemble")
    if torque is not None and not check:
        raise typer.BadParameter("--torque requires --check")
    from dpr_lab.cli.listener import Listener

    runs = tuple(check or ())
    if ensemble is not None:
        from dpr_lab.workflows.export_ensemble import export_ensemble

        formats = names_in(to or "mjcf") or ()
        with Listener() as listener:
            sampled = export_ensemble(model, rig, ensemble, seed or 0, formats, out, runs, torque, listener)
        if as_json:
            emit(sampled.to_json())
        else:
            _show_ensemble(sampled, ensemble)
        return
    if into is not None:
        from dpr_lab.workflows.export_into import export_into

        with Listener() as listener:
            written = export_into(model, rig, into, out, names_in(joints) or (), runs, torque, listener)
        if as_json:
            emit(written.to_json())
        else:
            _show_into(into.name, written)
        return
    from dpr_lab.workflows.export import export as export_model

    formats = tuple(dict.fromkeys(names_in(to or "mjcf,python,urdf,sdf") or ()))
    with Listener() as listener:
        done = export_model(model, rig, formats, out, runs, torque, listener)
    if as_json:
        emit(done.to_json())
    else:
        _show(done)
    if done.refused:
        raise typer.Exit(1)


def _show_ensemble(done: "EnsembleResult", size: int) -> None:
    from dpr_lab.report.words import in_words

    rows = [(in_words(effects.replace("+", ", ")), count) for effects, count in done.sets.items()]
    table(f"{size} models", ("effects", "models"), rows)
    if done.bands:
        _show_bands(done)
    for sentence in _limits(done, size):
        line(sentence)
    say(f"ensemble: {done.file}")
    if done.folders:
        say(f"files: {done.folders[0]} to {done.folders[-1].name}")


def _show_bands(done: "EnsembleResult") -> None:
    columns = ("run", "readings in the band", "until, s", "mean width, mrad", "beyond the fitted amplitudes")
    rows = [
        (
            band.run,
            percent(band.covered),
            f"{band.until_s:.3g}",
            f"{1e3 * band.width_rad:.3g}",
            "unknown" if band.beyond is None else percent(band.beyond),
        )
        for band in done.bands
    ]
    note = (
        f"Standard deviations are multiplied by {done.factor:.3g} in total. With this factor, 90 % bands of many"
        " models cover these runs."
    )
    table("Predictive bands", columns, rows, note=note)
    for band in done.bands:
        if band.delay_s > 0:
            line(
                f"{band.run}: the first {band.delay_s:.2g} s are excluded. The model fits them far worse than"
                " the later readings, so a hand may still have moved the rods."
            )


def _limits(done: "EnsembleResult", size: int) -> "Iterator[str]":
    """Yield sentences about the limits of an ensemble of `size` models: uncertainty, amplitudes and coverage."""
    from dpr_lab.exports.ensemble.bands import BANDS, fewest_models

    if done.factor_of_fit > 1:
        yield (
            f"Standard deviations are multiplied by {done.factor_of_fit:.3g}. With this factor, the 90 % bands"
            " predicted from the other recordings cover each fitted recording (cross-validation)."
        )
    if done.amplitudes_rad is not None:
        low, high = (math.degrees(amplitude) for amplitude in done.amplitudes_rad)
        yield (
            f"The fitted recordings have amplitudes of {low:.3g} to {high:.3g} degrees. Outside this range the"
            " models extrapolate, and the bands may be too narrow."
        )
    if done.expected_coverage < BANDS.level:
        yield (
            f"The bands of {size} models contain on average {percent(done.expected_coverage)} of the readings of"
            f" another recording. For bands that contain {percent(BANDS.level)}, sample {fewest_models()} models"
            " or more."
        )
    if not (done.from_diagnosis or done.bands):
        needs = "which requires a clamped arm and the recordings at their stored paths"
        scatter = "" if done.scatter else f" and not the scatter between recordings, {needs}"
        yield (
            "No diagnosis of this model is stored next to it. Therefore the ensemble does not contain other possible"
            f" causes{scatter}, and its bands may be too narrow. Give the folder of a diagnosis, or --check RUN to"
            " widen"
            " the bands."
        )


def _show_into(name: str, done: "ExportedInto") -> None:
    from dpr_lab.report.words import in_words

    rows = [(change.element, change.attribute, change.before or "none", change.after) for change in done.changes]
    if rows:
        table(f"Changed in {name}", ("element", "attribute", "before", "after"), rows)
        text(done.diff.rstrip())
    else:
        line(f"{name} already has the numbers of the model")
    for effect, reason in done.lost.items():
        line(f"not in the file: {in_words(effect)}: {reason}")
    for effect in done.passive:
        line(f"not in the file, but in {done.passive_file}: {in_words(effect)}")
    show_replays(name, done.replays)
    line(f"model: {done.file}")
    line(f"difference: {done.diff_file}")
    if done.passive_file:
        line(f"passive forces for MuJoCo, which {done.file.name} needs: {done.passive_file}")


def show_replays(name: str, replays: "Sequence[FileReplay]") -> None:
    """Print the free-run errors of the user's file before and after the change, for each recording."""
    if replays:
        kinds = {"before": "before_rad", "after": "after_rad"}
        kinds |= {} if replays[0].passive_rad is None else {"with passive forces": "passive_rad"}
        kinds |= {"dpr-lab": "lab_rad"}
        columns = ("run", "until, s", *(f"{name}, mrad" for name in kinds))
        rows = [
            (replay.run, f"{replay.until_s:.3g}", *(f"{1e3 * getattr(replay, kind):.3g}" for kind in kinds.values()))
            for replay in replays
        ]
        note = (
            "Errors of free runs, or of segments of 1 s if the arm moves. The error after the change can exceed"
            " that of dpr-lab for three reasons: the file cannot contain an effect, the simulator softens"
            " Coulomb friction, or numbers that differ by less than 1 % were kept."
        )
        table(f"Replayed with the numbers of {name}", columns, rows, note=note)


def _show(done: "ExportResult") -> None:
    from dpr_lab.report.digits import superscripts
    from dpr_lab.report.words import in_words

    if done.lab is not None and done.bare_rad is not None:
        replayed = {"dpr-lab's own simulation": done.lab, **done.tried}
        errors = [(name, replay.off_rad, percent(replay.closed)) for name, replay in replayed.items()]
        errors.append(("bare model", done.bare_rad, percent(0.0)))
        rows = [[name, f"{1e3 * rms:.3g}", closed if done.has_effects else "–"] for name, rms, closed in errors]
        runs = ", ".join(done.lab.by_run)
        driven = "".join(f", {kind} torques" for kind in done.torques)
        table(f"Replayed: {runs}{driven}", ["simulation", "error, mrad", "gap closed"], rows)
    for name, reasons in done.lost.items():
        for effect, reason in reasons.items():
            line(f"{name}: without {in_words(effect)}: {reason}")
        if name in done.instead:
            line(f"{name}: refitted with {in_words(', '.join(done.instead[name])) or 'no effect'} instead")
    line(superscripts(done.scale_sentence))
    for sentence in done.refused.values():
        say(sentence)
    for name, path in done.files.items():
        say(f"{name}: {path}")
