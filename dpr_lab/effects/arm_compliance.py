"""Arm compliance: the brake or servo that holds the arm acts like a damped spring."""

import math

from dpr_lab.effects.effect import BenchQuantity, Effect, EffectParameter, InternalState, Params, Recorded, shape
from dpr_lab.effects.quantities import ArmModel, RigConstants
from dpr_lab.kernels import inlined


@inlined
def compliant(constants: RigConstants, coupling_per_kg: float, frequency_hz: float, damping_ratio: float) -> ArmModel:
    """Return the model of a compliant arm in the equation of the whole rig.

    A = L0^2 / coupling,    k0 = A w^2,    c0 = 2 zeta A w,    w = 2 pi f

    Here A, k0 and c0 are the inertia, stiffness and friction of the arm, f is its frequency and zeta its damping ratio.
    """
    inertia = constants.L0 * constants.L0 / coupling_per_kg
    speed = 2.0 * math.pi * frequency_hz
    return ArmModel(inertia, constants.L0 / constants.g, 2.0 * damping_ratio * inertia * speed, inertia * speed * speed)


def propose(recorded: Recorded) -> list[dict[str, float]] | None:
    """Propose the frequencies of the grid.

    The result is empty if the encoder of the arm was read and shows no motion in any run.
    """
    return [] if all(moves is False for moves in recorded.arm_moves) else None


def longest_step(params: Params, *, per_period: float = 40.0, finest_s: float = 6.25e-4) -> float:
    """Return the longest integration step, s.

    The step is 1 / `per_period` of the period of the arm's vibration, but at least `finest_s`.
    """
    return max(1.0 / (per_period * params["frequency_hz"]), finest_s)


ARM_COMPLIANCE = Effect(
    name="arm_compliance",
    words="arm compliance",
    equation=(
        "equation of three coordinates (`dpr_lab.dynamics.arm`), with theta0 on a spring: A = L0^2 / coupling (inertia"
        " of the arm with all masses at its tip), k0 = A (2 pi f)^2, c0 = 2 zeta A 2 pi f; the arm is held"
        " before the release"
    ),
    parameters=(
        EffectParameter("coupling_per_kg", "1/kg", 0.1, "positive"),
        shape(
            "frequency_hz",
            "Hz",
            8.0,
            tuple(round(2.0 * 15.0 ** (k / 48.0), 4) for k in range(49)),
            draw=(2.0, 20.0),
            continuous=True,
        ),
        shape("damping_ratio", "1", 0.05, (0.02, 0.05, 0.12, 0.3), draw=(0.02, 0.3), continuous=True),
    ),
    site="base",
    stage="arm",
    kernel=compliant,
    exported=lambda params: {"arm": True},
    internal=(InternalState("angle", "rad"), InternalState("speed", "rad/s")),
    propose=propose,
    longest_step=longest_step,
    quantities=(
        BenchQuantity(
            "coupling of the arm",
            "coupling",
            ("coupling_per_kg",),
            definition="L0^2 divided by the inertia of the arm with all masses at its tip",
        ),
    ),
    symptom=(
        "After quick reversals of the rods, a decaying oscillation appears that is faster than the swing; the vibration"
        " of the arm or of its support can be felt by hand."
    ),
    bench_check=(
        "Read the arm's encoder while the rods swing; clamp the arm to the table and repeat: the oscillation"
        " disappears. Or tap the arm with the rods at rest and measure the frequency of its vibration."
    ),
    source="Lagrange's equations of the whole rig, `dpr_lab.dynamics.arm`.",
)
