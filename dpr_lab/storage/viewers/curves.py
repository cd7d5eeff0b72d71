"""Define the curves of a run file in the layouts of viewers, grouped by plot."""

from dpr_lab.storage.layout import EVENTS, SAMPLES, STATUS

PLOTS: dict[str, tuple[tuple[str, str, int | None], ...]] = {
    "absolute angles, rad": ((SAMPLES, "theta", 1), (SAMPLES, "theta", 2)),
    "arm, rad": ((SAMPLES, "theta", 0),),
    "encoder counts": ((SAMPLES, "counts", 0), (SAMPLES, "counts", 1), (SAMPLES, "counts", 2)),
    "known torques, N m": ((SAMPLES, "tau", 0), (SAMPLES, "tau", 1)),
    "losses": ((STATUS, "dropped", None), (STATUS, "overruns", None)),
}
"""Curves of each plot, by title: topic, key of the messages, and index in an array."""

TEXTS = EVENTS
"""Topic with the release and other events."""

COLORS = ("#1f77b4", "#d62728", "#2ca02c")
"""Colours of the curves of a plot, in order."""
