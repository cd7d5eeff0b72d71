"""Encoder errors that the library does not contain, or contains only in another form."""

import numpy as np
from numpy.typing import NDArray

from dpr_lab.effects.encoder_eccentricity import ENCODER_ECCENTRICITY
from dpr_lab.effects.encoder_scale import ENCODER_SCALE
from dpr_lab.effects.latency import LATENCY_JOINT2
from sim_device.plant.foreign.effect import Array, Moment, OutOfLibraryEffect, Size, Values
from sim_device.plant.foreign.engine import Body, EquationOfMotion, undisturbed

BURST_NARROWNESS = 200.0
"""Concentration of the bursts: they extend over about 0.1 rad of the inner rod."""

MAINS_HZ = 50.0


def _with_joint(number: int, joints: Array, error: Array) -> Array:
    read = joints.copy()
    read[:, number - 1] += error
    return read


def arc_eccentricity_joint1(joints: Array, moment: Moment, values: Values) -> Array:
    """Add an error with a kink once per turn: A (2 |sin((q - q0) / 2)| - 4 / pi)."""
    arc = 2 * np.abs(np.sin((joints[:, 0] - values["start_rad"]) / 2)) - 4 / np.pi
    return _with_joint(1, joints, values["error_rad"] * arc)


def triangle_eccentricity_joint2(joints: Array, moment: Moment, values: Values) -> Array:
    """Add an error that increases and decreases linearly once per turn: A (2 / pi) asin(sin(q - q0))."""
    triangle = 2 / np.pi * np.arcsin(np.sin(joints[:, 1] - values["start_rad"]))
    return _with_joint(2, joints, values["error_rad"] * triangle)


def shrinking_latency_joint2(joints: Array, moment: Moment, values: Values) -> Array:
    """Add a delay that decreases with speed, as of a tracking filter: error = -T w / (1 + |w| / v)."""
    omega = moment.states[:, 3] - moment.states[:, 2]
    return _with_joint(2, joints, -values["delay_ms"] * 1e-3 * omega / (1 + np.abs(omega) / values["speed_rad_per_s"]))


def swaying_latency_joint2(joints: Array, moment: Moment, values: Values) -> Array:
    """Add an oscillating delay of encoder 2, as with a busy bus: error = -T (1 + sin(2 pi t / P)) w / 2."""
    omega = moment.states[:, 3] - moment.states[:, 2]
    busy = (1 + np.sin(2 * np.pi * moment.t / values["period_s"])) / 2
    return _with_joint(2, joints, -values["delay_ms"] * 1e-3 * busy * omega)


def warming_scale_joint1(joints: Array, moment: Moment, values: Values) -> Array:
    """Add a scale error that grows during warm-up: error = A (1 - exp(-t / T)) q, q from the hanging position."""
    warm = -np.expm1(-np.maximum(moment.t, 0.0) / values["lasts_s"])
    return _with_joint(1, joints, values["error_per_rad"] * warm * (joints[:, 0] - np.pi))


def peaked_eccentricity_joint2(joints: Array, moment: Moment, values: Values) -> Array:
    """Add the error of a magnet near one angle, with mean zero: A (exp(K (cos(q - q0) - 1)) - exp(-K) I0(K))."""
    narrowness = values["narrowness"]
    peak = np.exp(narrowness * (np.cos(joints[:, 1] - values["place_rad"]) - 1))
    from scipy.special import i0e  # slow to import, and few plants need it

    return _with_joint(2, joints, values["error_rad"] * (peak - i0e(narrowness)))


def folded_scale_joint2(joints: Array, moment: Moment, values: Values) -> Array:
    """Add a scale error on one side of hanging only: error = A max(q, 0)."""
    return _with_joint(2, joints, values["error_per_rad"] * np.maximum(joints[:, 1], 0.0))


def emi_bursts(joints: Array, moment: Moment, values: Values) -> Array:
    """Add pulses in encoder 2 while the inner rod passes one position.

    All pulses have the same sign and random sizes.
    """
    near = np.exp(BURST_NARROWNESS * (np.cos(joints[:, 0] - values["place_rad"]) - 1))
    return _with_joint(2, joints, values["error_rad"] * near * np.abs(moment.noise[:, 2]))


def interpolation_error(joints: Array, moment: Moment, values: Values) -> Array:
    """Add the error of mismatched sine and cosine tracks of encoder 2: A sin(N q + phi), with N lines per turn."""
    return _with_joint(
        2, joints, values["error_rad"] * np.sin(round(values["lines"]) * joints[:, 1] + values["phase_rad"])
    )


def drifting_reference(joints: Array, moment: Moment, values: Values) -> Array:
    """Add a slow oscillation of the reference voltage of encoder 1.

    The error is a fraction of the angle within the turn.
    """
    within_turn = np.mod(joints[:, 0] + np.pi, 2 * np.pi) - np.pi
    return _with_joint(1, joints, values["share"] * np.sin(2 * np.pi * moment.t / values["period_s"]) * within_turn)


def magnetic_crosstalk(joints: Array, moment: Moment, values: Values) -> Array:
    """Add a disturbance of encoder 2 by the magnet of encoder 1: A sin(q1 + phi)."""
    return _with_joint(2, joints, values["error_rad"] * np.sin(joints[:, 0] + values["phase_rad"]))


def mains_hum(joints: Array, moment: Moment, values: Values) -> Array:
    """Add mains interference in both encoders: A sin(2 pi 50 t + phi)."""
    hum = values["error_rad"] * np.sin(2 * np.pi * MAINS_HZ * moment.t + values["phase_rad"])
    return joints + hum[:, None]


