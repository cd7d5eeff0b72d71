"""One- and two-sided tests of limits at 95 %, with intervals calculated by hand."""

import pytest

from dpr_lab.acceptance.friction import largest_friction
from dpr_lab.acceptance.judge import Acceptance, JudgedLimit, _answer, judge
from dpr_lab.acceptance.limits import FrictionLimit, Limits
from dpr_lab.gap.result.causes import UNTESTED
from dpr_lab.gap.result.diagnosis import UNCERTAIN
from dpr_lab.gap.result.evidence import JointFriction
from dpr_lab.report.gap.acceptance import limit_note, limit_table
from tests.a_diagnosis import made
from tests.one_cause import one_cause


@pytest.mark.parametrize(
    ("lower", "upper", "expected"),
    [
        (-3.0, 3.0, "pass"),
        (None, 2.1, "pass"),
        (0.9, None, "pass"),
        (None, 2.0, "not decidable"),
        (1.0, None, "not decidable"),
        (0.0, 1.5, "not decidable"),
        (1.5, 3.0, "not decidable"),
        (None, 1.0, "not decidable"),
        (None, 0.9, "fail"),
        (2.1, None, "fail"),
        (2.1, 3.0, "fail"),
        (-3.0, 0.9, "fail"),
    ],
)
def test_an_interval_must_lie_inside_or_outside_the_limits(
    lower: float | None, upper: float | None, expected: str
) -> None:
    assert _answer((1.0, 2.0), lower, upper) == expected
    assert _answer(None, lower, upper) == "not decidable"


def test_the_largest_friction_torque_has_a_pointwise_upper_and_a_simultaneous_lower_bound() -> None:
    """The 95 % quantile of chi2 with 2 degrees of freedom is -2 ln 0.05 = 5.991, and its root 2.448."""
    curve = JointFriction(
        speed_rad_per_s=[-4.0, -2.0, 2.0, 4.0],
        torque_Nm=[-9.0, -1.2, 1.0, 9.0],
        std_Nm=[0.5, 0.1, 0.3, 0.5],
        coefficients=2,
    )
    slow, fast = (FrictionLimit(max=1.0, unit="N m", speed_rad_s=speed) for speed in (2.0, 3.0))
    assert largest_friction(curve, slow, 0.95) == pytest.approx((1.2 - 0.1 * 2.4477, 1.0 + 0.3 * 1.6449), rel=1e-4)
    between = largest_friction(curve, fast, 0.95)  # -5.1 with std 0.3 at -3 rad/s, 5.0 with std 0.4 at 3 rad/s
    assert between == pytest.approx((5.1 - 0.3 * 2.4477, 5.0 + 0.4 * 1.6449), rel=1e-4)


def test_the_median_of_free_run_errors_has_the_interval_of_student_s_t() -> None:
    """Errors of e^-1, 1 and e have logarithms of mean 0 and standard deviation 1; t(0.95) with 2 is 2.920."""
    limits = Limits.model_validate({"free_run": {"max": 1.0, "horizon_s": 1.0, "unit": "rad"}})
    (judged,) = judge(made(), limits, {"X1": 2.718282, "X2": 1.0, "X3": 1 / 2.718282}).limits
    assert judged.interval90 == pytest.approx((1 / 5.3968, 5.3968), rel=1e-3)


def test_the_interval_of_a_ratio_has_the_digits_that_show_its_width() -> None:
    rows = [JudgedLimit("c2/b", "1/s", 0.001, 5.0, (low, high), "pass", "") for low, high in ((0.19551, 0.195543),)]
    ((_, limits, interval, *_),) = limit_table(Acceptance("pass", "", tuple(rows))).rows
    assert (limits, interval) == ("0.001 to 5", "0.19551 to 0.195543")


def test_a_negative_interval_of_a_size_that_cannot_be_negative_is_explained() -> None:
    sizes = ("coulomb_joint1.torque_Nm", "N m", -1e-4, 1e-4), ("encoder_offset_joint1.offset_rad", "rad", -1e-3, 1e-3)
    friction, offset = (
        Acceptance("pass", "", (JudgedLimit(*size, interval90=(-2e-5, 3e-5), answer="pass", reason=""),))
        for size in sizes
    )
    assert "extends below zero" in limit_note(friction)
    assert limit_note(offset) == ""


def test_a_ratio_that_depends_on_an_untested_form_needs_a_second_release() -> None:
    result = one_cause()
    limited = result.effects[0].model_copy(update={"probability": 0.64, "untested": True})
    limits = Limits.model_validate({"ratios": {"c2/b": {"min": 0.0, "unit": "1/s"}}})
    (judged,) = judge(result.model_copy(update={"effects": [limited]}), limits).limits
    assert judged.answer == "not decidable"
    assert judged.reason.endswith(f"64 %, {UNTESTED}: record a second release")
    uncertain = result.model_copy(update={"effects": [limited], "verdict": "partly_explained", "sentence": UNCERTAIN})
    (judged,) = judge(uncertain, limits).limits
    assert judged.reason == f"the cause is uncertain, {UNTESTED}: record a second release"
