"""Encoders that are zeroed before each recording: identification and comparison with zeros of each run."""

from dataclasses import replace

import numpy as np
import pytest

from dpr_lab.dynamics.base import base_parameters, ratios
from dpr_lab.gap.bare_model import nominal_ratios
from dpr_lab.identification.compare import _continued, compare_run
from dpr_lab.identification.identify import identify
from dpr_lab.identification.preprocess import preprocess
from dpr_lab.identification.ratio_fit import rods_estimate, segmented
from dpr_lab.rig import Rig
from dpr_lab.run import Run
from dpr_lab.search import load_search
from sim_device.plant.config import load_plant

ZEROS = np.array([[0.03, -0.05], [-0.02, 0.01], [0.01, 0.04]])
"""Of joint 1 and of the relative joint 2, rad."""


def read_with(zeros: np.ndarray, run: Run) -> Run:
    return replace(run, theta=run.theta + np.array([0.0, zeros[0], zeros.sum()]), counts=None)


@pytest.mark.slow
def test_runs_with_zeros_of_their_own_are_identified_and_compared(recorded, paper: Rig) -> None:
    rezeroed = paper.model_copy(update={"encoders": paper.encoders.model_copy(update={"rezeroed": True})})
    runs = [read_with(zeros, run) for zeros, run in zip(ZEROS, recorded({}, duration=2.0), strict=True)]
    settings = load_search("segments").model_copy(update={"generations": 2})
    model = identify(runs[:2], rezeroed, settings=settings)
    truth = ratios(base_parameters(load_plant("paper").Z, paper.L1, paper.g))
    result = np.array([[entry.value, entry.std] for entry in model.ratios.values()])
    assert np.abs((result[:, 0] - truth) / result[:, 1]).max() < 4
    assert model.fit.chi2_per_dof == pytest.approx(1.0, abs=0.1)
    assert np.array([run.zeros_rad for run in model.runs]) == pytest.approx(ZEROS[:2], abs=1e-3)
    comparison = compare_run(runs[2], rezeroed, model)
    assert (comparison.segment_rms_rad < 1.2 * comparison.noise_rad).all()
    assert comparison.free_run_rms_rad.max() < 0.02
    as_read = compare_run(runs[2], paper, model)
    assert as_read.segment_rms_rad.max() > 10 * comparison.segment_rms_rad.max()


def test_a_segment_continues_from_the_angle_of_the_rods_not_from_the_reading(recorded, paper: Rig) -> None:
    rezeroed = paper.model_copy(update={"encoders": paper.encoders.model_copy(update={"rezeroed": True})})
    problem, initial = segmented([preprocess(recorded({}, duration=2.0)[0], rezeroed)], rezeroed, 0.5)
    unread = rods_estimate(nominal_ratios(paper), initial)
    read = _continued(problem, unread.changed(zeros=ZEROS[:1]))
    assert len(read) > 1
    assert read == pytest.approx(_continued(problem, unread))
