"""Files of named arrays: MATLAB, HDF5, NumPy and Parquet."""

import pickle
import struct
import tracemalloc
import zlib
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from dpr_lab.errors import RunError
from dpr_lab.storage.readers.matlab import read_matlab
from dpr_lab.storage.tables import table as table_module
from dpr_lab.storage.tables.table import TableLimits
from tests.storage.swing_files import (
    ROWS,
    SWING,
    THETA1,
    THETA2,
    WRITERS,
    T,
    is_the_swing,
    read,
    write_h5,
    write_mat,
)


@pytest.mark.parametrize("suffix", WRITERS)
def test_named_arrays(tmp_path: Path, suffix: str) -> None:
    assert is_the_swing(read(WRITERS[suffix](tmp_path / f"a{suffix}", **SWING)))


@pytest.mark.parametrize("suffix", [".mat", ".h5", ".npz"])
def test_a_matrix_is_found_among_scalars_words_and_other_tables(tmp_path: Path, suffix: str) -> None:
    file = WRITERS[suffix](tmp_path / f"a{suffix}", data=ROWS, fs=np.array(200.0), other=np.arange(7.0))
    assert is_the_swing(read(file, take=("data",)))
    assert is_the_swing(read(file))
    with pytest.raises(RunError, match="contains nothing named 'date'; it contains: data, fs, other"):
        read(file, take=("date",))


def test_a_struct_with_time_and_matlab_version_7_3(tmp_path: Path) -> None:
    simulink = {"time": T, "signals": {"values": ROWS[:, 1:], "dimensions": 2.0, "label": "theta"}}
    assert is_the_swing(read(write_mat(tmp_path / "a.mat", out=simulink)))
    twice = write_mat(tmp_path / "b.mat", first=SWING, second={**SWING, "theta1": THETA1 + 1})
    assert is_the_swing(read(twice, take=("first",)))
    with pytest.raises(RunError, match="no single column found for t and theta1 and theta2; the table has: first/t"):
        read(twice)
    flat = {name: column[None, :] for name, column in SWING.items()}
    newer = write_h5(tmp_path / "c.mat", b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(128), **flat)
    assert is_the_swing(read(newer))


def mat_element(kind: int, data: bytes) -> bytes:
    return struct.pack("<II", kind, len(data)) + data + b"\0" * (-len(data) % 8)


def mat_file(path: Path, *elements: bytes) -> Path:
    path.write_bytes(b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM" + b"".join(elements))
    return path


def test_an_object_of_matlab_is_refused_with_the_way_to_save_it(tmp_path: Path) -> None:
    names = [mat_element(1, name) for name in (b"ts", b"MCOS", b"timeseries")]
    flags, ids = mat_element(6, struct.pack("<II", 17, 0)), mat_element(6, struct.pack("<II", 6, 0))
    shape, empty = mat_element(5, struct.pack("<ii", 1, 1)), mat_element(1, b"")
    data = mat_element(14, ids + shape + empty + mat_element(9, struct.pack("<d", 0.0)))
    opaque = mat_element(14, flags + b"".join(names) + data)
    with pytest.raises(RunError, match=r"MATLAB class timeseries, .* save it as a struct: s.time = ts.Time"):
        read(mat_file(tmp_path / "a.mat", opaque))


def test_what_unpacks_to_more_than_a_recording_is_refused_unread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(table_module, "LIMITS", TableLimits(values=100_000))
    zeros = np.zeros(200_000)
    for suffix, write in WRITERS.items():
        file = write(tmp_path / f"a{suffix}", t=zeros, theta1=zeros)
        assert suffix in (".h5", ".json") or file.stat().st_size < 20_000
        with pytest.raises(RunError, match="more than 100,000: cut it into recordings"):
            read(file)
    bomb = mat_element(15, zlib.compress(bytes(10_000_000), 9))
    with pytest.raises(RunError, match="cut it into recordings"):
        read(mat_file(tmp_path / "b.mat", bomb))


def test_a_pickle_in_an_array_is_not_loaded(tmp_path: Path) -> None:
    np.savez(tmp_path / "a.npz", t=np.array([{"a": 1}], dtype=object), allow_pickle=True)
    with pytest.raises(RunError, match="pickled objects, which could contain code"):
        read(tmp_path / "a.npz")
    (tmp_path / "b.npy").write_bytes(pickle.dumps([1]))
    with pytest.raises(RunError):
        read(tmp_path / "b.npy")


@pytest.mark.parametrize("suffix", WRITERS)
def test_columns_of_different_length_are_named(tmp_path: Path, suffix: str) -> None:
    if suffix == ".parquet":
        return  # cannot hold them
    file = WRITERS[suffix](tmp_path / f"a{suffix}", **SWING | {"theta2": THETA2[:-1]})
    with pytest.raises(RunError, match="columns of different length: theta2 199 values, but the others have 200"):
        read(file)


@pytest.mark.slow
def test_a_matlab_file_takes_the_memory_of_its_numbers(tmp_path: Path) -> None:
    rows, columns = 100_000, 20
    t = np.arange(rows) / 1000
    filled = {f"x{k}": np.round(np.cos(t + k), 2) for k in range(columns)}
    savemat(tmp_path / "a.mat", {"t": t, "theta1": np.cos(t), "theta2": np.sin(t), **filled}, do_compression=True)
    read_matlab(tmp_path / "a.mat", ())  # SciPy is loaded
    tracemalloc.start()
    try:
        table = read_matlab(tmp_path / "a.mat", ())
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(table.values) == columns + 3
    assert peak < 1.5 * 8 * rows * (columns + 3)
