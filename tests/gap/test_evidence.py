from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dpr_lab.effects import EFFECTS
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.gap.evidence import exclusions as of_exclusions
from dpr_lab.gap.evidence.coverage import coverage
from dpr_lab.gap.evidence.exclusions import AllShapes, exclusions
from dpr_lab.gap.evidence.joint_friction import joint_friction
from dpr_lab.gap.evidence.residuals import residual_analysis
from dpr_lab.gap.evidence.validation import validation
from dpr_lab.gap.hypothesis.detectable import detectable
from dpr_lab.gap.hypothesis.refits import refit_with
from dpr_lab.gap.hypothesis.score_test import score_test
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.transfer import gap_size
from dpr_lab.gap.transfer.free_run import free_runs
from dpr_lab.report.gap.figures import save_gap_figures
from dpr_lab.report.gap.html import write_gap_report
from dpr_lab.report.gap.sections import SECTIONS
from tests.blank_figures import save_blank

DRY = {"coulomb_joint1": {"torque_Nm": 3e-3}}


@pytest.fixture(scope="module")
def looked_at(recorded: Callable[..., Any], screened: Callable[..., Any], bare: Callable[..., Any]) -> Any:
    """(effects) -> recordings of three seconds, their segments and the bare model."""
    known: dict[str, Any] = {}

    def made(effects: Any) -> Any:
        if (key := repr(effects)) not in known:
            runs = recorded(effects, duration=3.0)[:2]
            known[key] = screened(runs), *bare(runs)
        return known[key]

    return made


@pytest.mark.slow
def test_error_stays_within_its_uncertainty_until_something_is_missing(looked_at: Any):
    for effects, within in (({}, True), (DRY, False)):
        recordings, problem, model = looked_at(effects)
        models = {"before": model, "after": model}
        freely = {name: free_runs(recordings, at.estimate, free=at.fit.free) for name, at in models.items()}
        budget, curves = validation(recordings, problem, models, freely)

        assert (budget.error_after_rad < 2 * budget.u_after_rad) is within, budget
        squares = sum(source.after_rad**2 for source in budget.sources)
        assert np.sqrt(squares) == pytest.approx(budget.u_after_rad)
        assert all(run.until_s <= 2.6 for run in budget.runs)
        assert len(curves) == len(budget.runs) == 2


def test_a_spring_with_a_constant_torque_does_not_hide_the_friction(recorded: Any, bare: Any, tested: Any):
    problem, model = bare(recorded({}, duration=2.0)[:1])
    test = tested(problem, model.fit, [EFFECTS["spring_joint1"]])
    spring = refit_with(problem, model, test, test.best_score("spring_joint1"), iterations=1)
    alone, with_spring = (joint_friction(problem, of, back_emf=False)["joint1"] for of in (model, spring))
    assert max(with_spring.std_Nm) < 3 * max(alone.std_Nm)


@pytest.mark.slow
def test_a_model_without_effects_is_computed_once(looked_at: Any, monkeypatch: pytest.MonkeyPatch):
    recordings, problem, model = looked_at({})
    fits: list[Any] = []
    monkeypatch.setattr(gap_size, "fit", lambda *given, **settings: fits.append(given) or fit(*given, **settings))
    by_length = gap_size.by_horizon(recordings, problem, {"before": model, "after": model})
    assert len(fits) == sum(float(length) != recordings.working_length for length in by_length)
    assert all(gaps["before"] == gaps["after"] for gaps in by_length.values())


@pytest.mark.slow
def test_residuals_of_a_clean_rig_are_white_and_effects_excluded(looked_at: Any):
    recordings, problem, model = looked_at({})
    look = residual_analysis(problem, {"before": model, "after": model})
    for models in look.joints.values():
        assert abs(models["after"].autocorrelation[1]) < 0.1
        np.testing.assert_allclose(models["after"].quantiles[10:50], look.normal[10:50], atol=0.2)

    test = score_test(problem, model.fit, [EFFECTS["coulomb_joint1"], EFFECTS["rotor_inertia_joint1"]], recordings)
    (dry,) = exclusions(problem, model, test, detectable(model, test))
    assert dry.effect == "coulomb_joint1", "an effect that cannot be seen is not excluded"
    assert dry.size > abs(dry.estimate)
    assert dry.confidence > 0.95


@pytest.mark.slow
@pytest.mark.parametrize("name", ["detent_joint1", "stribeck_joint2", "base_vibration"])
def test_an_absent_effect_of_unknown_shape_has_an_interval_over_all_shapes(looked_at: Any, name: str):
    recordings, problem, model = looked_at({})
    test = score_test(problem, model.fit, [EFFECTS[name]], recordings)
    excluded = exclusions(problem, model, test, detectable(model, test))
    assert [one.parameter for one in excluded] == [p.name for p in EFFECTS[name].amplitudes]
    for one in excluded:
        assert one.interval90 is not None
        low, high = one.interval90
        assert low < one.estimate < high
        assert max(-low, high) < 6 * max(p.typical for p in EFFECTS[name].amplitudes)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "sizes"),
    [
        ("base_vibration", {"cos_m_per_s2": 0.02, "frequency_hz": 11.37}),  # between two values of the scan
        ("detent_joint1", {"sin1_Nm": 1e-4, "order": 7.0}),
    ],
)
def test_the_interval_over_all_shapes_contains_an_effect_in_its_own_shape(looked_at: Any, name: str, sizes: Any):
    _, problem, model = looked_at({name: sizes})
    intervals = AllShapes(problem, model).intervals(EFFECTS[name])
    assert intervals is not None
    for parameter, (low, high) in zip(EFFECTS[name].amplitudes, intervals, strict=True):
        assert low <= sizes.get(parameter.name, 0.0) <= high


