"""Air drag: force proportional to the squared speed, integrated along the rods.

The drag force per length is k v |v|, where v is the velocity component perpendicular to the rod. At the distance s from
joint 1, v = s w1 for the inner rod. At the distance s from joint 2, v = L1 w1 cos(theta2 - theta1) + s w2 for the outer
rod. The velocity of a point of the arm is its radius times the speed of the arm, so one coefficient describes the drag
of the arm and of all parts mounted on it.
"""

import math
from collections.abc import Callable
from typing import Any

from dpr_lab.effects.effect import ARM, BenchQuantity, Effect, EffectParameter
from dpr_lab.effects.quantities import Joint, Motion, RigConstants, Terms, torques
from dpr_lab.kernels import inlined


@inlined
def _between(start: float, slope: float, low: float, high: float) -> tuple[float, float]:
    """Integrate v |v| and s v |v| over low <= s <= high by two Gauss points.

    The sign of v = start + slope s must be constant.
    """
    span, node = high - low, 0.5 / math.sqrt(3.0)
    s1, s2 = low + (0.5 - node) * span, low + (0.5 + node) * span
    v1, v2 = start + slope * s1, start + slope * s2
    share1, share2 = 0.5 * span * v1 * abs(v1), 0.5 * span * v2 * abs(v2)
    return share1 + share2, s1 * share1 + s2 * share2


@inlined
def moments(start: float, slope: float, length: float) -> tuple[float, float]:
    """Integrate v |v| and s v |v| over 0 <= s <= length, with v = start + slope s.

    The result is exact: both integrands are polynomials of at most third degree on either side of a sign change of v,
    and two Gauss points integrate such polynomials exactly.
    """
    turn = -start / slope
    turn = turn if turn > 0.0 else 0.0
    turn = turn if turn < length else length
    split = length if slope == 0.0 else turn
    force1, moment1 = _between(start, slope, 0.0, split)
    force2, moment2 = _between(start, slope, split, length)
    return force1 + force2, moment1 + moment2


@inlined
def outer(motion: Motion, constants: RigConstants, coefficient_kg_per_m2: float) -> Terms:
    """Return the drag torques of the outer rod on both rods, N m.

    Joint 2 transmits the drag force to the inner rod.
    """
    lever = constants.L1 * (motion.cos1 * motion.cos2 + motion.sin1 * motion.sin2)
    force, moment = moments(lever * motion.omega1, motion.omega2, constants.L2)
    return torques(-coefficient_kg_per_m2 * lever * force, -coefficient_kg_per_m2 * moment)


@inlined
def both(motion: Motion, constants: RigConstants, coefficient_kg_per_m2: float) -> Terms:
    """Return the drag torques of two rods of equal width, N m."""
    carried = outer(motion, constants, coefficient_kg_per_m2)
    drag1 = coefficient_kg_per_m2 * constants.L1**4 / 4.0 * motion.omega1 * abs(motion.omega1)
    return torques(carried.torque1 - drag1, carried.torque2)


@inlined
def of_arm(joint: Joint, coefficient_kg_m2: float) -> float:
    """Return the drag torque on the arm, N m."""
    return -coefficient_kg_m2 * joint.speed * abs(joint.speed)


_SOURCE = (
    "Drag of a cylinder across the flow, k = rho C_d width / 2 with C_d about 1.2: Hoerner (1965), Fluid-Dynamic Drag,"
    " ch. 3; rotation as in Mungan & Lipscombe, Eur. J. Phys. 34, 1243 (2013)."
)


def _of_rods(name: str, rod: str, kernel: Callable[..., Terms], **fields: Any) -> Effect:
    """Return the drag of the outer rod or of both rods; the bench check is at `rod`."""
    return Effect(
        name=name,
        parameters=(EffectParameter("coefficient_kg_per_m2", "kg/m^2", 5e-3, "positive"),),
        site="joint torque",
        stage="torque",
        kernel=kernel,
        dissipative=True,
        common=True,
        quantities=(
            BenchQuantity("drag coefficient of a rod", "k", ("coefficient_kg_per_m2",), definition="rho C_d width / 2"),
        ),
        bench_check=(
            f"Tape a light card to the {rod} rod and repeat the recording: the drag of this rod is then several times"
            " as large. The ratio of the widths of the rods, measured with a calliper, is the ratio of their drag"
            " coefficients."
        ),
        source=_SOURCE,
        **fields,
    )


AIR_DRAG_OUTER = _of_rods(
    "air_drag_outer",
    "outer",
    outer,
    words="air drag, outer rod",
    equation=(
        "tau_i = -k integral along the outer rod of v |v| dv/domega_i ds, v = L1 omega1 cos(theta2 - theta1) + s omega2"
    ),
    twins=("air_drag_both", "viscous_ground_link2"),
    symptom=(
        "Large swings lose a larger fraction of their amplitude per cycle than small swings; the last small swings"
        " decay slowly."
    ),
)

AIR_DRAG_BOTH = _of_rods(
    "air_drag_both",
    "inner",
    both,
    words="air drag, all rods",
    equation="torques of air_drag_outer, plus tau1 = -k L1^4 omega1 |omega1| / 4 on the inner rod",
    twins=("air_drag_outer", "viscous_ground_link2"),
    nested=("air_drag_outer",),
    symptom=(
        "Large swings lose a larger fraction of their amplitude per cycle than small swings, also if the inner rod"
        " swings alone."
    ),
)

AIR_DRAG_JOINT0 = Effect(
    name="air_drag_joint0",
    words="air drag of the arm",
    equation="tau = -k u |u| with u the speed of joint 0",
    parameters=(EffectParameter("coefficient_kg_m2", "kg m^2", 1e-4, "positive"),),
    site="joint torque",
    stage="torque0",
    kernel=of_arm,
    joints=(ARM,),
    dissipative=True,
    common=True,
    twins=("friction_curve_joint0",),
    quantities=(
        BenchQuantity("drag coefficient of the arm", "k", ("coefficient_kg_m2",), definition="rho C_d width L0^4 / 8"),
    ),
    symptom=(
        "At large inputs the arm is slower than its viscous friction alone would allow; after the input is switched"
        " off, high speeds decay quickly and low speeds slowly."
    ),
    bench_check=(
        "Tape a light card to the arm and repeat the recording: the drag is then several times as large. Or remove the"
        " rods and drive the arm with two constant inputs: with drag, the speed increases by a smaller factor than the"
        " input."
    ),
    source=_SOURCE,
)
