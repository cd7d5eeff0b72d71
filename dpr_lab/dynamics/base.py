"""Base parameters: the combinations of the nine parameters that determine a free swing.

    a  = J1 + m1 l1^2 + (m2 + mb) L1^2        b  = J2 + m2 l2^2        d = m2 L1 l2
    e1 = (m1 l1 + (m2 + mb) L1) g             e2 = m2 l2 g = d g / L1

Equation (1) is homogeneous in a, b, d, e1, e2, c1, c2, so a swing without external torque determines only the five
ratios to b.

The base parameters of a run depend on its mounting and on p = m2 L1^2. Swings of both rods cannot distinguish p from a:

    both, clamped    a                b    d    e1                c1    c2
    inner alone      a - p            -    -    e1 - p g / L1     c1    -
    outer alone      b                -    -    d g / L1          c1    -

With a clamped elbow, theta2 = theta1 + delta, one degree of freedom remains. Equation (1) becomes

    (a + b + 2 d cos(delta)) alpha1 = e1 sin(theta1) + e2 sin(theta1 + delta) - c1 omega1.

A single rod is represented by two equal halves that are connected by a clamped elbow.

The nine parameters Z are in the order of `dpr_lab.rig.PARAMETERS`, SI.
"""

import numpy as np
from numpy.typing import ArrayLike

from dpr_lab.arrays import Array
from dpr_lab.rig import PARAMETERS
from dpr_lab.rig_tables import AddedMass
from dpr_lab.setup import PRESCRIBED, Setup

BASE = ("a", "b", "d", "e1", "c1", "c2")
"""Order of the base parameters; units kg m^2, kg m^2, kg m^2, N m, N m s, N m s."""

WHOLE = (*BASE, "p")
"""Order of the base parameters of a whole rig: those in `BASE`, then p, kg m^2."""

RATIOS = ("a/b", "d/b", "e1/b", "c1/b", "c2/b")
"""Order of the ratios of the base parameters; units 1, 1, 1/s^2, 1/s, 1/s."""

ALONE = ("e1/a", "c1/a")
"""Order of the ratios that swings of the inner rod alone determine; units 1/s^2, 1/s."""

GAINS = {"torque": "1/{}", "current": "kt/{}", "voltage": "kt/(R {})"}
"""Name of the gain of a driven arm, by the kind of its input; {} is replaced by the scale, a or b."""

RATIO_UNITS: dict[str, str] = {
    **dict(zip((*RATIOS, *ALONE), ("1", "1", "1/s^2", "1/s", "1/s", "1/s^2", "1/s"), strict=True)),
    **{f"{name}/{scale}": unit for scale in "ab" for name, unit in (("A", "1"), ("c0", "1/s"))},
    **{
        gain.format(scale): unit
        for scale in "ab"
        for gain, unit in zip(GAINS.values(), ("1/(kg m^2)", "1/(s^2 A)", "1/(s^2 V)"), strict=True)
    },
}
"""Unit of each ratio to b, or to a for the inner rod alone, and of the gains of the drive."""

_B = BASE.index("b")
_OTHERS = [0, 2, 3, 4, 5]


def base_parameters(Z: ArrayLike, L1: float, g: float) -> Array:
    """Compute the base parameters from the nine kinetic parameters.

    Args:
        Z: (..., 9) parameters, SI
        L1: length of the inner rod, m
        g: gravity, m/s^2

    Returns:
        (..., 6) in the order of `BASE`
    """
    l1, l2, m1, m2, mb, c1, c2, J1, J2 = np.moveaxis(np.asarray(Z, dtype=np.float64), -1, 0)
    carried = m2 + mb
    return np.stack(
        [
            J1 + m1 * l1**2 + carried * L1**2,
            J2 + m2 * l2**2,
            m2 * L1 * l2,
            (m1 * l1 + carried * L1) * g,
            c1,
            c2,
        ],
        axis=-1,
    )


def loaded(Z: ArrayLike, added: AddedMass) -> Array:
    """Return the (9,) parameters of the rig with a known attached mass, SI.

    The mass changes the mass, centre of mass and inertia of its rod:

        m' = m + ma,    m' l' = m l + ma r,    J' + m' l'^2 = J + m l^2 + ma r^2
    """
    l1, l2, m1, m2, mb, c1, c2, J1, J2 = np.asarray(Z, dtype=np.float64)
    if added.rod == "inner":
        l1, m1, J1 = _joined(l1, m1, J1, added)
    else:
        l2, m2, J2 = _joined(l2, m2, J2, added)
    return np.array([l1, l2, m1, m2, mb, c1, c2, J1, J2])


def _joined(length: float, mass: float, inertia: float, added: AddedMass) -> tuple[float, float, float]:
    mass_with_added = mass + added.mass
    centroid = (mass * length + added.mass * added.position) / mass_with_added
    about_pivot = inertia + mass * length**2 + added.mass * added.position**2
    return centroid, mass_with_added, about_pivot - mass_with_added * centroid**2


def added_base(added: AddedMass | None, L1: float, g: float) -> Array:
    """Return the (6,) contribution of a known attached mass to the base parameters, SI.

    The contribution is zero if no mass is attached.
    """
    if added is None:
        return np.zeros(len(BASE))
    m, r = added.mass, added.position
    if added.rod == "inner":
        return np.array([m * r**2, 0.0, 0.0, m * r * g, 0.0, 0.0])
    return np.array([m * L1**2, m * r**2, m * L1 * r, m * L1 * g, 0.0, 0.0])


