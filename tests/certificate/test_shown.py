"""Tables of `dpr-lab verify`."""

import pytest

from dpr_lab.certificate.lines import Verified
from dpr_lab.cli.certify import _show_verified
from dpr_lab.workflows.certify import VerifiedCertificate


def test_equal_sensor_faults_are_counted(capsys: pytest.CaptureFixture[str]) -> None:
    faults = ", ".join(["outlier (a)"] * 50 + ["jitter (a)"])
    _show_verified(VerifiedCertificate([], [], [Verified("sensor faults", faults, faults, holds=True, within=0.0)]))
    printed = capsys.readouterr().out
    assert printed.count("50 x outlier (a), jitter (a)") == 2
