"""Export a run to the formats of other programs.

`EXPORTERS` contains one writer for each format. All formats have the same columns: `COLUMNS`, `COUNT_COLUMNS` if the
run has counts, and the torques if the run was driven. Each row is one sample; the samples are not resampled. Except for
CSV, the formats also contain the metadata of the run: Parquet under the key `dpr_lab`, HDF5 and NetCDF as attributes,
MATLAB as struct `run`.
"""

import io
import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from dpr_lab.arrays import Array, Integers
from dpr_lab.errors import DprError, RunError
from dpr_lab.run import Run
from dpr_lab.storage.layout import NANOSECONDS
from dpr_lab.whole_file import write_whole

COLUMNS: tuple[str, ...] = ("t_s", "theta0_rad", "theta1_rad", "theta2_rad")
COUNT_COLUMNS: tuple[str, ...] = ("counts0", "counts1", "counts2")
TORQUE_COLUMNS: tuple[str, ...] = ("tau1_Nm", "tau2_Nm")
INPUT_COLUMN = "arm_input"
"""Name of the column of the arm's drive input, in SI units; the rig file states its quantity."""
BOTH_KINDS: tuple[str, ...] = ("tau1_measured_Nm", "tau2_measured_Nm", "tau1_commanded_Nm", "tau2_commanded_Nm")

Columns = dict[str, Array | Integers]
"""Values (n,) of each column."""

UNITS = {"t_s": "s", **dict.fromkeys(COLUMNS[1:], "rad"), **dict.fromkeys(COUNT_COLUMNS, "counts")}
UNITS |= dict.fromkeys(TORQUE_COLUMNS + BOTH_KINDS, "N m") | {INPUT_COLUMN: "SI"}
CONVENTION = "t = 0 at the release; absolute angles, 0 = upright, pi = hanging"


def export(run: Run, path: Path | str) -> Path:
    """Write a run in the format that the suffix of the file states.

    The folder is created if it is missing.

    Raises:
        RunError: the suffix is unknown, or the file exists or cannot be written.
        DprError: the format needs an optional library that is not installed; the message names the library.
    """
    target = Path(path)
    suffix = target.suffix.lower()
    write = EXPORTERS.get(ALIASES.get(suffix, suffix))
    if write is None:
        raise RunError(f"{target}: unknown format {target.suffix!r}; known formats: {', '.join(EXPORTERS)}")
    if target.exists():
        raise RunError(f"{target}: exists already; choose another name")
    write_whole(target, partial(write, run), RunError)
    return target


def columns(run: Run) -> Columns:
    """Convert a run to named columns, each (n,)."""
    table: Columns = dict(zip(COLUMNS, (run.t, *run.theta.T), strict=True))
    if run.torques is not None and run.commanded is not None:
        table |= dict(zip(BOTH_KINDS, (*run.torques.T, *run.commanded.T), strict=True))
    elif run.torques is not None:
        table |= dict(zip(TORQUE_COLUMNS, run.torques.T, strict=True))
    if run.arm_input is not None:
        table[INPUT_COLUMN] = run.arm_input
    if run.counts is not None:
        table |= dict(zip(COUNT_COLUMNS, run.counts.T, strict=True))
    return table


def about(run: Run) -> dict[str, Any]:
    """Return the metadata of the run as plain values."""
    return {
        "name": run.name,
        "rig": run.rig_name,
        "rig_sha256": run.rig_sha256,
        "pose": run.pose or "",
        "rate_hz": run.rate_hz,
        "complete": run.complete,
        "lost": json.dumps(dict(run.lost)),
        "run_sha256": run.sha256,
        "notes": " | ".join(run.notes),
        "convention": CONVENTION,
    }


def write_csv(run: Run, path: Path) -> None:
    """Write comma-separated text with a header line.

    The file contains no comment lines, because a spreadsheet would read them as data.
    """
    table = columns(run)
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(table) + "\n")
        rows = zip(*(column.tolist() for column in table.values()), strict=True)
        file.writelines(",".join(map(repr, row)) + "\n" for row in rows)


def write_parquet(run: Run, path: Path) -> None:
    """Write Apache Parquet; the metadata of each field contain the unit of the column."""
    with extra("parquet"):
        import pyarrow as pa
        import pyarrow.parquet as pq
    table = columns(run)
    fields = [pa.field(name, pa.from_numpy_dtype(c.dtype), metadata={"unit": UNITS[name]}) for name, c in table.items()]
    schema = pa.schema(fields, metadata={"dpr_lab": json.dumps(about(run))})
    pq.write_table(pa.table(dict(table), schema=schema), path)


