"""Expected recordings of possible releases."""

import numpy as np
import pytest

from dpr_lab.gap.advice.expected_recordings import MENU, simulated_release


@pytest.mark.slow
@pytest.mark.parametrize("release", [MENU[1], MENU[-1]], ids=["rods alone", "with a mass"])
def test_the_model_of_a_release_follows_its_own_first_readings(recorded, screened, bare, release):
    """The first segment starts at rest in the pose of the release, with the clamped mass, as its readings."""
    runs = recorded({}, duration=2.0)
    _, base = bare(runs)
    problem, initial = simulated_release(screened(runs), base, release)
    chi2 = problem.chi2_by_segment(problem.predict(problem.with_zeros(base.fit.estimate.changed(initial=initial))))
    assert np.sqrt(chi2[0] / problem.measured[: problem.segments.offsets[1]].size) < 0.1
