"""One swing as files of many formats."""

import json
import sqlite3
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp
from scipy.io import savemat

from dpr_lab.rig import load_rig
from dpr_lab.run import Run
from dpr_lab.storage.csv_import import ImportOptions, import_csv
from dpr_lab.storage.export import JOINT_STATE, JOINT_STATE_DEFINITION

RIG = load_rig("paper")
N = 200
T = np.round(np.arange(N) * 0.005, 6)
THETA1 = np.pi + 0.8 * np.cos(6 * T)
THETA2 = np.pi + 2.0 * np.cos(4 * T)
SWING = {"t": T, "theta1": THETA1, "theta2": THETA2}
ROWS = np.column_stack([T, THETA1, THETA2])
GUESSED: dict[str, Any] = {"unit": None, "time_unit": None}


def small_swing(t: np.ndarray, start: float) -> np.ndarray:
    """Angle of the rod of the fixture `one` after its release, rad; 0 = hanging."""
    return solve_ivp(lambda _, y: [y[1], -45.3 * np.sin(y[0]) - 0.1 * y[1]], (0, 6), [start, 0], t_eval=t).y[0]


def read(path: Path, **options: Any) -> Run:
    return import_csv(path, RIG, ImportOptions(**GUESSED | options))


def is_the_swing(run: Run, atol: float = 1e-9) -> bool:
    theta = np.column_stack([0 * T, THETA1, THETA2])
    return bool(np.allclose(run.t, T, rtol=0, atol=1e-9) and np.allclose(run.theta, theta, rtol=0, atol=atol))


def text(path: Path, rows: np.ndarray, delimiter: str = ",", head: str = "", comma: bool = False) -> Path:
    body = "\n".join(delimiter.join(f"{value:.12g}" for value in row) for row in rows)
    path.write_text(head + (body.replace(".", ",") if comma else body) + "\n", encoding="utf-8")
    return path


def write_mat(path: Path, **held: Any) -> Path:
    savemat(path, held, do_compression=True)
    return path


def write_h5(path: Path, prefix: bytes = b"", **held: np.ndarray) -> Path:
    import h5py

    with h5py.File(path, "w", userblock_size=512 if prefix else 0) as file:
        for name, array in held.items():
            file[name] = array
    if prefix:
        with path.open("r+b") as file:
            file.write(prefix)
    return path


def write_npz(path: Path, **held: Any) -> Path:
    np.savez_compressed(path, **held)
    return path


def write_parquet(path: Path, **held: np.ndarray) -> Path:
    import pyarrow as pa
    import pyarrow.parquet as pq

    pq.write_table(pa.table(held), path)
    return path


def write_json(path: Path, **held: np.ndarray) -> Path:
    path.write_text(json.dumps({name: column.tolist() for name, column in held.items()}))
    return path


WRITERS = {
    ".mat": write_mat,
    ".h5": write_h5,
    ".npz": write_npz,
    ".parquet": write_parquet,
    ".json": write_json,
}


Topic = tuple[str, tuple[str, ...], np.ndarray]


def write_mcap(path: Path, topics: list[Topic], stamped: bool = True) -> Path:
    from mcap_ros2.writer import Writer

    with path.open("wb") as file, Writer(file) as writer:
        schema = writer.register_msgdef(JOINT_STATE, JOINT_STATE_DEFINITION)
        other = writer.register_msgdef("std_msgs/msg/String", "string data")
        writer.write_message("/chatter", other, {"data": "hello"}, 1)
        for topic, names, rows in topics:
            for row in rows:
                ns = round(row[0] * 1e9) + 1_700_000_000_000_000_000
                message = joint_state(ns if stamped else 0, names, row[1:])
                writer.write_message(topic, schema, message, ns + 1000 * (not stamped), ns)
    return path


def joint_state(ns: int, names: tuple[str, ...], position: np.ndarray) -> dict[str, Any]:
    stamp = {"sec": ns // 10**9, "nanosec": ns % 10**9}
    header = {"stamp": stamp, "frame_id": "base"}
    return {"header": header, "name": list(names), "position": list(position), "velocity": [], "effort": []}


def write_db3(path: Path, topics: list[Topic]) -> Path:
    from mcap_ros2._dynamic import serialize_dynamic

    encode = serialize_dynamic(JOINT_STATE, JOINT_STATE_DEFINITION)[JOINT_STATE]
    bag = sqlite3.connect(path)
    bag.execute("CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)")
    bag.execute("CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)")
    for number, (topic, names, rows) in enumerate(topics):
        bag.execute("INSERT INTO topics VALUES(?, ?, ?, 'cdr')", (number, topic, JOINT_STATE))
        messages = [(number, round(row[0] * 1e9) + 10**18, encode(joint_state(0, names, row[1:]))) for row in rows]
        bag.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", messages)
    bag.commit()
    bag.close()
    return path


BAGS = {".mcap": write_mcap, ".db3": write_db3}
