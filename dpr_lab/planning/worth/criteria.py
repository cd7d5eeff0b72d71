"""Value of information: bits about the causes, other library effects, and the ratios.

**Causes (T-optimality).** Suppose that A is the true cause, with amplitudes a. The squared distance between the
readings under A and the nearest readings under B, with ratios and all other effects of the model fitted, is

    D^2(A, B) = a^T (G_AA - G_AB G_BB^-1 G_BA) a + trace((G_AA - G_AB G_BB^-1 G_BA) cov(a)),

where G is the information about both, given the fitted unknowns. The trace is the contribution of the posterior
uncertainty of a. Let d^2 = Delta D^2 / T, where T is the temperature of the probabilities of a diagnosis. A further
recording increases the log odds of the true cause by a normally distributed amount of mean d^2 / 2 and variance d^2.
The value of the recording is the expected reduction of the entropy between both causes, given their present
probabilities.

**Library.** A plan must not assume that the causes named so far are correct. The expected information is therefore also
computed for each pair of amplitudes of the library, and for each amplitude against no effect, at several sizes and
equal prior odds. The value is the mean.

**Effects that are not excluded.** Even if no gap is visible, or the named causes explain it, other amplitudes may still
have their minimum detectable size. For each such amplitude, the expected information against no effect is computed, at
this size and equal prior odds.

**Ratios (D-optimality).** The value is log2 of the factor by which the volume of the covariance of the ratios
decreases, with the effects of the model fitted.

The functions accept the information matrices of several candidate releases at once, (..., k, k); the result has the
same leading axes.

Sources: G. E. P. Box & W. J. Hill (1967), Discrimination among mechanistic models, Technometrics 9, 57-71. A. C.
Atkinson & V. V. Fedorov (1975), The design of experiments for discriminating between two rival models, Biometrika 62,
57-70. K. Chaloner & I. Verdinelli (1995), Bayesian experimental design: a review, Statistical Science 10, 273-304.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from dpr_lab.arrays import Array
from dpr_lab.dynamics.base import RATIOS
from dpr_lab.effects import EFFECTS
from dpr_lab.fitting.estimate import SCALE
from dpr_lab.gap.advice.check_kind import expected_bits
from dpr_lab.gap.hypothesis.calibration import CALIBRATION
from dpr_lab.gap.hypothesis.detectable import SIGMAS, comparable_size
from dpr_lab.gap.mounted_ratios import ratio_of
from dpr_lab.gap.result.evidence import Exclusion
from dpr_lab.planning.knowledge import RATIO_COLUMNS, Knowledge, diagonal, schur_complement
from dpr_lab.planning.stopping import Causes, not_excluded, recurring


@dataclass(frozen=True, slots=True)
class Worth:
    """Weights and thresholds of the objective function of a plan."""

    library: float = 0.3
    """Weight of a bit about the library while causes are undecided, so that a plan can detect unexpected causes."""
    ratios: float = 0.02
    """Weight of a bit about the ratios, which matters once the causes are decided."""
    limits: float = 0.3
    """Weight of a bit about a limited quantity; the bits are log2 of its standard deviation."""
    sizes: tuple[float, ...] = (0.1, 0.3, 1.0)
    """Sizes of the library's amplitudes for which bits are computed, in units of their typical size."""
    least: float = 0.01
    """Minimum probability of a candidate cause that is considered."""
    seen: float = 1e-6
    """Minimum share of the information about an amplitude that remains after the other unknowns are fitted.

    An amplitude with a smaller share is not detectable.
    """
    certain: float = 1e3
    """d^2 of a cause and its richer form, if a diagnosis leaves out the richer form."""


WORTH = Worth()


