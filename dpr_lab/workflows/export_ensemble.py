"""Export of models sampled from the posterior of a diagnosis or a model."""

from collections import Counter
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dpr_lab.errors import RunError, refuse_unknown
from dpr_lab.gap.result import RECORD
from dpr_lab.workflows.checks import check_folder_writable
from dpr_lab.workflows.events import OnEvent, ignore
from dpr_lab.workflows.reading import read_runs

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from dpr_lab.exports.ensemble.amplitudes import FittedAmplitudes
    from dpr_lab.exports.ensemble.bands import PredictiveBand
    from dpr_lab.gap.result.diagnosis import Diagnosis
    from dpr_lab.gap.result.posterior import PosteriorComponent
    from dpr_lab.identification.model import Model
    from dpr_lab.identification.moving_arm.model import AnyModel, MovingArmModel
    from dpr_lab.rig import Rig
    from dpr_lab.run import Run


@dataclass(frozen=True, slots=True)
class BandCoverage:
    """Coverage of one recording by the predictive band of an ensemble."""

    run: str
    covered: float
    """Share of the readings inside the band."""
    until_s: float
    """Predictability horizon of the recording, s since the release."""
    width_rad: float
    """Mean width of the band, rad."""
    delay_s: float
    """Time from the first reading to the start of the band, s. The model does not follow the readings in this
    interval."""
    beyond: float | None
    """Share of the compared part with amplitudes outside those of the fitted recordings; None: unknown."""


@dataclass(frozen=True, slots=True)
class EnsembleResult:
    """Written files and the width of the ensemble."""

    file: Path
    folders: tuple[Path, ...]
    """Folder of each model, if formats were requested."""
    sets: dict[str, int]
    """Number of models with each combination of effects. A key joins the effects by `+`, or is `none`."""
    factor: float
    """Factor by which the standard deviations of the posterior were multiplied."""
    factor_of_fit: float
    """Part of `factor` that follows from leave-one-out cross-validation over the fitted recordings; 1 if files are
    missing."""
    expected_coverage: float
    """Share of the readings that a band of this number of models is expected to cover: 0.9, or less for few models."""
    bands: tuple[BandCoverage, ...]
    amplitudes_rad: tuple[float, float] | None
    """Smallest and largest amplitude of the fitted recordings, rad. At other amplitudes bands may be too narrow. None:
    unknown."""
    from_diagnosis: bool
    """Whether the posterior comes from a diagnosis and includes causes; otherwise it contains only the ratios."""
    scatter: bool
    """Whether the posterior includes the scatter between recordings. Without a diagnosis, the scatter is estimated from
    the recordings of the model."""

    def to_json(self) -> dict[str, Any]:
        """Return the output of `dpr-lab export --ensemble --json`."""
        return {"schema": 1, **asdict(self)}


