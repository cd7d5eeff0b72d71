"""Tables of a rig without effects, each with one typical mistake of loggers or users.

Every table stems from a simulated rig that differs from its model by nothing: what a command names on one of them is a
mistake in the table, never an effect of the rig. `mutated_tables` is deterministic.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dpr_lab.rig import Rig, load_rig
from dpr_lab.storage.csv_import import ImportOptions
from sim_device.plant.config import load_plant
from sim_device.plant.drives import JointDrives
from sim_device.trials.offline_recorder import record

RATE_HZ = 200
DURATION_S = 3.0
ANGLES = ("theta1", "theta2")


@dataclass(frozen=True, slots=True, eq=False)
class Sheet:
    """Named columns, and the form in which they are written and imported."""

    columns: Mapping[str, NDArray[np.float64]]
    """Columns (n,) by name; `t` in s, `theta1` and `theta2` in the unit of the options."""
    options: Mapping[str, Any] = field(default_factory=dict)
    """Of `ImportOptions`: true of the table before its mutation."""
    delimiter: str = ","
    names: Mapping[str, str] = field(default_factory=dict)
    """Of the columns in the header, where they differ."""

    def text(self) -> bytes:
        """Text of the table as written by a logger."""
        rows = np.column_stack(list(self.columns.values())).tolist()
        lines = [self.delimiter.join(f"{value:.10g}" for value in row) for row in rows]
        header = self.delimiter.join(self.names.get(name, name) for name in self.columns)
        return "\n".join([header, *lines, ""]).encode()

    def with_columns(self, **columns: NDArray[np.float64]) -> "Sheet":
        """Copy of the sheet with other values in these columns."""
        return replace(self, columns={**self.columns, **columns})

    def rows(self, keep: Any) -> "Sheet":
        """Copy of the sheet with only these rows, in this order."""
        return replace(self, columns={name: column[keep] for name, column in self.columns.items()})

    def without(self, *names: str) -> "Sheet":
        """Copy of the sheet without these columns."""
        return replace(self, columns={name: column for name, column in self.columns.items() if name not in names})

    @property
    def n(self) -> int:
        """Number of rows."""
        return len(next(iter(self.columns.values())))


@dataclass(frozen=True, slots=True, eq=False)
class MutatedTable:
    """Table with a mistake."""

    name: str
    """Names of base table and mutation, for example `free/swapped_angles`."""
    mutation: str
    written: Sheet | bytes
    options: ImportOptions
    """How its user imports it."""

    @property
    def content(self) -> bytes:
        """Bytes of the file; the text of a sheet is made only when it is needed."""
        return self.written if isinstance(self.written, bytes) else self.written.text()

    def write(self, folder: Path) -> Path:
        """Write the file into a folder, with the name of the table."""
        file = folder / f"{self.name.replace('/', '-')}.csv"
        file.write_bytes(self.content)
        return file


Mutation = Callable[[Sheet, np.random.Generator], Sheet | bytes]


def base_tables(seed: int = 1, rig: Rig | None = None) -> dict[str, Sheet]:
    """Tables without a mistake, of a rig without effects: free swings and a driven swing.

    Args:
        seed: of the simulated encoders' noise
        rig: that was recorded; the published one by default
    """
    rig = rig or load_rig("paper")
    plant = load_plant("paper", seed)
    x1, x2, x3 = record(plant, rig, DURATION_S, RATE_HZ)
    t = np.arange(0, DURATION_S + 0.01, 0.01)
    drives = JointDrives(t, 0.1 * np.sin(7 * np.stack([t, t + 1], axis=1)), plant.drives, seed)
    driven = record(plant, rig, DURATION_S, RATE_HZ, drives)[0].swing
    assert driven.torques is not None
    degrees = np.degrees(x3.swing.theta - np.pi)
    counts = x2.swing.counts
    assert counts is not None
    counted = {f"counts{k}": counts[:, k].astype(float) for k in (1, 2)}
    free = Sheet(_angles(x1.swing.t, x1.swing.theta), {"pose": "X1"})
    return {
        "free": free,
        "wild": Sheet(_angles(x2.swing.t, x2.swing.theta)),
        "degrees": Sheet(
            {"t": x3.swing.t, "theta1": degrees[:, 1], "theta2": degrees[:, 2] - degrees[:, 1]},
            {"unit": "deg", "zero": "hanging", "angles": "relative", "pose": "X3"},
        ),
        "counts": Sheet({"t": x2.swing.t, **counted}, {"unit": "counts", "pose": "X2"}),
        "driven": Sheet(
            {**_angles(driven.t, driven.theta), "tau1_Nm": driven.torques[:, 0], "tau2_Nm": driven.torques[:, 1]}
        ),
    }


def mutated_tables(seed: int = 1, rig: Rig | None = None) -> list[MutatedTable]:
    """Every base table with every mutation that applies to it, and unchanged (`none`): about 400 tables."""
    return list(_mutated(seed, rig))


def doubly_mutated(base: str, sheet: Sheet, seed: int) -> MutatedTable:
    """Table with two random mistakes."""
    rng = np.random.default_rng(seed)
    while True:
        first, second = rng.choice(list(MUTATIONS), 2, replace=False).tolist()
        if not {*NEEDS.get(first, ()), *NEEDS.get(second, ())} <= set(sheet.columns):
            continue
        half = MUTATIONS[first](sheet, rng)
        if isinstance(half, bytes) or not {*NEEDS.get(second, ())} <= set(half.columns) or len(_readings(half)) < 2:
            continue
        whole = MUTATIONS[second](half, rng)
        options = half.options if isinstance(whole, bytes) else whole.options
        return MutatedTable(f"{base}/{first}+{second}", f"{first}+{second}", whole, ImportOptions(**options))


def _mutated(seed: int, rig: Rig | None) -> Iterator[MutatedTable]:
    for base, sheet in base_tables(seed, rig).items():
        for number, (name, mutation) in enumerate(MUTATIONS.items()):
            needed = NEEDS.get(name, ())
            if not set(needed) <= set(sheet.columns):
                continue
            mutated = mutation(sheet, np.random.default_rng([seed, number]))
            options = sheet.options if isinstance(mutated, bytes) else mutated.options
            yield MutatedTable(f"{base}/{name}", name, mutated, ImportOptions(**options))


def _angles(t: NDArray[np.float64], theta: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    return {"t": t, "theta1": theta[:, 1], "theta2": theta[:, 2]}


def _readings(sheet: Sheet) -> list[str]:
    """Names of the columns of the two rods."""
    return [name for name in sheet.columns if name in (*ANGLES, "counts1", "counts2")]


def _each(sheet: Sheet, change: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> Sheet:
    """Change the readings of both rods in the same way."""
    return sheet.with_columns(**{name: change(sheet.columns[name]) for name in _readings(sheet)})


def _second(sheet: Sheet, change: Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]) -> Sheet:
    """Compute the readings of the second rod from those of both rods."""
    first, second = _readings(sheet)
    return sheet.with_columns(**{second: change(sheet.columns[first], sheet.columns[second])})


def _first(sheet: Sheet, change: Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]]) -> Sheet:
    """Compute the readings of the first rod from those of both rods."""
    first, second = _readings(sheet)
    return sheet.with_columns(**{first: change(sheet.columns[first], sheet.columns[second])})


def _options(**options: Any) -> Mutation:
    """Unchanged table that is imported with a wrong option."""
    return lambda sheet, _: replace(sheet, options={**sheet.options, **options})


def _time(change: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> Mutation:
    return lambda sheet, _: sheet.with_columns(t=change(sheet.columns["t"]))


def _keep(keep: Callable[[int], Any]) -> Mutation:
    return lambda sheet, _: sheet.rows(keep(sheet.n))


def _renamed(**names: str) -> Mutation:
    return lambda sheet, _: replace(sheet, names=names)


def _swapped(sheet: Sheet, _: np.random.Generator) -> Sheet:
    first, second = _readings(sheet)
    return sheet.with_columns(**{first: sheet.columns[second], second: sheet.columns[first]})


def _held(sheet: Sheet, rng: np.random.Generator, seconds: float, start: int = 0) -> Sheet:
    """Hold the rods for some time from a row on, with encoder noise. Later rows are delayed."""
    rows = round(seconds * RATE_HZ)
    keep = np.concatenate([np.arange(start + 1), np.full(rows, start), np.arange(start + 1, sheet.n)])
    held = sheet.rows(keep)
    noise = 0.5 if "counts1" in sheet.columns else 2e-4 * (57.3 if sheet.options.get("unit") == "deg" else 1.0)
    columns = {"t": np.arange(held.n) / RATE_HZ}
    for name in _readings(held):
        column = held.columns[name].copy()
        column[start : start + rows] += rng.normal(0, noise, rows)
        columns[name] = np.round(column) if "counts1" in sheet.columns else column
    for name in ("tau1_Nm", "tau2_Nm"):
        if name in held.columns:
            columns[name] = held.columns[name].copy()
            columns[name][start : start + rows] = 0.0
    return held.with_columns(**columns)


def _holes(value: float, share: float, column: int | None = None) -> Mutation:
    """Replace the readings of some rows by a value."""

    def mutation(sheet: Sheet, rng: np.random.Generator) -> Sheet:
        names = _readings(sheet) if column is None else [_readings(sheet)[column]]
        rows = rng.random(sheet.n) < share
        return sheet.with_columns(**{name: np.where(rows, value, sheet.columns[name]) for name in names})

    return mutation


def _wrapped(turn: float, sheet: Sheet) -> Sheet:
    """Wrap the readings at a number of turns."""
    period = {"deg": 360.0, "counts": 16384.0}.get(sheet.options.get("unit", "rad"), 2 * np.pi) * turn
    return _each(sheet, lambda x: np.mod(x, period))


def _doubled_rows(sheet: Sheet, rng: np.random.Generator) -> Sheet:
    return sheet.rows(np.sort(np.concatenate([np.arange(sheet.n), rng.integers(0, sheet.n, sheet.n // 5)])))


def _stale(sheet: Sheet, _: np.random.Generator) -> Sheet:
    """Simulate a logger that is faster than the sensor: every reading is repeated in five rows."""
    rows = np.arange(sheet.n) // 5 * 5
    return sheet.rows(rows).with_columns(t=sheet.columns["t"])


def _gap(sheet: Sheet, seconds: float) -> Sheet:
    t = sheet.columns["t"]
    return sheet.rows((t < 1.0) | (t > 1.0 + seconds))


def _jitter(sheet: Sheet, rng: np.random.Generator) -> Sheet:
    return sheet.with_columns(t=sheet.columns["t"] + rng.uniform(0, 0.9 / RATE_HZ, sheet.n))


def _noisy(sheet: Sheet, rng: np.random.Generator, size: float) -> Sheet:
    scale = {"deg": 57.3, "counts": 2607.6}.get(sheet.options.get("unit", "rad"), 1.0) * size
    noisy = _each(sheet, lambda x: x + rng.normal(0, scale, len(x)))
    return _each(noisy, lambda x: np.round(x)) if "counts1" in sheet.columns else noisy


def _text(change: Callable[[bytes], bytes]) -> Mutation:
    return lambda sheet, _: change(sheet.text())


def _bad_word(text: bytes) -> bytes:
    lines = text.split(b"\n")
    lines[len(lines) // 2] = lines[len(lines) // 2].replace(b",", b",error ", 1)
    return b"\n".join(lines)


MUTATIONS: dict[str, Mutation] = {
    "none": lambda sheet, _: sheet,
    # Columns
    "swapped_angles": _swapped,
    "identical_angles": lambda sheet, _: _second(sheet, lambda first, _: first),
    "clamped_elbow": lambda sheet, _: _second(sheet, lambda first, _: np.round(first + 100)),
    "constant_theta1": lambda sheet, _: _first(sheet, lambda first, _: np.full_like(first, first[0])),
    "constant_theta2": lambda sheet, _: _second(sheet, lambda _, second: np.full_like(second, second[0])),
    "constant_both": lambda sheet, _: _each(sheet, lambda x: np.full_like(x, x[0])),
    "zero_both": lambda sheet, _: _each(sheet, lambda x: 0.0 * x),
    "time_as_theta2": lambda sheet, _: _second(sheet, lambda first, _: np.arange(len(first), dtype=float)),
    "noise_only": lambda sheet, rng: _each(sheet, lambda x: np.round(rng.normal(0, 3.0, len(x)))),
    "missing_theta2": lambda sheet, _: sheet.without(_readings(sheet)[1]),
    "missing_time": lambda sheet, _: sheet.without("t"),
    "two_theta1": _renamed(theta2="q1", counts2="counts1"),
    "unknown_names": _renamed(theta1="alpha", theta2="beta", counts1="alpha", counts2="beta"),
    # Units, zeros, signs
    "deg_as_rad": lambda sheet, _: _each(sheet, lambda x: np.round(x * 180 / np.pi, 4)),
    "rad_as_deg": _options(unit="deg"),
    "rad_as_counts": _options(unit="counts"),
    "relative_as_absolute": lambda sheet, _: _second(sheet, lambda first, second: second - first),
    "absolute_as_relative": _options(angles="relative"),
    "hanging_as_upright": _options(zero="upright"),
    "upright_as_hanging": _options(zero="hanging"),
    "zero_off": lambda sheet, _: _each(sheet, lambda x: np.round(x + 0.2 * np.ptp(x), 4)),
    "sign_theta1": lambda sheet, _: _first(sheet, lambda first, _: -first),
    "sign_theta2": lambda sheet, _: _second(sheet, lambda _, second: -second),
    "sign_both": lambda sheet, _: _each(sheet, np.negative),
    "half_counts": lambda sheet, _: _each(sheet, lambda x: np.round(x / 2, 6)),
    "other_pose": _options(pose="X2"),
    "huge_angles": lambda sheet, _: _each(sheet, lambda x: x * 1e6),
    "huge_exponent": lambda sheet, _: _each(sheet, lambda x: x * 1e300),
    "tiny_angles": lambda sheet, _: _each(sheet, lambda x: x * 1e-9),
    "wrapped": lambda sheet, _: _wrapped(1.0, sheet),
    "wrong_wrap": lambda sheet, _: _wrapped(0.7, sheet),
    "half_wrap_option": _options(wrap=3.0),
    # Time
    "ms_as_s": _time(lambda t: np.round(t * 1e3, 3)),
    "us_as_s": _time(lambda t: np.round(t * 1e6)),
    "s_as_ms": _options(time_unit="ms"),
    "s_as_us": _options(time_unit="us"),
    "wrong_rate": _options(rate_hz=20.0),
    "twice_the_rate": _options(rate_hz=400.0),
    "reversed_time": _time(lambda t: t[::-1].copy()),
    "reversed_rows": _keep(lambda n: np.arange(n)[::-1]),
    "constant_time": _time(lambda t: 0.0 * t),
    "clock_wraps": _time(lambda t: np.mod(t + 1e4, 1.7)),
    "unix_time": _time(lambda t: t + 1.7e9),
    "jitter": _jitter,
    "time_of_few_digits": _time(lambda t: np.round(t, 2)),
    "short_gap": lambda sheet, _: _gap(sheet, 0.1),
    "long_gap": lambda sheet, _: _gap(sheet, 1.0),
    "two_parts": lambda sheet, _: sheet.rows(np.r_[0 : sheet.n // 2, sheet.n // 4 : sheet.n]),
    # Rows
    "two_rows": _keep(lambda _: slice(2)),
    "three_rows": _keep(lambda _: slice(3)),
    "six_rows": _keep(lambda _: slice(6)),
    "ten_rows": _keep(lambda _: slice(10)),
    "thirty_rows": _keep(lambda _: slice(30)),
    "sixty_rows": _keep(lambda _: slice(60)),
    "every_fiftieth": _keep(lambda n: np.arange(0, n, 50)),
    "every_tenth": _keep(lambda n: np.arange(0, n, 10)),
    "shuffled_rows": lambda sheet, rng: sheet.rows(rng.permutation(sheet.n)),
    "doubled_rows": _doubled_rows,
    "stale_readings": _stale,
    "held_start": lambda sheet, rng: _held(sheet, rng, 2.0),
    "held_short_start": lambda sheet, rng: _held(sheet, rng, 0.2),
    "held_middle": lambda sheet, rng: _held(sheet, rng, 1.0, sheet.n // 2),
    "held_end": lambda sheet, rng: _held(sheet, rng, 2.0, sheet.n - 1),
    "held_only": lambda sheet, rng: _held(sheet, rng, 2.0).rows(slice(300)),
    "nan_rows": _holes(np.nan, 0.05),
    "nan_half": _holes(np.nan, 0.5),
    "nan_theta2": _holes(np.nan, 1.1, 1),
    "inf_rows": _holes(np.inf, 0.02),
    "outliers": _holes(1e5, 0.01, 0),
    "zeros_between": _holes(0.0, 0.02),
    "noisy": lambda sheet, rng: _noisy(sheet, rng, 0.05),
    "very_noisy": lambda sheet, rng: _noisy(sheet, rng, 1.0),
    # Text
    "semicolons": _text(lambda text: text.replace(b",", b";")),
    "decimal_commas": _text(lambda text: text.replace(b".", b",")),
    "bars": _text(lambda text: text.replace(b",", b"|")),
    "no_header": _text(lambda text: text.split(b"\n", 1)[1]),
    "header_only": _text(lambda text: text.split(b"\n", 1)[0] + b"\n"),
    "header_twice": _text(lambda text: text + text),
    "bad_word": _text(_bad_word),
    "cut_off": _text(lambda text: text[: len(text) * 2 // 3]),
    "utf16": _text(lambda text: text.decode().encode("utf-16")),
    # Torques
    "torque_sign": lambda sheet, _: sheet.with_columns(tau2_Nm=-sheet.columns["tau2_Nm"]),
    "torque_mNm": lambda sheet, _: sheet.with_columns(
        tau1_Nm=1e3 * sheet.columns["tau1_Nm"], tau2_Nm=1e3 * sheet.columns["tau2_Nm"]
    ),
    "torque_ignored": _options(torque="none"),
    "torque_swapped": lambda sheet, _: sheet.with_columns(
        tau1_Nm=sheet.columns["tau2_Nm"], tau2_Nm=sheet.columns["tau1_Nm"]
    ),
    "torque_constant": lambda sheet, _: sheet.with_columns(
        tau1_Nm=np.full(sheet.n, 0.1), tau2_Nm=np.full(sheet.n, 0.1)
    ),
    "one_torque": lambda sheet, _: sheet.without("tau2_Nm"),
}
"""Name -> what it does to a sheet. Of a text mutation the bytes, else the sheet."""

NEEDS = {name: ("tau1_Nm", "tau2_Nm") for name in MUTATIONS if "torque" in name}
"""Columns without which a mutation says nothing."""