@dataclass(frozen=True, slots=True)
class OpenPairs:
    """Candidate causes of one named effect, with the estimated amplitudes of each cause."""

    names: tuple[str, ...]
    probabilities: Array
    """(n,) probability of each cause."""
    outside: float
    """Probability of all other causes: outside the library, undetectable in the release, or improbable."""
    fitted: tuple[int, ...]
    """Columns of the unknowns that every fit estimates."""
    places: tuple[tuple[int, ...], ...]
    """Columns of the unknowns that belong to each cause."""
    sizes: tuple[Array, ...]
    """Estimated amplitudes of each cause, if it is the true cause."""
    spreads: tuple[Array, ...]
    """Covariance of the amplitudes of each cause."""

    @classmethod
    def of(cls, known: Knowledge, causes: Causes) -> "OpenPairs":
        """Select the causes that are probable enough and detectable in a release."""
        probable = {name: p for name, p in causes.probabilities.items() if name in known.places and p > WORTH.least}
        places = tuple(known.places[name] for name in probable)
        about = known.places.get(causes.about, ())
        target = known.amplitudes[list(about)]
        others = tuple(i for i in known.fitted if i not in about)
        sizes, spreads = [], []
        for of_cause in places:
            G, n = schur_complement(known.information, others, list(dict.fromkeys((*of_cause, *about)))), len(of_cause)
            spreads.append(np.linalg.pinv(G[:n, :n], 1e-12, hermitian=True))
            sizes.append(target if of_cause == about else spreads[-1] @ (G[:n, n:] @ target))
        p = np.array([*probable.values()])
        outside = min(causes.outside + sum(causes.probabilities.values()) - float(p.sum()), 1.0)
        return cls((*probable,), p, outside, others, places, tuple(sizes), tuple(spreads))

    def distances(self, F: Array) -> Array:
        """Return the (..., n, n) expected squared distances D^2 between the causes.

        An entry is the distance of the readings under one cause (row) from the nearest readings under another (column).
        """
        columns = list(dict.fromkeys(i for places in self.places for i in places))
        G = schur_complement(F, self.fitted, columns)
        rows = [[columns.index(i) for i in places] for places in self.places]
        moments = np.zeros((len(rows), *G.shape[-2:]))  # E[a a^T] of the amplitudes of each cause
        squared = np.zeros((*G.shape[:-2], len(rows), len(rows)))
        for i, (places, size, spread) in enumerate(zip(rows, self.sizes, self.spreads, strict=True)):
            moments[i][np.ix_(places, places)] = np.outer(size, size) + spread
        for nearest, places in enumerate(rows):
            inverse = np.linalg.pinv(G[..., *np.ix_(places, places)], 1e-12, hermitian=True)
            remaining = G - G[..., places] @ inverse @ G[..., places, :]
            remaining[..., places, :] = remaining[..., places] = 0.0
            squared[..., nearest] = np.maximum(np.einsum("...ij,cij->...c", remaining, moments), 0.0)
        return squared


def is_detectably_richer(known: Knowledge, F: Array, name: str, other: str) -> bool:
    """Return whether a richer form (`other`) of a named effect has a detectable additional amplitude.

    The rule is that of a diagnosis (`dpr_lab.gap.classes.posterior`).
    """
    if name not in known.named or name not in EFFECTS[other].nested:
        return False
    params, least = known.model.estimate.params, detectable(known, F, SIGMAS, [other], at_assumed_scale=True)[other]
    sizes = ((least[p.name], comparable_size(params, EFFECTS[name], p)) for p in EFFECTS[other].amplitudes)
    return any(size is not None and size <= CALIBRATION.hidden * of_named for size, of_named in sizes)


def cause_bits(pairs: OpenPairs, gained: Array) -> dict[tuple[str, str], Array]:
    """Return the (...,) expected bits about the most probable cause and each other cause, by pair of names."""
    p, best, bits = pairs.probabilities, int(np.argmax(pairs.probabilities)), dict[tuple[str, str], Array]()
    for other, name in enumerate(pairs.names):
        if other != best:
            d2 = (p[best] * gained[..., best, other] + p[other] * gained[..., other, best]) / (p[best] + p[other])
            bits[pairs.names[best], name] = _bits(np.sqrt(d2), float(p[best]), float(p[other]))
    return bits