def counting_too_fast(body: Body, values: Values) -> EquationOfMotion:
    """Return the equation of motion with the lost angle, rad, as additional state.

    Encoder 2 loses a fraction of its counts above a speed.
    """
    share, limit = values["share"], values["limit_rad_per_s"]
    rods = undisturbed(body)

    def slope(t: float, x: Array) -> tuple[float, ...]:
        omega = float(x[3] - x[2])
        too_fast = omega - min(max(omega, -limit), limit)
        return *rods.slope(t, x[:4]), -share * too_fast

    return EquationOfMotion(slope, memory=(0.0,))


def overspeed_loss(joints: Array, moment: Moment, values: Values) -> Array:
    """Change the readings by the angle that encoder 2 has lost at high speeds."""
    return _with_joint(2, joints, moment.states[:, 4])


def stuck_bit(counts: NDArray[np.int64], values: Values) -> NDArray[np.int64]:
    """Return the counts with one bit of encoder 2 that always reads 0.

    It is the bit whose weight is nearest to the requested weight.
    """
    if values["weight_counts"] == 0.0:
        return counts
    bit = max(0, round(np.log2(values["weight_counts"])))
    read = counts.copy()
    read[:, 2] &= ~(1 << bit)
    return read


SENSORS = (
    OutOfLibraryEffect(
        "arc_eccentricity_joint1",
        "encoder 1: error with a kink once per turn",
        Size("error_rad", 1e-3, 5e-3),
        shape=(Size("start_rad", -3.0, 3.0),),
        reading=arc_eccentricity_joint1,
        family=ENCODER_ECCENTRICITY[:1],
    ),
    OutOfLibraryEffect(
        "triangle_eccentricity_joint2",
        "encoder 2: piecewise linear error once per turn",
        Size("error_rad", 1e-3, 5e-3),
        shape=(Size("start_rad", -3.0, 3.0),),
        reading=triangle_eccentricity_joint2,
        family=ENCODER_ECCENTRICITY[1:],
        held_back=True,
    ),
    OutOfLibraryEffect(
        "shrinking_latency_joint2",
        "encoder 2: delay that decreases with speed",
        Size("delay_ms", 0.5, 3.0),
        shape=(Size("speed_rad_per_s", 10.0, 30.0),),
        reading=shrinking_latency_joint2,
        family=(LATENCY_JOINT2,),
        held_back=True,
    ),
    OutOfLibraryEffect(
        "swaying_latency_joint2",
        "encoder 2: delay that increases while its bus is busy",
        Size("delay_ms", 0.5, 3.0),
        shape=(Size("period_s", 2.0, 8.0),),
        reading=swaying_latency_joint2,
        family=(LATENCY_JOINT2,),
    ),
    OutOfLibraryEffect(
        "warming_scale_joint1",
        "encoder 1: scale that changes during warm-up",
        Size("error_per_rad", 5e-4, 3e-3),
        sign="any",
        shape=(Size("lasts_s", 1.0, 4.0),),
        reading=warming_scale_joint1,
        family=ENCODER_SCALE[:1],
    ),
    OutOfLibraryEffect(
        "peaked_eccentricity_joint2",
        "encoder 2: error concentrated at one angle",
        Size("error_rad", 1e-3, 5e-3),
        shape=(Size("narrowness", 2.0, 6.0), Size("place_rad", -1.5, 1.5)),
        reading=peaked_eccentricity_joint2,
        family=ENCODER_ECCENTRICITY[1:],
        held_back=True,
    ),
    OutOfLibraryEffect(
        "folded_scale_joint2",
        "encoder 2: different scale on each side",
        Size("error_per_rad", 5e-4, 3e-3),
        sign="any",
        reading=folded_scale_joint2,
        family=ENCODER_SCALE[1:],
        held_back=True,
    ),
    OutOfLibraryEffect(
        "emi_bursts",
        "encoder 2: pulses at one angle of the inner rod",
        Size("error_rad", 2e-3, 1e-2),
        most=0.3,
        shape=(Size("place_rad", -1.0, 1.0),),
        reading=emi_bursts,
    ),
    OutOfLibraryEffect(
        "interpolation_error",
        "encoder 2: error with many cycles per turn",
        Size("error_rad", 5e-4, 2e-3),
        shape=(Size("lines", 16.0, 64.0), Size("phase_rad", -3.0, 3.0)),
        reading=interpolation_error,
        held_back=True,
    ),
    OutOfLibraryEffect(
        "drifting_reference",
        "encoder 1: oscillating reference voltage",
        Size("share", 2e-3, 1e-2),
        sign="any",
        shape=(Size("period_s", 1.5, 6.0),),
        reading=drifting_reference,
    ),
    OutOfLibraryEffect(
        "magnetic_crosstalk",
        "encoder 2: crosstalk from the magnet of encoder 1",
        Size("error_rad", 1e-3, 5e-3),
        shape=(Size("phase_rad", -3.0, 3.0),),
        reading=magnetic_crosstalk,
        held_back=True,
    ),
    OutOfLibraryEffect(
        "mains_hum",
        "both encoders: mains interference",
        Size("error_rad", 3e-4, 1e-3),
        shape=(Size("phase_rad", -3.0, 3.0),),
        reading=mains_hum,
        held_back=True,
    ),
    OutOfLibraryEffect(
        "overspeed_loss",
        "encoder 2: lost counts above a limit speed",
        Size("share", 2e-3, 2e-2),
        shape=(Size("limit_rad_per_s", 3.0, 8.0),),
        motion=counting_too_fast,
        reading=overspeed_loss,
        held_back=True,
    ),
    OutOfLibraryEffect(
        "stuck_bit",
        "one bit of encoder 2 always reads 0",
        Size("weight_counts", 2.0, 32.0),
        counter=stuck_bit,
    ),
)
