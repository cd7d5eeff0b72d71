"""Missed counts: an encoder loses or gains counts at one instant in one run."""

import math

from dpr_lab.effects.effect import BenchQuantity, Effect, EffectParameter, Recorded, shape
from dpr_lab.effects.quantities import EncoderReading
from dpr_lab.kernels import inlined


@inlined
def stepped(encoder: EncoderReading, counts: float, joint: float, run: float, time_s: float) -> float:
    """Return the reading error after a step of one joint in one run, rad.

    Before the step and in other runs it is zero.
    """
    if encoder.number != round(joint) or encoder.run != round(run) or encoder.t < time_s:
        return 0.0
    return 2.0 * math.pi / encoder.counts_per_rev * counts


def propose(recorded: Recorded) -> list[dict[str, float]]:
    """Propose joint, run and time of each step of a reading, as shape parameters."""
    return [{"joint": 1.0 + joint, "run": float(run), "time_s": t} for joint, run, t in recorded.steps]


MISSED_COUNTS = Effect(
    name="missed_counts",
    words="missed encoder counts",
    equation="after an instant of one run, the encoder of one joint reads n counts more",
    parameters=(
        EffectParameter("counts", "counts", 20.0, whole=True),
        shape("joint", "1", 2.0, (1.0, 2.0), draw=(1.0, 2.0), whole=True),
        EffectParameter("run", "1", 1.0, "positive", "shape", draw=(0.0, 2.0), whole=True),
        shape("time_s", "s", 5.0, draw=(1.0, 9.0)),
    ),
    site="sensor",
    stage="encoder",
    kernel=stepped,
    event=True,
    propose=propose,
    remedy=lambda params, rig, joint: (
        f"subtract {params['counts']:.0f} counts from joint {params['joint']:.0f} from {params['time_s']:.3g} s on in"
        f" release {params['run'] + 1:.0f}, and repair that encoder's shield or connector"
    ),
    quantities=(BenchQuantity("counts that the encoder missed", "n", ("counts",)),),
    symptom=(
        "The reading of one joint jumps by several counts at one instant of one recording and stays shifted. At rest,"
        " the rods then give a different reading than before."
    ),
    bench_check=(
        "Compare the angle at which the rods hang before and after the run: the angle has changed by whole counts."
        " Check shield and connector of that encoder, and that its edge rate is below the maximum of the counter."
    ),
    source="Quadrature counters lose edges in steps of whole counts; `run` counts the releases from 0.",
)