def _bits(d: Array, first: float = 0.5, second: float = 0.5) -> Array:
    """Return the interpolated expected bits for distances d between two causes with given probabilities.

    The error of the interpolation is at most 0.002 bits.
    """
    return np.interp(d, *_table(first, second))


@lru_cache(maxsize=256)
def _table(first: float, second: float) -> tuple[Array, Array]:
    """Return distances d, and the expected bits at these distances."""
    separations = np.concatenate([np.linspace(0.0, 4.0, 41), np.linspace(4.5, 20.0, 32)])
    return separations, np.array([expected_bits([first, second], d) for d in separations.tolist()])


def library_bits(known: Knowledge, F: Array) -> Array:
    """Compute the (...,) mean expected bits about the amplitudes of the library, at even odds.

    The mean covers all comparisons of two amplitudes, and all comparisons of one amplitude with no effect.
    """
    columns = [i for i in range(RATIO_COLUMNS, F.shape[-1]) if known.model.columns[i].effect not in known.named]
    G = schur_complement(F, known.fitted, columns)
    power = np.maximum(diagonal(G), 0.0)
    typical = np.array([known.model.columns[i].size for i in columns])
    effects = np.array([known.model.columns[i].effect for i in columns])
    first, second = np.nonzero(effects[:, None] != effects)
    apart = power[..., first] - G[..., first, second] ** 2 / np.where(power > 0, power, 1.0)[..., second]
    d2 = np.concatenate([power, np.maximum(apart, 0.0)], axis=-1) / CALIBRATION.temperature
    d = np.append(typical, typical[first]) * np.sqrt(d2)
    return np.mean([_bits(size * d).mean(axis=-1) for size in WORTH.sizes], axis=0)


@dataclass(frozen=True, slots=True)
class OpenAmplitudes:
    """Tested amplitudes of the library, and the information about them before and after further recordings."""

    tested: tuple[Exclusion, ...]
    """Test of each amplitude."""
    before: Array
    """(n, n) information about the amplitudes from the recordings, with the unknowns of the model fitted."""
    after: Array
    """(n, n) information about the amplitudes after further recordings."""

    @classmethod
    def of(cls, known: Knowledge, F: Array, excluded: bool = False) -> "OpenAmplitudes":
        """Select the amplitudes that are not excluded, with their information.

        There are none if part of the gap is unexplained.

        Args:
            known: the current knowledge
            F: (..., k, k) information
            excluded: whether to include the amplitudes that the recordings exclude
        """
        diagnosis, places = known.diagnosis, dict[int, Exclusion]()
        if diagnosis is not None and diagnosis.verdict in ("no_gap", "named"):
            exclusions = recurring(diagnosis) if excluded else not_excluded(diagnosis)
            tested = {(amplitude.effect, amplitude.parameter): amplitude for amplitude in exclusions}
            for i, column in enumerate(known.model.columns):
                if test := tested.get((column.effect, column.name)):
                    places[i] = test
        if not places:
            return cls((), np.zeros((0, 0)), np.zeros((*F.shape[:-2], 0, 0)))
        before, after = (
            schur_complement(information, known.fitted, [*places]) for information in (known.information, F)
        )
        visible = np.flatnonzero(np.diag(before) > 0.0)  # an amplitude without information has no estimate
        tests, rows = [*places.values()], np.ix_(visible, visible)
        return cls(tuple(tests[i] for i in visible), before[rows], after[..., *rows])


def open_bits(known: Knowledge, F: Array) -> Array:
    """Return the (...,) mean expected bits about the amplitudes that are not excluded.

    The value is 0 if part of the gap is unexplained, or if all amplitudes are excluded.
    """
    amplitudes = OpenAmplitudes.of(known, F)
    if not amplitudes.tested:
        return np.zeros(F.shape[:-2])
    size = np.array([amplitude.size for amplitude in amplitudes.tested])
    added = diagonal(amplitudes.after - amplitudes.before)
    return np.mean(_bits(size * np.sqrt(np.maximum(added, 0.0) / CALIBRATION.temperature)), axis=-1)


