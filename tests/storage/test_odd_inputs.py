"""Inputs that are not files, or unpack to more data than a recording, are refused at once with a message."""

import os
import socket
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dpr_lab.errors import DprError, RunError
from dpr_lab.gap.result.diagnosis import load_diagnosis
from dpr_lab.identification.model import load_model
from dpr_lab.rig import load_rig
from dpr_lab.storage.reader import load_run
from dpr_lab.storage.readers import read_any
from dpr_lab.storage.sidecar import read_sidecar
from dpr_lab.whole_file import regular

pytestmark = pytest.mark.skipif(os.name != "posix", reason="pipes and devices of POSIX")

READS: dict[str, Callable[[Path], object]] = {
    "a.csv": read_any,
    "a.mat": read_any,
    "a.mcap": load_run,
    "a.toml": load_rig,
    "model.json": load_model,
    "diagnosis.json": load_diagnosis,
}


@pytest.mark.timeout(60)
@pytest.mark.parametrize("name", READS)
def test_a_named_pipe_is_refused_without_waiting(name: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / name)
    with pytest.raises(DprError, match="is a named pipe, not a regular file: save its data in a file first"):
        READS[name](tmp_path / name)


@pytest.mark.timeout(60)
def test_sockets_and_devices_are_refused_too(tmp_path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(tmp_path / "s"))
        with pytest.raises(RunError, match="is a socket"):
            read_any(tmp_path / "s")
    with pytest.raises(RunError, match="is a device"):
        read_any(Path("/dev/zero"))


def test_an_empty_hash_file_after_a_loss_of_power_is_no_hash(tmp_path: Path) -> None:
    (tmp_path / "a.mcap.sha256").touch()
    assert read_sidecar(tmp_path / "a.mcap") is None


@pytest.mark.timeout(60)
def test_a_pipe_next_to_a_run_or_in_a_bag_is_refused(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.mcap.sha256")
    with pytest.raises(RunError, match="is a named pipe"):
        read_sidecar(tmp_path / "a.mcap")
    pytest.importorskip("mcap_ros2")
    bag = tmp_path / "bag"
    bag.mkdir()
    (bag / "metadata.yaml").touch()
    os.mkfifo(bag / "bag_0.db3")
    with pytest.raises(RunError, match="is a named pipe"):
        read_any(bag)


def test_files_and_what_is_not_there_are_left_to_their_readers(tmp_path: Path) -> None:
    for path in (tmp_path, tmp_path / "none", Path(__file__)):
        assert regular(path) == path


@pytest.mark.slow
def test_nested_groups_and_thousands_of_data_sets_are_refused(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "deep.h5", "w") as file:
        group = file
        for _ in range(3000):
            group = group.create_group("g")
    with h5py.File(tmp_path / "wide.h5", "w") as file:
        for number in range(3000):
            file.create_group(f"g{number}")
    for name in ("deep.h5", "wide.h5"):
        with pytest.raises(RunError, match="copy the columns of one recording into a new file"):
            read_any(tmp_path / name)


def test_a_group_that_holds_itself_is_read_once(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["within/t"] = np.arange(5.0)
        file["within/theta1"] = np.arange(5.0)
        file["within/again"] = file["within"]
        file["elsewhere"] = h5py.ExternalLink("other.h5", "/t")
    assert read_any(tmp_path / "a.h5").names == ("t", "theta1")


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["mat", "npz", "parquet", "h5"])
def test_compressed_zeros_are_refused_before_they_fill_the_memory(suffix: str, tmp_path: Path) -> None:
    zeros, path = np.zeros(8_000_000), tmp_path / f"a.{suffix}"
    if suffix == "mat":
        from scipy.io import savemat

        savemat(path, {"t": zeros}, do_compression=True)
    elif suffix == "npz":
        np.savez_compressed(path, t=zeros)
    elif suffix == "h5":
        with pytest.importorskip("h5py").File(path, "w") as file:
            file.create_dataset(
                "t", shape=zeros.shape, dtype="f8", fillvalue=0.0, chunks=(100_000,), compression="gzip"
            )
    else:
        pq, pa = pytest.importorskip("pyarrow.parquet"), pytest.importorskip("pyarrow")
        pq.write_table(pa.table({"t": zeros}), path)
    assert path.stat().st_size < 200_000
    with pytest.raises(
        RunError, match="which is too much for a recording: save its columns without compression, or as CSV"
    ):
        read_any(path)


@pytest.mark.parametrize(("suffix", "kind"), [("h5", "HDF5 file"), ("mat", "MATLAB file"), ("npz", "NumPy file")])
def test_a_damaged_file_is_refused_in_our_own_words(suffix: str, kind: str, tmp_path: Path) -> None:
    begin = {"h5": b"\x89HDF\r\n\x1a\n", "mat": b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM", "npz": b"PK\x03\x04"}
    (tmp_path / f"a.{suffix}").write_bytes(begin[suffix] + bytes(range(200)))
    if suffix == "h5":
        pytest.importorskip("h5py")
    with pytest.raises(RunError) as refused:
        read_any(tmp_path / f"a.{suffix}")
    assert str(refused.value).endswith(f"not a {kind}: copy or save the file again, or export its table as CSV")


@pytest.mark.parametrize("content", [b"not", b"not a mat file", b"MATLAB 5.0 MAT-file", bytes(130)])
def test_a_few_bytes_are_not_a_matlab_file(content: bytes, tmp_path: Path) -> None:
    (tmp_path / "a.mat").write_bytes(content)
    with pytest.raises(RunError, match="is damaged or incomplete, or is not a MATLAB file"):
        read_any(tmp_path / "a.mat")