@pytest.mark.slow
def test_interpolated_frequencies_have_the_intervals_of_computed_ones(
    recorded: Any, bare: Any, monkeypatch: pytest.MonkeyPatch
):
    problem, model = bare(recorded({}, duration=8.0)[:1])
    monkeypatch.setattr(of_exclusions, "SHAPES", of_exclusions.ShapeSettings())
    interpolated = AllShapes(problem, model).intervals(EFFECTS["base_vibration"])
    monkeypatch.setattr(of_exclusions, "SHAPES", replace(of_exclusions.SHAPES, nodes=(1e3, 0)))  # too many
    computed = AllShapes(problem, model).intervals(EFFECTS["base_vibration"])
    assert interpolated is not None
    assert computed is not None
    assert interpolated != computed
    np.testing.assert_allclose(interpolated, computed, rtol=1e-6)


@pytest.mark.slow
def test_a_vibration_is_tested_in_the_beginning_of_long_recordings(looked_at: Any, monkeypatch: pytest.MonkeyPatch):
    """All frequencies of a long recording are too many; the interval from its beginning is wider."""
    sizes = {"cos_m_per_s2": 0.02, "frequency_hz": 11.37}
    _, problem, model = looked_at({"base_vibration": sizes})
    monkeypatch.setattr(of_exclusions, "SHAPES", of_exclusions.ShapeSettings())
    whole = AllShapes(problem, model).intervals(EFFECTS["base_vibration"])
    seconds = float(problem.t.max() - problem.t.min()) / 2
    most = int(100 * seconds)  # fewer than the frequencies of the whole recording
    monkeypatch.setattr(of_exclusions, "SHAPES", replace(of_exclusions.SHAPES, longest_s=seconds, most=most))
    beginning = AllShapes(problem, model).intervals(EFFECTS["base_vibration"])
    assert whole is not None
    assert beginning is not None
    for name, (low, high), (lower, upper) in zip(("cos_m_per_s2", "sin_m_per_s2"), whole, beginning, strict=True):
        assert upper - lower > high - low
        assert lower <= sizes.get(name, 0.0) <= upper


@pytest.mark.slow
def test_the_map_of_coverage_contains_every_second(looked_at: Any):
    recordings, _, _ = looked_at({})
    maps = coverage(recordings, recordings.only(recordings.records[:1]))

    seconds = [float(record.t[-1] - record.t[0]) for record in recordings.records]
    for rod in ("inner", "outer"):
        assert np.sum(maps[rod].fitted_s) == pytest.approx(sum(seconds), rel=0.01)
        assert np.sum(maps[rod].held_out_s) == pytest.approx(seconds[0], rel=0.01)


def test_the_map_of_coverage_contains_every_second_of_a_film(looked_at: Any):
    recordings, _, _ = looked_at({})
    frames = [record.only(slice(None, None, 7)) for record in recordings.records]  # 35 ms apart
    maps = coverage(recordings.only(frames), recordings.only([]))
    seconds = sum(float(record.t[-1] - record.t[0]) for record in frames)
    for rod in ("inner", "outer"):
        assert np.sum(maps[rod].fitted_s) == pytest.approx(seconds, rel=0.01)


@pytest.mark.slow
def test_the_report_is_complete_and_loads_nothing_from_the_network(
    two_found: Diagnosis, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
):
    evidence = two_found.evidence
    assert evidence is not None
    assert evidence.closing[-1].closed == pytest.approx(two_found.gap.closed_held_out.estimate)
    free = two_found.gap.free_run_rad
    assert {run.run: run.error_after_rad for run in evidence.budget.runs} == pytest.approx(
        {name: errors["after"] for name, errors in free.items()}
    )

    monkeypatch.setattr("dpr_lab.report.figures.save_png", save_blank)
    figures = save_gap_figures(two_found, tmp_path)
    written = write_gap_report(two_found, "Rig", tmp_path, figures)
    page = written.read_text(encoding="utf-8")
    assert all(f"<h2>{section.title}</h2>" in page for section in SECTIONS)
    drawn = {section.name for section in SECTIONS if section.figure is not None} - {"trust"}  # none was asked for
    assert set(figures) == {"where", "gap_horizon", *drawn}
    assert page.count("<img") == len(figures)
    assert page.count("<details>") >= len(SECTIONS)
    assert page.count('</summary>\n</details>\n<div class="folded">') == page.count("<details>")
    assert "@media screen { details:not([open]) + .folded { display: none; } }" in page  # and nothing hides it in print
    assert "http" not in page.replace("http-equiv", "")
    assert page.index("Recommended actions") < page.index("Effects and alternatives")
