"""Import of recordings of real rigs, if the data are available."""

from pathlib import Path

import numpy as np
import pytest

from dpr_lab.errors import RunError
from dpr_lab.rig import load_rig
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.inspect import verify

REAL = Path(__file__).parents[3] / "shared" / "data" / "real"

pytestmark = pytest.mark.skipif(not REAL.is_dir(), reason="the recordings are not part of the repository")


def test_the_first_ten_seconds_of_a_double_pendulum(tmp_path):
    file = REAL / "multiarm" / "dp_freeswing_1khz.csv"
    run = import_csv(file, load_rig("multiarm"), ImportOptions(zero="hanging", duration_s=10), tmp_path / "dp.mcap")
    expected = np.loadtxt(file, delimiter=",", skiprows=1, max_rows=10_000)
    np.testing.assert_allclose(run.t, expected[:, 0], atol=1e-12)
    np.testing.assert_allclose(run.theta[:, 1:], expected[:, 1:3] + np.pi, atol=1e-12)
    assert run.rate_hz == 1000
    assert run.notes == ()
    assert verify(tmp_path / "dp.mcap").ok


@pytest.mark.slow
def test_slightly_uneven_times_are_kept():
    run = import_csv(REAL / "dfki_design_a" / "release_060245.csv", load_rig("paper"), ImportOptions(zero="hanging"))
    assert len(run.t) == 999
    assert len(set(np.round(np.diff(run.t), 6))) > 1


def test_a_single_pendulum_lacks_an_axis():
    with pytest.raises(RunError, match="found for theta2; the table has: t_s, theta1_rad, omega1_rad_s"):
        import_csv(REAL / "multiarm" / "sp_freeswing_1khz.csv", load_rig("paper"))