def ratio_bits(known: Knowledge, F: Array) -> Array:
    """Return the (...,) values of -1/2 log2 det C for the covariance C of the ratios, in bits.

    The ratios are in units of their sizes, and the other unknowns of the model are fitted.
    """
    scale = np.array([column.size for column in known.model.columns[: len(RATIOS)]])
    return 0.5 * np.linalg.slogdet(_ratio_information(known, F) * scale[:, None] * scale)[1] / np.log(2)


def ratio_std(known: Knowledge, F: Array) -> Array:
    """Return the (5,) expected standard deviations of the ratios, with the effects of the model fitted."""
    return np.sqrt(np.diag(np.linalg.inv(_ratio_information(known, F))))


def _ratio_information(known: Knowledge, F: Array) -> Array:
    """Return the (..., 5, 5) information about the ratios with the other unknowns of the model fitted."""
    return schur_complement(F, [i for i in known.fitted if i >= len(RATIOS)], range(len(RATIOS)))


def shown_ratio_std(known: Knowledge, F: Array) -> dict[str, float]:
    """Return the standard deviations of the ratios that a release determines.

    These are ratios of rods, arm and drive. The unknowns contain a parameter x of arm or drive and the scale b, but a
    release may determine only the ratio r = x / b. To first order, the variance of b r is that of x - r b.
    """
    estimate, alone = known.model.estimate, bool(known.hidden_ratios) and known.rig.rods.mounted == "inner"
    of_arm = [place for name in sorted(known.always) for place in known.places.get(name, ())]
    places = [*(place for place in range(len(RATIOS)) if place not in known.hidden_ratios), *of_arm]
    nuisance = [place for place in known.fitted if place not in (*places, SCALE)]
    covariance = np.linalg.inv(schur_complement(F, nuisance, [*places, SCALE]))
    shown: dict[str, float] = {}
    for i, place in enumerate(places):
        ratio = ratio_of(known.model.columns[place], estimate, known.rig, alone=alone)
        if ratio is not None:
            name, value, divisor = ratio
            change = np.zeros(len(covariance))
            change[i], change[-1] = 1.0, -value * divisor / estimate.ratios[SCALE] if place in of_arm else 0.0
            variance = float(change @ covariance @ change)
            if variance > 0:  # not so, by rounding, if the release does not determine the ratio
                shown[name] = variance**0.5 / divisor
    return shown


def detectable(
    known: Knowledge, F: Array, sigmas: float, names: Iterable[str] | None = None, *, at_assumed_scale: bool = False
) -> dict[str, dict[str, float | None]]:
    """Return the minimum detectable size of each amplitude, SI: a given number of standard deviations.

    The size is None if the amplitude is not detectable.

    Args:
        known: the current knowledge
        F: (k, k) information
        sigmas: number of standard deviations
        names: names of the effects; None: all effects
        at_assumed_scale: whether the sizes hold for the assumed b, as in a diagnosis; otherwise they contain the
            uncertainty of b
    """
    sizes: dict[str, dict[str, float | None]] = {}
    fitted = [i for i in known.fitted if not (at_assumed_scale and i == SCALE)]
    for name in known.places if names is None else names:
        places = list(known.places.get(name, ()))
        power = np.diag(schur_complement(F, [i for i in fitted if i not in places], places))
        prior = np.diag(known.prior)[places]
        visible = power - prior > np.maximum(WORTH.seen * np.diag(F)[places], prior)
        for i, place in enumerate(places):
            size = float(sigmas / np.sqrt(power[i] - prior[i])) if visible[i] else None
            sizes.setdefault(name, {})[known.model.columns[place].name] = size
    return sizes