def export_ensemble(
    model_path: Path,
    rig_name: str,
    size: int,
    seed: int,
    formats: "Sequence[str]",
    out: Path,
    check: "Sequence[Path]" = (),
    torque: str | None = None,
    on_event: OnEvent = ignore,
) -> EnsembleResult:
    """Write models sampled from the posterior of parameters and causes.

    Args:
        model_path: model written by `identify` or `diagnose`, or the folder of a diagnosis
        rig_name: rig file, or the name of a built-in one
        size: number of models
        seed: seed of the random models
        formats: formats in which each model is written, in addition to the JSON file
        out: folder of the files
        check: runs that calibrate the width of the ensemble: the predictive bands must cover their readings
        torque: `measured` or `commanded`: torques to use for runs that contain both; None: measured
        on_event: receives `RunRead`

    Raises:
        ConfigError: the rig is not valid, or a format is unknown.
        RunError: the model, its diagnosis or a run cannot be used.
        DprError: a file cannot be written.
    """
    from dpr_lab.exports import FORMATS
    from dpr_lab.exports.ensemble.bands import level_of
    from dpr_lab.exports.ensemble.calibrate import calibrated, widened
    from dpr_lab.exports.ensemble.left_out import factor_without
    from dpr_lab.exports.ensemble.sampled import ensemble_posterior
    from dpr_lab.exports.ensemble.scatter import scatter_of_ratios
    from dpr_lab.identification.moving_arm.model import MovingArmModel
    from dpr_lab.report.saving import write_export, write_json
    from dpr_lab.rig import load_rig
    from dpr_lab.workflows.export import model_to_export, warn_of_one_rod

    refuse_unknown(formats, FORMATS, "format")
    check_folder_writable(out)
    rig = load_rig(rig_name)
    model = model_to_export(model_path, rig)
    warn_of_one_rod(model, rig, on_event)
    diagnosis = _diagnosis_of(model, (model_path if model_path.is_dir() else model_path.parent) / RECORD)
    runs = read_runs(check, rig, on_event, torque=torque, moving=isinstance(model, MovingArmModel))
    scatter, factor_of_fit = None, 1.0
    if isinstance(model, MovingArmModel):
        ensemble = _of_arm(model, diagnosis, rig, seed)
    else:
        fitted = _fitted_runs(model, rig)
        if diagnosis is None and fitted:
            scatter = scatter_of_ratios(model, fitted, rig)
        posterior = ensemble_posterior(model, diagnosis, scatter)
        factor_of_fit = factor_without(model, posterior, fitted, rig, seed)
        ensemble = _of_rods(model, widened(posterior, factor_of_fit), fitted, rig, seed)
    factor = calibrated(ensemble.drawn, ensemble.band, runs) if runs else 1.0
    models = ensemble.drawn(factor, size)
    folders = []
    for number, member in enumerate(models if formats else ()):
        folder = out / f"{number:03}"
        for name in formats:
            write_export(FORMATS[name], member, rig, folder, FORMATS[name].lost(member, rig))
        folders.append(folder)
    range_rad = ensemble.amplitudes and (ensemble.amplitudes.low, ensemble.amplitudes.high)
    factor *= factor_of_fit
    file, coverage = out / "ensemble.json", level_of(size)
    document = {
        "schema": 1,
        "rig": rig.name,
        "L1_m": rig.L1,
        "g_m_per_s2": rig.g,
        "seed": seed,
        "widened": factor,
        "expected_coverage": coverage,
        "amplitudes_rad": range_rad,
        "models": [_member(model, rig) for model in models],
    }
    write_json(document, file)
    bands = [(ensemble.band(models, run), run) for run in runs]
    covered = tuple(
        BandCoverage(band.run, band.covered, band.horizon_s, band.width_rad, band.delay_s, ensemble.beyond(band, run))
        for band, run in bands
    )
    return EnsembleResult(
        file,
        tuple(folders),
        dict(Counter("+".join(model.effects) or "none" for model in models)),
        factor,
        factor_of_fit,
        coverage,
        covered,
        range_rad,
        from_diagnosis=diagnosis is not None,
        scatter=diagnosis is not None or scatter is not None,
    )


def _diagnosis_of(model: "AnyModel", record: Path) -> "Diagnosis | None":
    """Return the diagnosis that contains the model.

    The result is None if the file of the diagnosis does not exist, or if the model is from another fit. A corrected
    model has the same number of segments and the same chi-square as its diagnosis.
    """
    from dpr_lab.gap.result.diagnosis import load_diagnosis

    diagnosis = load_diagnosis(record) if record.is_file() else None
    if diagnosis and (diagnosis.segments, diagnosis.chi2_per_dof) != (model.fit.segments, model.fit.chi2_per_dof):
        return None
    return diagnosis


