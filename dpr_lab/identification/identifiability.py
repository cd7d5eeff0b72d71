"""Identifiable parameters of free swings, and bench measurements for the other parameters.

Information is represented by whitened rows: sensitivities to relative changes of the nine parameters Z. The rows of the
recordings are F dq/dZ diag(Z), where q are the ratios and F^T F is their information. The row of a measured value is Z
/ std. Bounds are used only to compute standard deviations: a bound is a prior with the standard deviation of a uniform
distribution. docs/theory.md, equations 48 and 49.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import RATIOS, base_parameters, whole_parameters
from dpr_lab.estimation.noise import NORMAL_Q90
from dpr_lab.fitting.estimate import UNKNOWN_RATIOS, unknown_ratios
from dpr_lab.identification.directions import SEEN, free_directions, simple_basis, spread
from dpr_lab.identification.expected import expected_releases, information_root
from dpr_lab.identification.instruments import BenchReading, Measurement, rod_measurements
from dpr_lab.identification.model import ParameterValue
from dpr_lab.identification.prior_update import Posterior, observed, posterior_of
from dpr_lab.identification.ratio_fit import fit_ratios
from dpr_lab.rig import PARAMETERS, Rig, of_inner_rod
from dpr_lab.rig_tables import Parameter
from dpr_lab.shown import Row, Shown


@dataclass(frozen=True, slots=True)
class AdviceSettings:
    """Thresholds of useful measured values and of recommended measurements."""

    helps: float = 1.1
    """Minimum factor by which the standard deviation of a parameter increases without a useful measured value.

    It defines which measured values are useful for the parameter.
    """
    worthwhile_bits: float = 0.1
    """Minimum gain of a recommended measurement over all nine parameters, in bits.

    A reduction of one standard deviation by 7 % has this gain.
    """


SETTINGS = AdviceSettings()

CRAMER_RAO_NOTE = (
    "Cramér-Rao: lower bound of the standard deviation of an unbiased estimate for independent residuals"
    " with the variance of the fit. `identify` prints larger values if the model is incomplete, because the"
    " residuals are then correlated in time (misfit inflation). The values of the ratios are computed from the nine"
    " parameters below. The bounds of the rig file may therefore shift a ratio within the interval that `identify`"
    " prints."
)
"""Note on the difference between these standard deviations of ratios and those of `identify`."""


@dataclass(frozen=True, slots=True)
class Advice:
    """A bench measurement and its expected gain."""

    name: str
    """Name of the measurement."""
    how: str
    """Instruction for the operator."""
    frees: tuple[str, ...]
    """Parameters that are determined with this measurement but not without it."""
    gain_bits: float
    """Gain in bits: the sum over the parameters of log2(std before / std after), with bounds as priors.

    One bit halves one standard deviation.
    """
    quantity: BenchReading
    """Measured quantity."""
    parameters: int = len(PARAMETERS)
    """Number of parameters in the sum of the gain."""

    @property
    def sentence(self) -> str:
        """Sentence with the instruction and the expected gain."""
        start = self.how[0].upper() + self.how[1:]
        if self.gain_bits < SETTINGS.worthwhile_bits:
            return f"{start}: adds no information."
        fixes = f"determines {', '.join(self.frees)}" if self.frees else "determines no parameter alone"
        times = 2 ** (self.gain_bits / self.parameters)
        return (
            f"{start}: {fixes}; on average the standard deviations of the {self.parameters} parameters"
            f" fall by a factor of {times:.1f}."
        )

    def to_json(self) -> dict[str, Any]:
        """Return the measurement as JSON values."""
        names = ("name", "how", "gain_bits", "sentence")
        return {name: getattr(self, name) for name in names} | {
            "frees": list(self.frees),
            "quantity": asdict(self.quantity),
        }


@dataclass(frozen=True, slots=True)
class LengthError:
    """Effect of a measurement error of L1, which is not identified, on the ratios."""

    error: float
    """Assumed error of L1, m."""
    ratio_shift: Mapping[str, float]
    """Relative change of each ratio due to the error."""
    residual_over_noise: float
    """Rms residual with the error, in units of the noise floor; 1 if the error is not detectable."""


@dataclass(frozen=True, slots=True, repr=False)
class Directions:
    """Determined and free directions in the space of the parameters, and recommended measurements.

    A direction is determined by recordings and measured values together.
    """

    rank: int
    """Number of directions that the recordings determine."""
    singular_values: tuple[float, ...]
    """Singular values of the whitened sensitivity to relative changes of the parameters, largest first.

    There is one value per fitted unknown, but not more than there are parameters.
    """
    null_space: tuple[Mapping[str, float], ...]
    """Directions that recordings and measured values do not determine, as relative changes of the parameters."""
    advice: tuple[Advice, ...]
    """All bench measurements that are not in the rig file, largest gain first."""
    sequence: tuple[Advice, ...]
    """Most useful measurements, one after the other, until all parameters are determined."""

    def _json(self) -> dict[str, Any]:
        return {
            "rank": self.rank,
            "singular_values": list(self.singular_values),
            "null_space": [dict(direction) for direction in self.null_space],
            "advice": [advice.to_json() for advice in self.advice],
            "sequence": [advice.to_json() for advice in self.sequence],
        }


@dataclass(frozen=True, slots=True, repr=False)
class Identifiability(Directions, Shown):
    """Results of an identifiability analysis with a clamped arm.

    The recordings determine at most five directions, or six with a known added mass.
    """

    unknowns: Mapping[str, float]
    """Values of the five ratios, and of b if a known added mass makes it identifiable."""
    cramer_rao_std: Mapping[str, float]
    """Cramér-Rao bound of the standard deviation of each unknown; inf if there is no information."""
    parameters: Mapping[str, ParameterValue]
    """Source of each parameter of the mounted rods, and its standard deviation if it is determined."""
    helps: Mapping[str, tuple[str, ...]]
    """For each measured value, the other parameters whose standard deviations would be larger without it."""
    length_error: LengthError | None
    """Effect of an error of L1; None if there are no poses to simulate, or if it was not requested."""

    def _heading(self) -> str:
        least = ", ".join(f"{name} {self.cramer_rao_std[name]:.1g}" for name in self.unknowns)
        return (
            f"Identifiability: {self.rank} of {len(self.parameters)} combinations of parameters are determined; lower"
            f" bounds of the standard deviations: {least}"
        )

    def _rows(self) -> list[Row]:
        fixed = [(name, f"{parameter.value:.5g}", parameter.fixed_by) for name, parameter in self.parameters.items()]
        return [("parameter", "value", "determined by"), *fixed]

    @property
    def fixed_by(self) -> dict[str, str]:
        """Source of each parameter: `data`, `measured` or `bound`."""
        return {name: value.fixed_by for name, value in self.parameters.items()}

    def to_json(self) -> dict[str, Any]:
        """Return the analysis as JSON values."""
        return self._json() | {
            "unknowns": {
                name: {"value": value, "cramer_rao_std": std if np.isfinite(std := self.cramer_rao_std[name]) else None}
                for name, value in self.unknowns.items()
            },
            "parameters": {name: value.model_dump() for name, value in self.parameters.items()},
            "helps": {name: list(others) for name, others in self.helps.items()},
            "length_error": None if self.length_error is None else asdict(self.length_error),
        }


@dataclass(frozen=True, slots=True)
class InformationRows:
    """Whitened sensitivity matrix; the n columns belong to relative changes of the parameters."""

    names: tuple[str, ...]
    """Names of the n parameters."""
    of_recordings: Array
    """(k, n) rows of the recordings."""
    measured: Array
    """Rows (measured values, n) of the measured values in the rig file."""
    bounds: Array
    """Rows (other parameters, n) of the bounds of the parameters without a measured value."""

    @classmethod
    def of(cls, of_recordings: Array, parameters: Mapping[str, Parameter | None], values: Array) -> "InformationRows":
        """Add the information of the rig file to that of the recordings.

        A bound acts like the standard deviation of a uniform distribution between the bounds. Without bounds, the
        relative standard deviation is 1.

        Args:
            of_recordings: (k, n) rows of the recordings
            parameters: entry of the rig file for each parameter; None if there is no entry
            values: (n,) values of the parameters, SI
        """
        measured, bounds = list[Array](), list[Array]()
        for parameter, value, unit in zip(parameters.values(), values.tolist(), np.eye(len(values)), strict=True):
            if parameter and parameter.std:
                measured.append(value / parameter.std * unit)
            elif parameter and parameter.upper and parameter.lower:
                bounds.append(value * 12**0.5 / (parameter.upper - parameter.lower) * unit)
            else:
                bounds.append(unit)
        none = np.zeros((0, len(values)))
        return cls(tuple(parameters), of_recordings, np.array(measured or none), np.array(bounds or none))

    @property
    def known(self) -> Array:
        """Rows (m, n) of recordings and measured values."""
        return np.vstack([self.of_recordings, self.measured])

    def directions(self, answers: Mapping[Measurement, Array]) -> dict[str, Any]:
        """Return the fields of `Directions` by name.

        `answers` contains the whitened readings (k, n) of each possible bench measurement.
        """
        singular_values = np.linalg.svd(self.of_recordings, compute_uv=False)
        return {
            "rank": int(np.sum(singular_values >= SEEN)),
            "singular_values": tuple(singular_values.tolist()),
            "null_space": tuple(simple_basis(free_directions(self.known), self.names)),
            "advice": tuple(sorted(_advice(answers, self.known, self).values(), key=_worth, reverse=True)),
            "sequence": _bench_sequence(answers, self),
        }


def identifiability(
    information: Array,
    rig: Rig,
    posterior: Posterior | None = None,
    *,
    lengths: bool = True,
) -> Identifiability:
    """Analyse which parameters are identifiable from recordings and measured values.

    For the inner rod alone, the result contains only parameters of this rod and its ratios to its inertia a.

    Args:
        information: (5, 5) Fisher information of the ratios, or (6, 6) with b, from a fit or from
            `dpr_lab.identification.expected.mounted_releases`
        rig: bounds, measured values, encoders and poses
        posterior: distribution of the parameters, given the unknowns to which `information` refers; None: computed from
            the best known values of the rig file
        lengths: whether to compute the effect of an error of L1, which needs a fit to simulated releases
    """
    if posterior is None:
        nominal = unknown_ratios(whole_parameters(rig.nominal, rig.L1, rig.g))
        posterior = posterior_of(nominal, rig, range(len(information)))
    # a friction of zero has no relative change
    Z = np.maximum(posterior.values(posterior.b), 1e-3 * rig.nominal)
    places, alone = posterior.visible, posterior.alone
    names = of_inner_rod(Z[PARAMETERS.index("mb")]) if alone else PARAMETERS
    columns, square = [PARAMETERS.index(name) for name in names], np.ix_(places, places)
    per = np.linalg.inv(posterior.as_observed(posterior.unknown)[1][square])
    values, slopes = observed(Z, rig, places, alone, posterior.clamped)
    root = information_root(per.T @ information @ per, values)
    of_recordings = (root * values @ slopes)[:, columns]
    rows = InformationRows.of(of_recordings, {name: rig.parameters[name] for name in names}, Z[columns])
    # with a clamped elbow, the ratios to b are shown as the fit determines them, with the assumed a/b and d/b
    shown = values if alone else unknown_ratios(whole_parameters(Z, rig.L1, rig.g))[list(places)]
    root_of_shown = root if alone else information_root(information, shown)
    unknowns = [UNKNOWN_RATIOS[i].replace("b", "a") if alone else UNKNOWN_RATIOS[i] for i in places]
    return Identifiability(
        **rows.directions(rod_measurements(names, Z, rig)),
        unknowns=_named(unknowns, shown),
        cramer_rao_std=_named(unknowns, shown * spread(root_of_shown * shown)),
        parameters=_parameters(rows, posterior, Z[columns]),
        helps=_helps(rows, rig),
        length_error=_length_error(rig, Z) if lengths and rig.poses and not alone else None,
    )


def summary(analysis: Identifiability) -> dict[str, Any]:
    """Summarise the analysis for `model.json`: rank, free directions and recommendations."""
    return {
        "rank": analysis.rank,
        "null_space": [dict(direction) for direction in analysis.null_space],
        "advice": [advice.sentence for advice in analysis.advice],
    }


def _bounded_spread(known: Array, bounds: Array) -> Array:
    return spread(np.vstack([known, bounds]), least=0.0)


def _parameters(rows: InformationRows, posterior: Posterior, Z: Array) -> dict[str, ParameterValue]:
    loose, std = np.isinf(spread(rows.known)), Z * _bounded_spread(rows.known, rows.bounds)
    reach, wide = NORMAL_Q90 * std, posterior.intervals(posterior.b)
    return {
        name: ParameterValue(
            value=float(Z[i]),
            std=None if loose[i] else float(std[i]),
            fixed_by="measured"
            if posterior.rig.parameters[name].measured is not None
            else "bound"
            if loose[i]
            else "data",
            interval90=wide[name] if loose[i] else (float(Z[i] - reach[i]), float(Z[i] + reach[i])),
        )
        for i, name in enumerate(rows.names)
    }


def _helps(rows: InformationRows, rig: Rig) -> dict[str, tuple[str, ...]]:
    measured = rows.measured
    names = [name for name in rows.names if rig.parameters[name].measured is not None]
    with_all = _bounded_spread(rows.known, rows.bounds)
    helped = {}
    for i, name in enumerate(names):
        weak = measured[i : i + 1] * 1e-6  # small instead of zero, because a measured value may have no bounds
        others = np.delete(measured, i, axis=0)
        without = _bounded_spread(np.vstack([rows.of_recordings, others, weak]), rows.bounds)
        helped[name] = tuple(
            p for p, grown in zip(rows.names, without > SETTINGS.helps * with_all, strict=True) if grown and p != name
        )
    return helped


def _advice(answers: Mapping[Measurement, Array], known: Array, rows: InformationRows) -> dict[Measurement, Advice]:
    """Compute the expected gain of each bench measurement, in addition to the rows `known` (m, n)."""
    loose, before = np.isinf(spread(known)), _bounded_spread(known, rows.bounds)
    advice = {}
    for instrument, answer in answers.items():
        more = np.vstack([known, answer])
        freed = loose & ~np.isinf(spread(more)) if loose.any() else loose
        gain = np.sum(np.log2(before / _bounded_spread(more, rows.bounds)))
        frees = tuple(name for name, is_freed in zip(rows.names, freed, strict=True) if is_freed)
        advice[instrument] = Advice(
            instrument.name, instrument.how, frees, float(gain), instrument.quantity, len(rows.names)
        )
    return advice


def _worth(advice: Advice) -> tuple[int, float]:
    return len(advice.frees), advice.gain_bits


def _bench_sequence(answers: Mapping[Measurement, Array], rows: InformationRows) -> tuple[Advice, ...]:
    """Choose the best measurement repeatedly until all parameters are determined or no gain is worthwhile."""
    known = rows.known
    open_measurements, taken = dict(answers), []
    while open_measurements and np.isinf(spread(known)).any():
        advice = _advice(open_measurements, known, rows)
        best = max(advice, key=lambda instrument: _worth(advice[instrument]))
        if advice[best].gain_bits < SETTINGS.worthwhile_bits:
            break
        taken.append(advice[best])
        known = np.vstack([known, open_measurements.pop(best)])
    return tuple(taken)


def _length_error(rig: Rig, Z: Array, error: float = 1e-3) -> LengthError:
    problem, estimate = expected_releases(base_parameters(Z, rig.L1, rig.g), rig, list(rig.poses.values()))
    wrong = problem.with_constants(problem.model.constants._replace(L1=rig.L1 + error))
    refitted = fit_ratios(wrong, estimate)
    shift = refitted.ratios / estimate.ratios[: len(RATIOS)] - 1
    return LengthError(error, _named(RATIOS, shift), float(np.sqrt(1 + refitted.chi2_per_dof)))


def _named(names: Sequence[str], values: Array) -> dict[str, float]:
    return dict(zip(names, values.tolist(), strict=False))
