"""Clock rate error of the device."""

from dpr_lab.effects.effect import BenchQuantity, Effect, EffectParameter
from dpr_lab.kernels import inlined


@inlined
def clock_error(t: float, excess: float) -> float:
    """Return true time minus device time, s, at the device time t.

    `excess` is the relative rate error; it is positive if the clock is fast.
    """
    return t / (1.0 + excess) - t


CLOCK_RATE = Effect(
    name="clock_rate",
    words="clock rate error",
    equation="both encoders are read at t / (1 + x), with t the device's time since the release",
    parameters=(EffectParameter("excess", "1", 1e-3, plausible=1e-4),),
    site="timing",
    stage="timing",
    kernel=clock_error,
    corrects="t",
    remedy=lambda params, rig, joint: (
        f"divide the device's times by {1.0 + params['excess']:.6f}: its clock has a rate error of"
        f" {1e6 * params['excess']:+.0f} ppm, if L1 and g of the rig file are correct"
    ),
    twins=("wrong_length_L1",),
    quantities=(
        BenchQuantity(
            "rate error of the device's clock", "x", ("excess",), definition="device time divided by true time, minus 1"
        ),
    ),
    symptom="All periods differ by the same factor from those measured with a stopwatch.",
    bench_check=(
        "Compare ten minutes of the device's ticks with the host's clock (`dpr-lab run info` shows the rate"
        " error). A crystal has an error of at most 0.01 %: a larger error indicates an incorrect L1 (or g)."
    ),
    source=(
        "Equation (1) keeps its form when time is scaled, except for gravity. Data sheets of crystals allow 20 to"
        " 100 ppm for tolerance, temperature and age together."
    ),
)