@dataclass(frozen=True, slots=True)
class _Ensemble:
    """Functions that draw the models of an ensemble and compare them with a recording."""

    drawn: "Callable[[float, int], Sequence[Any]]"
    """Function that returns random models, for a given factor on the posterior's standard deviations and number of
    models."""
    band: "Callable[[Sequence[Any], Run], PredictiveBand]"
    """Function that returns the predictive band of models for a recording."""
    amplitudes: "FittedAmplitudes | None" = None
    """Amplitudes of the fitted recordings; None if they are unknown."""
    beyond: "Callable[[PredictiveBand, Run], float | None]" = lambda band, run: None
    """Function that returns the share of the compared part of a recording in which the amplitudes are outside
    `amplitudes`."""


def _of_rods(
    model: "Model", posterior: "list[PosteriorComponent]", fitted: "Sequence[Run]", rig: "Rig", seed: int
) -> _Ensemble:
    """Return the ensemble of models with a clamped arm."""
    from dpr_lab.exports.ensemble.amplitudes import beyond_fitted, fitted_amplitudes
    from dpr_lab.exports.ensemble.bands import predictive_band
    from dpr_lab.exports.ensemble.calibrate import widened
    from dpr_lab.exports.ensemble.sampled import sampled_models

    amplitudes = fitted_amplitudes(model, fitted, rig)
    return _Ensemble(
        lambda factor, count: sampled_models(model, widened(posterior, factor), count, seed),
        lambda members, run: predictive_band(model, members, run, rig, seed),
        amplitudes,
        lambda band, run: amplitudes and beyond_fitted(amplitudes, band, model, run, rig),
    )


def _of_arm(model: "MovingArmModel", diagnosis: "Diagnosis | None", rig: "Rig", seed: int) -> _Ensemble:
    """Return the ensemble of models with a moving arm."""
    from dpr_lab.exports.ensemble.bands import predictive_arm_band
    from dpr_lab.exports.ensemble.calibrate import widened
    from dpr_lab.exports.ensemble.sampled import diagnosed_posterior, sampled_arm_models, widened_model

    posterior = diagnosed_posterior(diagnosis) if diagnosis is not None else []
    return _Ensemble(
        lambda factor, count: sampled_arm_models(
            widened_model(model, factor), widened(posterior, factor), rig, count, seed
        ),
        lambda members, run: predictive_arm_band(members, run, rig, seed),
    )


def _fitted_runs(model: "Model", rig: "Rig") -> "list[Run]":
    """Return the fitted recordings; a single long one is cut into pieces.

    The list is empty if one of the files was moved or replaced.
    """
    from dpr_lab.gap.screen.pieces import in_pieces

    files = [Path(used.file) for used in model.runs]
    if not files or not all(file.is_file() for file in files):
        return []
    try:
        runs = read_runs(files, rig, ignore, torque=model.runs[0].torque_kind or None, moving=False)
    except RunError:
        return []
    if [run.sha256 for run in runs] != [used.sha256 for used in model.runs]:
        return []
    return list(in_pieces(runs, ())[0]) if model.search.algorithm == "diagnosis" else runs


def _member(model: "AnyModel", rig: "Rig") -> dict[str, Any]:
    """Return the entry of a model in `ensemble.json`."""
    from dpr_lab.exports.bodies import bodies, in_words
    from dpr_lab.exports.module_parts import base_of
    from dpr_lab.identification.model import Model

    base = model.sizes
    if isinstance(model, Model) and model.fitted:
        a, _, _, e1, _, c1, _ = base_of(model)
        base = {"a": a, "e1": e1, "c1": c1}
    made = bodies(model, rig, in_words(model, rig, frozenset({"offset", "added_length", "tilt"})))
    rods = [
        {"length_m": rod.length, "mass_kg": rod.mass, "centroid_m": rod.centroid, "inertia_kgm2": rod.inertia}
        for rod in made.rods
    ]
    ratios = {name: estimate.value for name, estimate in model.ratios.items()}
    return {"ratios": ratios, "base": base, "rods": rods, "effects": model.effects}
