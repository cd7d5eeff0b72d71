"""Show the residual analysis: whiteness and normality of the residuals of both models."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from dpr_lab.gap.result.diagnosis import Diagnosis
from dpr_lab.gap.result.evidence import ResidualAnalysis, Whiteness
from dpr_lab.report import style
from dpr_lab.report.digits import NONE, three
from dpr_lab.report.figures import legend_above, new_figure
from dpr_lab.report.gap.section import PAGE, EvidenceSection, evidence_of
from dpr_lab.report.pages.page import Rows, page_table
from dpr_lab.report.words import in_words
from dpr_lab.shown import percent


def residual_figure(diagnosis: Diagnosis) -> Figure:
    """Draw autocorrelation and normal quantile plot of the residuals, with one row per joint."""
    look = evidence_of(diagnosis).residuals
    figure = new_figure(0.5 + 2.5 * len(look.joints))
    grid = figure.subplots(len(look.joints), 2, squeeze=False)
    for (left, right), (joint, models) in zip(grid, look.joints.items(), strict=True):
        _draw_autocorrelation(left, look, models)
        _draw_quantiles(right, look, models)
        left.set(title=in_words(joint), ylabel="autocorrelation")
        right.set_ylabel("residual (σ of the noise)")
    grid[-1][0].set_xlabel("lag (s)")
    grid[-1][1].set_xlabel("normal quantile (σ)")
    legend_above(figure)
    return figure


def _draw_autocorrelation(axes: Axes, look: ResidualAnalysis, models: dict[str, Whiteness]) -> None:
    band = PAGE.white95 / max(look.readings, 1) ** 0.5
    axes.axhspan(-band, band, label="white noise, 95 %", **style.NOISE_BAND)
    for name, whiteness in models.items():
        label, line = style.MODELS[name]
        lags = look.spacing_s * np.arange(len(whiteness.autocorrelation))
        axes.plot(lags, whiteness.autocorrelation, label=label, **line)
    axes.set_ylim(-0.5, 1.05)
    axes.xaxis.set_major_locator(MaxNLocator(5))
    axes.margins(x=0.01)


def _draw_quantiles(axes: Axes, look: ResidualAnalysis, models: dict[str, Whiteness]) -> None:
    axes.plot(look.normal, look.normal, label="normal noise", **style.HORIZON)
    for name, whiteness in models.items():
        label, line = style.MODELS[name]
        markers = {"marker": "s" if name == "before" else "o", "markersize": 2.5, "linewidth": 0.8}
        axes.plot(look.normal, whiteness.quantiles, label=label, **(line | markers))
    reach = max(4.0, 1.2 * float(np.abs(models["after"].quantiles).max()))
    axes.set_ylim(-reach, reach)
    axes.margins(x=0.03)


def residual_words(diagnosis: Diagnosis) -> list[str]:
    """Describe the autocorrelation at lag 1 and the large residuals by joint and model."""
    sentences = []
    for joint, models in evidence_of(diagnosis).residuals.joints.items():
        first_lag = {name: (*whiteness.autocorrelation, 0.0, 0.0)[1] for name, whiteness in models.items()}
        tails = {name: whiteness.beyond3 for name, whiteness in models.items()}
        sentences.append(
            f"{in_words(joint).capitalize()}: the autocorrelation at lag 1 is {first_lag['before']:.2f} for the bare"
            f" and {first_lag['after']:.2f} for the corrected model; {percent(tails['before'], 1)} and"
            f" {percent(tails['after'], 1)} of the residuals exceed 3 σ (normal noise: 0.3 %)."
        )
    return [
        "Residuals of a complete model are white and normally distributed, with the standard deviation of the encoder"
        " noise. An autocorrelation outside the band, or quantiles off the dotted line, indicate an effect that the"
        " model lacks.",
        " ".join(sentences),
    ]


@page_table(
    "joint",
    "model",
    "lag 1",
    "lag 2",
    "lag 5",
    "lag 10",
    "lag 20",
    "lag 40",
    "beyond 3 σ",
    style="prose",
    title="Values of the autocorrelation",
)
def residual_table(diagnosis: Diagnosis) -> Rows:
    """Return autocorrelation at six lags and large residuals, by joint and model."""
    rows = []
    for joint, models in evidence_of(diagnosis).residuals.joints.items():
        for name, whiteness in models.items():
            known = whiteness.autocorrelation
            lags = (three(known[k]) if k < len(known) else NONE for k in (1, 2, 5, 10, 20, 40))
            rows.append((in_words(joint), style.MODELS[name][0], *lags, percent(whiteness.beyond3, 2)))
    return rows


@page_table(
    "joint",
    "normal (σ)",
    *(label for label, _ in style.MODELS.values()),
    caption="Residuals in standard deviations of the noise.",
    style="prose",
    title="Values of the quantiles",
)
def quantile_table(diagnosis: Diagnosis) -> Rows:
    """Return rows with every fifth point of the quantile plots, by joint."""
    look = evidence_of(diagnosis).residuals
    return [
        (in_words(joint), three(look.normal[i]), *(three(models[name].quantiles[i]) for name in style.MODELS))
        for joint, models in look.joints.items()
        for i in range(0, len(look.normal), 5)
    ]


RESIDUALS = EvidenceSection(
    name="residuals",
    title="Residual analysis",
    words=residual_words,
    figure=residual_figure,
    alternative="Autocorrelation and normal quantiles of the residuals of each joint, for both models.",
    caption="Left: autocorrelation of the residuals within segments. Right: quantiles of the residuals, in standard"
    " deviations of the noise, against those of a normal distribution; the axes cover the range of the corrected model."
    " The residuals are those of segments of 0.5 s of the fitted recordings, with free initial states.",
    tables=(
        residual_table,
        quantile_table,
    ),
    symbols="Autocorrelation at lag k: Σ r(i) r(i+k) / Σ r(i)², within segments; white noise stays within ±1.96/√n."
    " Box & Jenkins, Time Series Analysis, ch. 8.",
)
