"""Whether what the models leave is noise: its memory, and its distribution."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import ResidualLook, Whiteness
from dpr_lab.report import style
from dpr_lab.report.digits import NONE, three
from dpr_lab.report.figures import legend_above, new_figure
from dpr_lab.report.gap.section import PAGE, EvidenceSection, FoldedTable, evidence_of
from dpr_lab.report.words import in_words

LOOKS = {"before": style.SIMULATED, "after": style.RESIDUAL}


def residual_figure(diagnosis: Diagnosis) -> Figure:
    """Autocorrelation and normal quantiles, one row for each joint."""
    look = evidence_of(diagnosis).residuals
    with style.house_style():
        figure = new_figure(0.5 + 2.5 * len(look.joints))
        grid = figure.subplots(len(look.joints), 2, squeeze=False)
        for (left, right), (joint, models) in zip(grid, look.joints.items(), strict=True):
            _draw_memory(left, look, models)
            _draw_quantiles(right, look, models)
            left.set(title=in_words(joint), ylabel="autocorrelation")
            right.set_ylabel("residual (noise σ)")
        grid[-1][0].set_xlabel("time between two readings (s)")
        grid[-1][1].set_xlabel("normal distribution (σ)")
        legend_above(figure)
        return figure


def _draw_memory(axes: Axes, look: ResidualLook, models: dict[str, Whiteness]) -> None:
    band = _band(look)
    axes.axhspan(-band, band, label="white noise, 95 %", **style.NOISE_BAND)
    for name, item in models.items():
        t = look.spacing_s * np.arange(len(item.autocorrelation))
        axes.plot(t, item.autocorrelation, label=f"{name} the effects", **LOOKS[name])
    axes.set_ylim(-0.5, 1.05)
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.margins(x=0.01)


def _draw_quantiles(axes: Axes, look: ResidualLook, models: dict[str, Whiteness]) -> None:
    axes.plot(look.normal, look.normal, label="normal noise", **style.HORIZON)
    for name, item in models.items():
        mark = {"marker": "s" if name == "before" else "o", "markersize": 2.5, "linewidth": 0.8}
        axes.plot(look.normal, item.quantiles, label=f"{name} the effects", **(LOOKS[name] | mark))
    reach = max(4.0, 1.2 * float(np.abs(models["after"].quantiles).max()))
    axes.set_ylim(-reach, reach)
    axes.margins(x=0.03)


def _band(look: ResidualLook) -> float:
    return PAGE.white95 / max(look.readings, 1) ** 0.5


def residual_words(diagnosis: Diagnosis) -> list[str]:
    """Whether noise alone is left."""
    look = evidence_of(diagnosis).residuals
    said = []
    for joint, models in look.joints.items():
        first = {
            name: item.autocorrelation[1] if len(item.autocorrelation) > 1 else 0.0 for name, item in models.items()
        }
        far = {name: item.beyond3 for name, item in models.items()}
        said.append(
            f"{in_words(joint).capitalize()}: neighbouring residuals share {first['before']:.0%} of what they are"
            f" before"
            f" and {first['after']:.0%} after the named effects; {far['before']:.1%} and {far['after']:.1%} lie beyond"
            " three times the noise, where normal noise has 0.3%."
        )
    return [
        "A model that lacks nothing leaves what the encoders' noise leaves: no memory from one reading to the next,"
        " and a"
        " normal distribution as wide as the noise. A swing back and forth in the left panels, or points off the dotted"
        " line in the right ones, is something that the model misses.",
        " ".join(said),
    ]


def residual_rows(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """Memory and tails, by joint and model."""
    look = evidence_of(diagnosis).residuals
    rows = []
    for joint, models in look.joints.items():
        for name, item in models.items():
            known = item.autocorrelation
            lags = (three(known[k]) if k < len(known) else NONE for k in (1, 2, 5, 10, 20, 40))
            rows.append((in_words(joint), name, *lags, f"{item.beyond3:.2%}"))
    return rows


def quantile_rows(diagnosis: Diagnosis) -> list[tuple[str, ...]]:
    """Every fifth point of the right panels."""
    look = evidence_of(diagnosis).residuals
    values = [item.quantiles for models in look.joints.values() for item in models.values()]
    return [(three(look.normal[i]), *(three(column[i]) for column in values)) for i in range(0, len(look.normal), 5)]


RESIDUALS = EvidenceSection(
    name="residuals",
    title="What the residuals look like",
    words=residual_words,
    figure=residual_figure,
    alternative="Autocorrelation and normal quantiles of the residuals of each joint, before and after.",
    caption="Left: correlation of two residuals of a segment against the time between them. Right: quantiles of the"
    " residuals, in standard deviations of the noise, against those of a normal distribution; the range is that of the"
    " corrected model. Segments of 0.5 s of the fitted recordings, start states free.",
    tables=(
        FoldedTable(
            "Memory in numbers",
            ("joint", "model", "lag 1", "lag 2", "lag 5", "lag 10", "lag 20", "lag 40", "beyond 3 σ"),
            residual_rows,
        ),
        FoldedTable(
            "Quantiles in numbers",
            ("normal (σ)", "joint 1 before", "joint 1 after", "joint 2 before", "joint 2 after"),
            quantile_rows,
            "Residuals in standard deviations of the noise.",
        ),
    ),
    symbols="Autocorrelation at lag k: Σ r(i) r(i+k) / Σ r(i)², within segments; white noise stays within ±1.96/√n."
    " Box &"
    " Jenkins, Time Series Analysis, ch. 8.",
)