def write_hdf5(run: Run, path: Path) -> None:
    """Write HDF5 with one compressed data set, with checksum, for each column.

    The file is created in memory, because the library aborts the whole program if the disk is full.
    """
    with extra("hdf5"):
        import h5py
    with h5py.File(str(path), "w", driver="core", backing_store=False) as file:
        file.attrs.update(about(run))
        for name, column in columns(run).items():
            dataset = file.create_dataset(name, data=column, compression="gzip", shuffle=True, fletcher32=True)
            dataset.attrs["unit"] = UNITS[name]
        file.flush()
        image = file.id.get_file_image()
    path.write_bytes(image)


def write_netcdf(run: Run, path: Path) -> None:
    """Write NetCDF 4; `xarray.open_dataset` returns one variable per column over `t_s`.

    The file is created in memory, as for HDF5.
    """
    with extra("netcdf"):
        import_module("h5netcdf")
        xarray = import_module("xarray")
    table = columns(run)
    times = ("t_s", table.pop("t_s"), {"units": UNITS["t_s"], "long_name": "time since the release"})
    values = {name: ("t_s", column, {"units": UNITS[name]}) for name, column in table.items()}
    attributes = about(run) | {"complete": int(run.complete)}
    dataset = xarray.Dataset(values, coords={"t_s": times}, attrs=attributes)
    compressed = {name: {"zlib": True, "shuffle": True, "fletcher32": True} for name in values}
    image = io.BytesIO()
    dataset.to_netcdf(image, engine="h5netcdf", encoding=compressed)
    path.write_bytes(image.getvalue())


def write_mat(run: Run, path: Path) -> None:
    """Write a MAT-file of level 5.

    In MATLAB, `load` returns one column vector per column and the struct `run`.
    """
    from scipy.io import savemat

    with path.open("wb") as file:
        savemat(file, {**columns(run), "run": about(run)}, oned_as="column", do_compression=True)


JOINT_STATE = "sensor_msgs/msg/JointState"
JOINT_STATE_DEFINITION = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
================================================================================
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
"""Message definition of JointState in ROS 2, as printed by `ros2 interface show sensor_msgs/msg/JointState`."""

JOINTS_TOPIC, JOINT_NAMES = "/joint_states", ("theta0", "theta1", "theta2")


def write_joint_states(run: Run, path: Path) -> None:
    """Write MCAP with `sensor_msgs/JointState` on `/joint_states`.

    Positions are absolute angles, rad. The stamp of the first sample is 1 s, because 0 denotes a missing stamp.
    """
    with extra("ros2"):
        from mcap_ros2.writer import Writer
    with path.open("wb") as file, Writer(file) as writer:
        schema = writer.register_msgdef(JOINT_STATE, JOINT_STATE_DEFINITION)
        metadata = about(run)
        writer.add_metadata("dpr_lab", {key: str(value) for key, value in metadata.items()})
        stamps = np.round((run.t - run.t[0] + 1.0) * NANOSECONDS).astype(np.int64) if len(run.t) else []
        for row, (stamp, theta) in enumerate(zip(stamps, run.theta, strict=True)):
            sec, nanosec = divmod(int(stamp), NANOSECONDS)
            header = {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": ""}
            message = {"header": header, "name": JOINT_NAMES, "position": theta.tolist(), "velocity": [], "effort": []}
            writer.write_message(JOINTS_TOPIC, schema, message, int(stamp), int(stamp), row)


EXPORTERS: Mapping[str, Callable[[Run, Path], None]] = {
    ".csv": write_csv,
    ".parquet": write_parquet,
    ".h5": write_hdf5,
    ".nc": write_netcdf,
    ".mat": write_mat,
    ".mcap": write_joint_states,
}
"""Writer for each file suffix."""

ALIASES: Mapping[str, str] = {".hdf5": ".h5"}


@contextmanager
def extra(name: str) -> Iterator[None]:
    """Provide a context in which an optional library is imported.

    Raises:
        DprError: the library is not installed; the message names the package to install.
    """
    try:
        yield
    except ImportError as error:
        raise DprError(
            f"this format needs {error.name}, which is not installed: pip install 'dpr-lab[{name}]'"
        ) from error