def added_to_run(setup: Setup, L1: float, g: float) -> Array:
    """Return the (6,) change of the base parameters in a run, SI.

    The change is due to a known attached mass, and to the inertia that represents a prescribed inner rod
    (`PRESCRIBED`).
    """
    added = added_base(setup.added, L1, g)
    added[0] += PRESCRIBED.inertia if setup.inner is not None else 0.0
    return added


def whole_parameters(Z: ArrayLike, L1: float, g: float) -> Array:
    """Return the (..., 7) base parameters of a whole rig from (..., 9) parameters, SI."""
    on_elbow = np.asarray(Z, dtype=np.float64)[..., PARAMETERS.index("m2")] * L1**2
    return np.concatenate([base_parameters(Z, L1, g), on_elbow[..., None]], axis=-1)


def base_of_run(whole: ArrayLike, setup: Setup, L1: float, g: float) -> Array:
    """Return the (..., 6) base parameters of the parts that are mounted in a run.

    Args:
        whole: (..., 7) in the order of `WHOLE`, SI; (..., 6) if p is not needed
        setup: mounting of the run
        L1: length of the inner rod, m
        g: gravity, m/s^2

    Raises:
        ValueError: the run has a single rod, but `whole` does not contain p.
    """
    whole = np.asarray(whole, dtype=np.float64)
    if not setup.alone:
        return whole[..., : len(BASE)] + added_to_run(setup, L1, g)
    if whole.shape[-1] < len(WHOLE):
        raise ValueError("a single rod requires the base parameters of the whole rig, with p")
    outer = setup.added is not None and setup.added.rod == "outer"
    p = setup.added.mass * L1**2 if setup.added is not None and outer else 0.0
    loaded_whole = whole + np.append(added_base(setup.added, L1, g), p)
    return np.asarray(loaded_whole @ base_slopes(setup, L1, g).T, dtype=np.float64)


def base_slopes(setup: Setup, L1: float, g: float) -> Array:
    """Return the (6, 7) derivative of the base parameters of a run with respect to those of the whole rig."""
    unit = np.eye(len(WHOLE))
    if not setup.alone:
        return unit[: len(BASE)]
    a, b, d, e1, c1, _, p = unit
    inertia, gravity = (a - p, e1 - p * g / L1) if setup.mounting == "inner" else (b, d * g / L1)
    nothing = np.zeros(len(WHOLE))
    return np.array([inertia / 2, inertia / 2, nothing, gravity, c1, nothing])


def ratios(base: ArrayLike) -> Array:
    """Return the (..., 5) ratios from (..., 6) base parameters, in the order of `RATIOS`."""
    base = np.asarray(base, dtype=np.float64)
    return base[..., _OTHERS] / base[..., _B, None]


def base_from_ratios(ratios: ArrayLike) -> Array:
    """Return the (..., 6) base parameters with b = 1 from (..., 5) ratios.

    The motion does not depend on the scale b.
    """
    ratios = np.asarray(ratios, dtype=np.float64)
    base = np.ones((*ratios.shape[:-1], len(BASE)))
    base[..., _OTHERS] = ratios
    return base


def rows(base: ArrayLike, L1: float, g: float) -> Array:
    """Divide the base parameters by a, as the kernel of `dpr_lab.dynamics.rollout` requires.

    Args:
        base: (..., 6) base parameters, at any scale
        L1: length of the inner rod, m
        g: gravity, m/s^2

    Returns:
        (..., 6) b, d, e1, e2, c1 and c2, each divided by a
    """
    a, b, d, e1, c1, c2 = np.moveaxis(np.asarray(base, dtype=np.float64), -1, 0)
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return np.stack([b, d, e1, d * g / L1, c1, c2], axis=-1) / a[..., None]


def base_jacobian(Z: ArrayLike, L1: float, g: float) -> Array:
    """Return the (6, 9) derivative of `base_parameters` with respect to the nine parameters, SI."""
    l1, l2, m1, m2, *_ = np.asarray(Z, dtype=np.float64)
    zero = 0.0
    return np.array(
        [
            # l1         l2           m1       m2       mb       c1   c2   J1   J2
            [2 * m1 * l1, zero, l1**2, L1**2, L1**2, zero, zero, 1.0, zero],
            [zero, 2 * m2 * l2, zero, l2**2, zero, zero, zero, zero, 1.0],
            [zero, m2 * L1, zero, L1 * l2, zero, zero, zero, zero, zero],
            [m1 * g, zero, l1 * g, L1 * g, L1 * g, zero, zero, zero, zero],
            [zero, zero, zero, zero, zero, 1.0, zero, zero, zero],
            [zero, zero, zero, zero, zero, zero, 1.0, zero, zero],
        ]
    )


def ratio_jacobian(Z: ArrayLike, L1: float, g: float) -> Array:
    """Compute the derivative of the ratios with respect to the nine parameters.

    Args:
        Z: (9,) parameters, SI
        L1: length of the inner rod, m
        g: gravity, m/s^2

    Returns:
        (5, 9) derivatives, in the units of `RATIOS` per SI unit of the parameter
    """
    return ratio_slopes(base_parameters(Z, L1, g)) @ base_jacobian(Z, L1, g)


def ratio_slopes(base: ArrayLike) -> Array:
    """Return the (5, 6) derivative of the ratios with respect to the base parameters (6,).

    The derivative of a ratio x / b is d(x/b) = (dx - (x/b) db) / b.
    """
    unit = np.eye(len(BASE))
    return (unit[_OTHERS] - np.outer(ratios(base), unit[_B])) / np.asarray(base)[_B]
