"""Free runs show a gap that fitted ratios absorb in segments: a rod on a cart whose recorded position is too large.

The cart is a long arm with recorded motion, and gaps of the logger shorten the segments. SciPy simulates the rod.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dpr_lab.estimation.arm_motion import prescribed_arm
from dpr_lab.fitting.gauss_newton import fit
from dpr_lab.gap.bare_model import fit_bare_model, nominal_ratios
from dpr_lab.gap.diagnose import diagnose
from dpr_lab.gap.hypothesis.detectable import detectable_arm_scale
from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.screen.record import record
from dpr_lab.gap.screen.recordings import Recordings
from dpr_lab.report.gap.next_steps import next_steps
from dpr_lab.rig import Rig, load_rig
from dpr_lab.run import Run
from sim_device.trials.driven import driven_runs

RATE_HZ, SECONDS, RAIL_M, COUNTS = 94.0, 3.2, 10.0, 1200
STIFFNESS, DAMPING = 26.0, 0.05
"""Squared natural frequency of the rod, 1/s^2, and its viscous friction, 1/s."""


def cart(scale: float) -> tuple[Rig, Run]:
    """Record a rod on a cart that moves by a chirp; the recorded position is the true one times a scale."""
    rig = Rig.model_validate(
        {
            "rig": {"name": "cart", "L0": RAIL_M, "L1": 0.5, "g": 9.81},
            "rods": {"mounted": "inner"},
            "parameters": {
                "l1": {"nominal": 0.25, "lower": 0.075, "upper": 0.475},
                "m1": {"nominal": 0.1, "lower": 0.07, "upper": 0.14},
                "c1": {"nominal": 2.7e-4, "lower": 9e-7, "upper": 9e-3},
                "J1": {"nominal": 2.1e-3, "lower": 1.8e-4, "upper": 9.1e-3},
            },
            "arm": {"mode": "prescribed"},
            "encoders": {"counts_per_rev": [65536, COUNTS, COUNTS]},
            "poses": {"P1": {"theta1": 2.0}},
        }
    )
    t = np.arange(0.0, SECONDS, 1 / RATE_HZ)
    gaps = [slice(first, first + 6) for first in (len(t) * (np.arange(9) + 0.8) / 9.5).astype(int)]
    t = np.delete(t, np.r_[tuple(gaps)])

    def position(at: np.ndarray | float) -> np.ndarray | float:
        return 0.02 * (0.3 + at / SECONDS) * np.sin(2 * np.pi * (0.8 * at + 0.6 * at**2))

    def slope(at: float, x: np.ndarray) -> list[float]:
        h = 1e-4
        pushed = (position(at + h) - 2 * position(at) + position(at - h)) / h**2
        return [x[1], STIFFNESS * (np.sin(x[0]) - pushed / 9.81 * np.cos(x[0])) - DAMPING * x[1]]

    solved = solve_ivp(slope, (0.0, t[-1]), [np.pi + 0.01, 0.0], t_eval=t, rtol=1e-9, atol=1e-10, max_step=0.01)
    rng, step = np.random.default_rng(0), 2 * np.pi / COUNTS
    angle = step * np.rint(solved.y[0] / step + rng.normal(0, 0.3, len(t)))
    moved = scale * position(t) / RAIL_M + rng.normal(0, 2e-5, len(t))
    theta, arm = np.stack([moved, angle, angle], axis=1), prescribed_arm(t, moved, rig, "run")
    return rig, Run("run", t, theta, None, None, rig.name, "", RATE_HZ, mounting="inner", arm=arm)


def ratio(diagnosis: Diagnosis) -> float:
    """Largest ratio of the error of a predictable free run to its uncertainty."""
    assert diagnosis.evidence
    worst = diagnosis.evidence.budget.worst
    assert worst
    return worst.error_before_rad / worst.u_before_rad


@pytest.mark.slow
def test_a_wrong_scale_of_the_recorded_cart_that_segments_absorb_is_a_gap() -> None:
    rig, run = cart(1.2)
    wrong = diagnose(run, rig)
    assert (wrong.verdict, wrong.effects) == ("unexplained", [])
    assert ratio(wrong) > 5.0
    assert wrong.sentence.startswith("Unexplained: segments of 0.5 s show no gap, but a free run does. The free run of")
    assert "above the limit of 4 times its uncertainty" in wrong.sentence
    assert "e1/a is 21.7 1/s² in the fit and 29.4 1/s² from the rig file." in wrong.sentence
    assert next_steps(wrong) == ["Check the scale of each recorded angle and input, then record a further release."]

    rig, run = cart(1.0)
    right = diagnose(run, rig)
    assert (right.verdict, right.effects) == ("inconclusive", [])  # of 3 s at 94 Hz, most effects are undetectable
    least = right.detectable["encoder_scale_joint0"]["excess"]
    assert least
    assert any(
        text.endswith(f"of {100 * least:.1f} % or more is detectable in the segments.") for text in right.assumptions
    )
    assert ratio(right) < 3.0


def test_the_detectable_scale_error_of_the_cart_is_five_standard_deviations() -> None:
    rig, run = cart(1.0)
    _, problem, bare = fit_bare_model(Recordings((record(run, rig),), rig), nominal_ratios(rig))
    size = detectable_arm_scale(problem, bare)
    assert size
    assert size > 0.3  # so the segments absorb the scale error of the test above
    (setup,) = problem.segments.setups
    assert setup.arm
    wrong = replace(problem.segments, setups=(replace(setup, arm=setup.arm.scaled(1 + size / 20)),))
    readings = replace(problem, segments=wrong).predict(bare.estimate)
    refitted = fit(replace(problem, measured=readings), bare.estimate, bare.fit.free)
    assert refitted.linear.chi2 == pytest.approx(bare.inflation * (5 / 20) ** 2, rel=0.05)
    clamped = replace(problem.segments, setups=(replace(setup, arm=None),))
    assert detectable_arm_scale(replace(problem, segments=clamped), bare) is None


@pytest.mark.slow
def test_the_noise_of_measured_torques_explains_the_error_of_a_free_run(paper: Rig) -> None:
    _, runs = driven_runs(load_rig("paper"), 700_000, duration=6.0)
    diagnosis = diagnose(runs, paper)
    assert diagnosis.verdict == "no_gap"
    assert diagnosis.evidence
    budget = diagnosis.evidence.budget
    (of_inputs,) = (source.before_rad for source in budget.sources if source.name == "inputs")
    assert budget.error_before_rad < 2 * budget.u_before_rad
    assert budget.error_before_rad > 4 * (budget.u_before_rad**2 - of_inputs**2) ** 0.5
