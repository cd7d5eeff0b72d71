"""Limits of an acceptance test in a certificate: their results are claims, and the limits file has a hash."""

import shutil
from pathlib import Path

import pytest

from dpr_lab.certificate.document import load_certificate
from dpr_lab.workflows.certify import certify, verify
from tests.certificate.conftest import request_of, reseal

LIMITS = """
[effects.coulomb_joint1]
torque_Nm = { max = 0.001, unit = "N m" }

[effects.coulomb_joint2]
torque_Nm = { max = 0.01, unit = "N m" }
"""


@pytest.fixture(scope="module")
def place(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder with the runs, shared by all tests, so that the cached diagnosis can be used."""
    place = tmp_path_factory.mktemp("limits")
    for run in ("X1.mcap", "X2.mcap"):
        shutil.copy(folder / run, place)
    return place


@pytest.fixture
def certified(place: Path, remembered: None) -> Path:
    """A certificate with limits, next to its runs and limits."""
    (place / "limits.toml").write_text(LIMITS)
    path = place / "certificate.json"
    path.unlink(missing_ok=True)
    certify(request_of(place), path, limits=place / "limits.toml")
    return path


@pytest.mark.slow
def test_the_result_of_each_limit_is_a_claim_that_is_verified(certified: Path) -> None:
    claims = load_certificate(certified).claims
    assert claims["limit of coulomb_joint1.torque_Nm"].value == "fail"
    assert claims["limit of coulomb_joint2.torque_Nm"].value == "pass"
    assert claims["all limits"].value == "fail"
    done = verify(certified)
    assert done.holds
    assert {"limits.toml", "all limits"} <= {line.claim for line in done.lines}


@pytest.mark.slow
def test_a_forged_result_is_found(certified: Path) -> None:
    text = certified.read_text().replace('"value": "fail"', '"value": "pass"')
    certified.write_text(text)
    reseal(certified)
    broken = [line.claim for line in verify(certified).lines if not line.holds]
    assert broken == ["limit of coulomb_joint1.torque_Nm", "all limits"]


@pytest.mark.slow
def test_a_changed_or_missing_limits_file_is_found(certified: Path) -> None:
    limits = certified.with_name("limits.toml")
    limits.write_text(LIMITS.replace("0.001", "0.1"))
    assert [line.reason for line in verify(certified).lines if not line.holds] == ["is not the certified file"]
    limits.unlink()
    assert [line.reason for line in verify(certified).lines if not line.holds] == ["does not exist"]


@pytest.mark.slow
def test_limits_cannot_be_left_out_of_a_certificate_that_claims_them(certified: Path) -> None:
    certificate = load_certificate(certified)
    certified.write_text(certificate.model_copy(update={"limits": None}).sealed().to_text())
    broken = {line.claim: line.reason for line in verify(certified).lines if not line.holds}
    assert set(broken) == {name for name in certificate.claims if "limit" in name}
    assert all("is not a claim of policy" in reason for reason in broken.values())
