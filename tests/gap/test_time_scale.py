"""Time stamps that contradict gravity: videos in slow motion with an unknown frame rate."""

from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.dynamics.base import whole_parameters
from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.gap.screen.time_scale import equivalent_length, with_time_scale
from dpr_lab.identification.misread.tried import check_description
from dpr_lab.run import Run
from tests.background_rigs import law, recordings
from tests.thinned import candidates, thinned


def filmed(runs: list[Run], factor: float) -> list[Run]:
    """The runs with time stamps that are too long by a factor."""
    return [replace(run, t=factor * run.t, rate_hz=run.rate_hz / factor) for run in runs]


def findings(rig, runs):
    """Findings on the time scale of runs, after the fit of the bare model."""
    fitted, _, bare = fit_bare_model(Recordings(tuple(record(run, rig) for run in runs), rig), nominal_ratios(rig))
    judged = fitted
    for _ in range(2):  # the diagnosis fits the bare model again after a correction; the finding remains one
        judged = with_time_scale(judged, bare.fit.estimate.ratios)
    return [one for of in judged.records for one in of.screened.findings if one.name == "time_scale"]


@pytest.fixture(scope="module")
def one_rod():
    rig, runs, _ = recordings(6, [law("coulomb", 0, 5.0)], rods=1, seconds=5.0, rate_hz=240.0)
    return rig, runs


@pytest.mark.slow
@pytest.mark.parametrize("factor", thinned([4.0, 8.0], 2))
def test_slow_motion_of_one_rod_is_doubted_with_its_factor_and_the_check_that_decides(one_rod, factor):
    rig, runs = one_rod
    (finding,) = findings(rig, filmed(runs, factor))
    length = equivalent_length(whole_parameters(rig.nominal, rig.L1, rig.g), runs[0].setup, rig)
    stated = float(finding.evidence.split("time stamps are ")[1].split(" times too long")[0])
    assert stated == pytest.approx(factor, rel=0.15)  # the rig file's masses and lengths are off by up to a tenth
    assert "counterweight" in finding.evidence
    assert f"the rig file predicts {20 * np.pi * np.sqrt(length / rig.g):.3g} s" in finding.evidence


def test_a_rod_at_its_own_pace_is_not_doubted(one_rod):
    rig, runs = one_rod
    assert not findings(rig, runs)


def test_a_fall_in_one_direction_does_not_show_the_time_base(one_rod):
    """Friction that slows a fall would be named slow motion."""
    rig, runs = one_rod
    (film,) = filmed(runs[:1], 8.0)
    angle = film.swing.theta[:, 1]
    stop = len(film.t) - len(angle) + int(np.abs(angle - angle[0]).argmax())  # the first turning point
    parts = {"t": film.t[:stop], "theta": film.theta[:stop], "counts": film.counts[:stop]}
    assert not findings(rig, [replace(film, **parts)])


@pytest.mark.slow
def test_a_diagnosis_of_one_rod_lists_it_among_the_findings(one_rod):
    rig, runs = one_rod
    result = diagnose(filmed(runs[:1], 8.0), rig, library=candidates("coulomb")).sensor_findings
    assert [one.name for one in result].count("time_scale") == 1


@pytest.mark.slow
@pytest.mark.parametrize(
    ("factor", "cause"),
    [
        pytest.param(8.0, "eight times as fast", marks=pytest.mark.long),
        pytest.param(4.0, "four times as fast", marks=pytest.mark.long),
        pytest.param(0.125, "an eighth as fast", marks=pytest.mark.long),
    ],
)
def test_two_rods_determine_the_time_factor(factor, cause):
    rig, runs, _ = recordings(3, [law("coulomb", 0, 5.0)], seconds=5.0, rate_hz=240.0)
    look = check_description(filmed(runs, factor), rig)
    assert look.tried
    assert cause in look.sentence
