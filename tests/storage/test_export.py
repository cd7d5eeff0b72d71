"""Every export is read back by the library of its own format and equals the run."""

import builtins
import json

import numpy as np
import pytest

from dpr_lab.errors import DprError, RunError
from dpr_lab.run import Run
from dpr_lab.storage.export import EXPORTERS, export

N = 50
THETA = np.random.default_rng(0).normal(size=(N, 3))
COUNTS = np.random.default_rng(1).integers(-(2**40), 2**40, (N, 3))


def make(counts=None):
    return Run(
        name="swing",
        t=np.arange(N) / 1000 - 0.01,
        theta=THETA,
        counts=counts,
        pose="X1",
        rig_name="paper",
        rig_sha256="ab" * 32,
        rate_hz=1000.0,
        lost={"crc": 1},
        notes=("one\nnote",),
    )


def from_csv(path):
    table = np.genfromtxt(path, delimiter=",", names=True, dtype=None)
    return {name: table[name] for name in table.dtype.names}, None


def from_parquet(path):
    table = pytest.importorskip("pyarrow.parquet").read_table(path)
    assert table.schema.field("t_s").metadata == {b"unit": b"s"}
    return {n: table[n].to_numpy() for n in table.column_names}, json.loads(table.schema.metadata[b"dpr_lab"])["rig"]


def from_hdf5(path):
    with pytest.importorskip("h5py").File(path) as file:
        assert file["theta1_rad"].attrs["unit"] == "rad"
        return {name: file[name][:] for name in file}, file.attrs["rig"]


def from_netcdf(path):
    with pytest.importorskip("xarray").open_dataset(path, engine="h5netcdf") as data:
        assert data["theta1_rad"].attrs["units"] == "rad"
        assert list(data.coords) == ["t_s"]
        return {name: data[name].values for name in data.variables}, data.attrs["rig"]


def from_mat(path):
    from scipy.io import loadmat

    table = loadmat(path, squeeze_me=True)
    about = table.pop("run")
    return {n: v for n, v in table.items() if not n.startswith("__")}, str(about["rig"])


READERS = {".csv": from_csv, ".parquet": from_parquet, ".h5": from_hdf5, ".nc": from_netcdf, ".mat": from_mat}


@pytest.mark.parametrize("counts", [None, COUNTS], ids=["angles", "counts"])
@pytest.mark.parametrize(
    "suffix",
    [pytest.param(suffix, marks=[pytest.mark.slow] * (suffix == ".nc")) for suffix in EXPORTERS if suffix != ".mcap"],
)
def test_an_export_read_back_is_the_run(tmp_path, suffix, counts):
    if suffix == ".nc":
        pytest.importorskip("h5netcdf")
    run = make(counts)
    table, rig = READERS[suffix](export(run, tmp_path / f"swing{suffix}"))
    assert rig == (None if suffix == ".csv" else "paper")
    np.testing.assert_array_equal(table.pop("t_s"), run.t)
    for axis in range(3):
        np.testing.assert_array_equal(table.pop(f"theta{axis}_rad"), THETA[:, axis])
        if counts is not None:
            np.testing.assert_array_equal(table.pop(f"counts{axis}"), COUNTS[:, axis])
    assert not table


@pytest.mark.parametrize(("suffix", "extra"), [(".parquet", "parquet"), (".h5", "hdf5"), (".nc", "netcdf")])
def test_a_missing_library_is_named_with_its_extra(tmp_path, monkeypatch, suffix, extra):
    real = builtins.__import__

    def without(name, *args, **kwargs):
        if name.split(".")[0] in ("pyarrow", "h5py", "h5netcdf"):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)
        return real(name, *args, **kwargs)

    monkeypatch.setattr("dpr_lab.storage.export.import_module", without)
    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(DprError, match=rf"pip install 'dpr-lab\[{extra}\]'"):
        export(make(), tmp_path / f"swing{suffix}")


@pytest.mark.parametrize("suffix", EXPORTERS)
def test_an_existing_file_or_one_in_place_of_the_folder_is_reported(tmp_path, suffix):
    (tmp_path / f"swing{suffix}").write_text("mine")
    with pytest.raises(RunError, match="exists already"):
        export(make(), tmp_path / f"swing{suffix}")
    with pytest.raises(RunError, match="cannot be written"):
        export(make(), tmp_path / f"swing{suffix}" / f"swing{suffix}")


def test_an_unknown_format_lists_the_known(tmp_path):
    with pytest.raises(RunError, match=r"unknown format '.xlsx'; known formats: .csv, .parquet, .h5, .nc, .mat"):
        export(make(), tmp_path / "swing.xlsx")
