"""What is fitted: segments of all runs in one layout, and the readings that a point of the unknowns predicts."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from dpr_lab.dynamics.base import RATIOS, base_from_ratios
from dpr_lab.dynamics.known import known_of
from dpr_lab.dynamics.readings import Pieces, memories, pieces, readings, readings_batch, started
from dpr_lab.dynamics.sensors import misread_batch
from dpr_lab.effects import EFFECTS, SLICES, place
from dpr_lab.effects.effect import Effect
from dpr_lab.effects.quantities import Known
from dpr_lab.gap.record import Record, cuts, start_states
from dpr_lab.rig import Rig

Array = NDArray[np.float64]

START_STEPS = np.array([1e-6, 1e-6, 1e-5, 1e-5])  # rad, rad/s
RELATIVE_STEP = 1e-5
OF_SHAPE = 1e-5  # the same of a shape: a frequency off by 1e-3 is out of phase after ten seconds
OF_TYPICAL = 1e-3  # forward step of an effect's parameter, of its typical size

ARM = [place("arm_compliance", name) for name in ("coupling_per_kg", "frequency_hz")]
PER_PERIOD, FINEST = 40.0, 4.0  # steps of the integrator in a period of the arm, and how much finer they get for it
COARSER = 2.0  # the integrator's step for derivatives, in steps for readings

FIRST_S = 0.25
"""Length from which any rig file within 20 % of the truth converges, s."""

CONTINUOUS = ("speed_rad_per_s", "length_rad", "frequency_hz", "damping_ratio")
"""Shape parameters that are refined after their scan; orders and instants are not."""

UNKNOWN_RODS = (*RATIOS, "b")
FRICTION = (3, 4)  # c1/b, c2/b cannot be negative


@dataclass(frozen=True, slots=True)
class Point:
    """One value of everything unknown."""

    rods: Array
    """(6,) the five ratios, and b, kg m^2."""
    vector: Array
    """(SIZE,) parameters of all effects, SI."""
    starts: Array
    """(segments, 4) states at the start of each segment."""

    @property
    def base(self) -> Array:
        """(6,) base parameters, SI."""
        return self.rods[5] * base_from_ratios(self.rods[:5])


@dataclass(frozen=True, slots=True)
class Slot:
    """One unknown besides the start states."""

    name: str
    effect: str | None
    """The effect it belongs to; none for a ratio."""
    at: int
    """Its place in `Point.rods` or `Point.vector`."""
    step: float
    """Forward step of its derivative."""
    lower: float = -np.inf
    size: float = 1.0
    """How large it may be expected to be."""
    overrides: tuple[tuple[int, float], ...] = ()
    """Entries of the vector that hold only while this slot is moved: the shape parameters of an effect that is off."""

    @property
    def rods(self) -> bool:
        """Whether it is a ratio."""
        return self.effect is None

    def read(self, point: Point) -> float:
        """Its value at a point."""
        return float((point.rods if self.rods else point.vector)[self.at])


def rod_slots(point: Point, scale_visible: bool = False) -> tuple[Slot, ...]:
    """The ratios; b too where something makes it visible."""
    count = len(UNKNOWN_RODS) if scale_visible else len(RATIOS)
    return tuple(
        Slot(
            UNKNOWN_RODS[i],
            None,
            i,
            RELATIVE_STEP * max(abs(float(point.rods[i])), 1e-2),
            lower=0.0 if i in FRICTION else -np.inf,
            size=max(abs(float(point.rods[i])), 1e-2),
        )
        for i in range(count)
    )


def effect_slots(
    effect: Effect, *, refined: bool = False, overrides: tuple[tuple[int, float], ...] = ()
) -> tuple[Slot, ...]:
    """The amplitudes of an effect; where `refined`, also those shapes that vary continuously."""
    slots = []
    for at, parameter in enumerate(effect.parameters, start=SLICES[effect.name].start):
        shape = parameter.role == "shape"
        if shape and not (refined and parameter.name in CONTINUOUS):
            continue
        lower = parameter.scan[0] / 5 if shape else (0.0 if parameter.sign == "positive" else -np.inf)
        step = (OF_SHAPE if shape else OF_TYPICAL) * parameter.typical
        slots.append(Slot(parameter.name, effect.name, at, step, lower, parameter.typical, overrides))
    return tuple(slots)


OF_ENCODERS = [slot.at for effect in EFFECTS.values() if effect.stage == "encoder" for slot in effect_slots(effect)]
"""Places in the vector of the amplitudes of what encoders misread."""


def _of_encoder(slot: Slot) -> bool:
    return slot.effect is not None and EFFECTS[slot.effect].stage == "encoder"


@dataclass(frozen=True, slots=True)
class Problem:
    """Segments of all runs, padded to one length: row 2 k + j of a segment is its sample k of joint j + 1."""

    rig: Rig
    known: Known
    records: tuple[Record, ...]
    pieces: Pieces
    measured: Array
    """(samples, 2) encoder readings, rad."""
    weight: Array
    """(samples, 2) one over the standard deviation, times the root of a robust weight, 1/rad."""
    length: float
    """Wanted length of a segment, s."""

    @property
    def t(self) -> Array:
        """(samples,) since the release, s."""
        return self.pieces.t

    @property
    def offsets(self) -> NDArray[np.int64]:
        """(segments + 1,) where the segments begin among the samples."""
        return self.pieces.offsets

    @property
    def run(self) -> NDArray[np.int64]:
        """(segments,) index of the run of each."""
        return self.pieces.run

    @property
    def relative(self) -> bool:
        """Whether the encoder of joint 2 reads theta2 - theta1."""
        return self.known.relative2 == 1.0

    @property
    def spans(self) -> list[tuple[float, float]]:
        """First and last instant that each segment is integrated over, s."""
        return [(started(float(self.t[i])), float(self.t[j - 1])) for i, j in pairwise(self.offsets)]

    @property
    def _rows(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        sizes = np.diff(self.offsets)
        segment = np.repeat(np.arange(len(sizes)), sizes)
        return segment, np.arange(len(self.t)) - self.offsets[segment]

    def whitened(self, values: Array) -> Array:
        """(segments, m) or (segments, m, k) from (samples, 2) or (samples, 2, k): weighted, padded with zeros."""
        segment, place = self._rows
        with np.errstate(over="ignore"):
            weighted = values * self.weight.reshape(*self.weight.shape, *[1] * (values.ndim - 2))
        padded = np.zeros((len(self.run), int(np.diff(self.offsets).max()), *values.shape[1:]))
        padded[segment, place] = weighted
        return padded.reshape(len(padded), -1, *values.shape[2:])

    def by_sample(self, whitened: Array) -> Array:
        """(samples, 2) from (segments, m)."""
        segment, place = self._rows
        return whitened.reshape(len(whitened), -1, 2)[segment, place]

    def readings(self, point: Point) -> Array:
        """(samples, 2) what the encoders would read at a point, rad."""
        return readings(point.base, point.vector, self.known, self._stepped(point), point.starts)

    def _stepped(self, point: Point) -> Pieces:
        """The segments with steps that are short enough for the arm to vibrate as it would."""
        coupling, frequency = point.vector[ARM]
        if coupling == 0.0:
            return self.pieces
        finer = min(max(PER_PERIOD * frequency * self.pieces.step, 1.0), FINEST)
        return replace(self.pieces, step=self.pieces.step / finer)

    def predict(self, point: Point, slots: Sequence[Slot] = ()) -> tuple[Array, Array]:
        """Readings at a point, and their derivatives by forward differences at twice the integrator's step.

        A slope that is off by a thousandth moves no solution of a fit, and half the steps are half the time.

        Returns:
            (samples, 2), rad, and (samples, 2, slots + 4), the last four by the start state of each segment
        """
        rows = 1 + len(slots)  # that of the point itself, and one for each slot; the start states come after
        rods, vectors = np.tile(point.rods, (rows + 4, 1)), np.tile(point.vector, (rows + 4, 1))
        starts = np.tile(point.starts, (rows + 4, 1, 1))
        for i, slot in enumerate(slots, start=1):
            for at, value in slot.overrides:
                vectors[i, at] = value
            (rods if slot.rods else vectors)[i, slot.at] += slot.step
        for j in range(4):
            starts[rows + j, :, j] += START_STEPS[j]
        # The effects that remember are not to feel the start of the segment before, nor the difference of the steps.
        fine = self._stepped(point)
        coarse = replace(fine, step=COARSER * fine.step)
        memory = np.full((rows + 4, len(self.run), 5), np.nan)
        memory[rows:] = memories(point.base, point.vector, self.known, coarse, point.starts)
        # What encoders misread moves no rod: the swing of the point does for all of it.
        misread = np.array([True, *(_of_encoder(slot) for slot in slots), *[False] * 4])
        moving = np.flatnonzero(~misread)
        swung = [0, *moving]
        bases = rods[swung, 5:] * base_from_ratios(rods[swung, :5])
        seen = vectors[swung]
        seen[0, OF_ENCODERS] = 0.0
        swings = readings_batch(bases, seen, self.known, coarse, starts[swung], memory[swung])
        angles = np.empty((rows + 4, len(self.t), 2))
        angles[moving] = swings[1:]
        angles[misread] = misread_batch(swings[0], self.t, self.offsets, self.run, self.known, vectors[misread])
        steps = np.array([*(slot.step for slot in slots), *START_STEPS])
        slopes = np.moveaxis(angles[1:] - angles[0], 0, -1) / steps
        return self.readings(point), slopes

    def costs(self, point: Point) -> Array:
        """(segments,) sum of squared whitened residuals; inf where a segment cannot be simulated."""
        with np.errstate(over="ignore", invalid="ignore"):
            squares = np.sum(((self.measured - self.readings(point)) * self.weight) ** 2, axis=1)
        return np.nan_to_num(np.add.reduceat(squares, self.offsets[:-1]), nan=np.inf)

    def cost(self, point: Point) -> float:
        """Sum over all segments."""
        return float(self.costs(point).sum())


def problem(records: Sequence[Record], rig: Rig, length: float) -> tuple[Problem, Array]:
    """Cut records into segments, and guess their start states from the readings.

    Args:
        records: the runs
        rig: lengths, masses, encoders
        length: wanted length of a segment, s

    Returns:
        the problem, and (segments, 4) start states
    """
    stretches = [(i, s) for i, item in enumerate(records) for s in cuts(item, length)]
    absolute = rig.encoders.joint2 == "absolute"
    made = Problem(
        rig=rig,
        known=known_of(rig),
        records=tuple(records),
        pieces=pieces(
            [records[i].t[s] for i, s in stretches],
            [i for i, _ in stretches],
            [item.run.added_mass for item in records],
        ),
        measured=np.concatenate([records[i].joints[s] for i, s in stretches]),
        weight=np.concatenate([1 / records[i].sigma[s] for i, s in stretches]),
        length=length,
    )
    starts = [start_states(item, cuts(item, length), absolute) for item in records]
    return made, np.concatenate(starts)


def carried(short: Problem, point: Point, longer: Problem, starts: NDArray[np.float64]) -> NDArray[np.float64]:
    """Start states that another cut found, where it cut at the same instant; `starts` elsewhere."""
    begins = {(int(r), float(short.t[i])): s for r, i, s in zip(short.run, short.offsets, point.starts, strict=False)}
    return np.array(
        [
            begins.get((int(r), float(longer.t[i])), own)
            for r, i, own in zip(longer.run, longer.offsets, starts, strict=False)
        ]
    )
