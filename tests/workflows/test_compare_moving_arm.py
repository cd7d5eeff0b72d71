"""Table of the angles of runs that are compared with a model of a moving arm."""

import numpy as np

from dpr_lab.identification.moving_arm.identify import ArmComparison
from dpr_lab.workflows.compare_moving_arm import angles_csv


def test_the_table_of_a_comparison_contains_rods_without_an_encoder():
    """A corrected model of a single rod has no angle of joint 2; its table was empty."""
    angles = np.array([[0.1, 3.1, np.nan], [0.2, 3.2, np.nan], [np.nan, np.nan, np.nan]])
    compared = ArmComparison("r1", True, np.arange(3.0), angles, angles, 0.5, {"joint 0": 0.0}, {"joint 0": 1e-3})
    _, *rows = angles_csv([compared]).splitlines()
    assert rows == ["r1,0,0.1,3.1,nan,0.1,3.1,nan", "r1,1,0.2,3.2,nan,0.2,3.2,nan"]
